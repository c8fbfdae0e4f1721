"""Steps and nodes of a run: how long a step may be, how many are written out at once, where nodes have to lie.

Rules of this file: no step crosses a change of an input, late as it may come; every late reading has a node.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.effects.base import Effect
from hoopd.plants.held_input import SAME_S
from hoopd.plants.plant_with_effects import BENT_SUBSTEPS, FRICTION_SUBSTEPS, SMOOTH_SUBSTEPS, Composite

Array = NDArray[np.float64]

# Steps that are written out in one function: more would take longer to be made than to be run.
MOST_AT_ONCE = 10


def longest_step_s(composite: Composite, held: Mapping[str, float]) -> float:
    """The Runge-Kutta step that the effects need: of a delay none, for no step crosses a change of an input."""
    wishes = [_wished_substeps(effect, held) for effect in composite.effects if effect.delay is None]
    dry = any(effect.friction is not None for effect in composite.effects)
    least = max(1, FRICTION_SUBSTEPS if dry else 0, BENT_SUBSTEPS if composite.reads_bent else 0)
    return composite.longest_step_s / max(least, *wishes, 0)


def _wished_substeps(effect: Effect, held: Mapping[str, float]) -> int:
    """What an effect asks for; one that comes back so many times a turn asks for the finest there may be."""
    turns = [one for one in effect.parameters if one.discrete and np.isfinite(one.high)]
    known = [held[effect.key(one.name)] / one.high for one in turns if effect.key(one.name) in held]
    if len(known) < len(turns) or not turns:
        return effect.substeps
    return min(effect.substeps, max(SMOOTH_SUBSTEPS, int(np.ceil(max(known) * effect.substeps))))


def steps_at_once(steps: NDArray[np.int64]) -> int:
    """The largest number up to `MOST_AT_ONCE` that divides the steps of every interval."""
    common = int(np.gcd.reduce(steps))
    return max(count for count in range(1, MOST_AT_ONCE + 1) if common % count == 0)


def nodes_of_run(t: Array, u: Array, delay_s: float, late: Sequence[float]) -> Array:
    """Nodes: those of the axis, where a late input changes, where a late reading was taken; t itself if that is all."""
    parts = []
    if delay_s > 0.0:
        changes = t[1:-1][(np.diff(u, axis=0) != 0.0).any(axis=1)] + delay_s
        parts.append(changes[changes < t[-1]])
    for d in late:
        parts.append((t - d)[t - d > t[0]])
    if not parts:
        return t
    nodes = np.sort(np.concatenate([t, *parts]))
    return np.asarray(nodes[np.concatenate([[True], np.diff(nodes) > SAME_S])])
