"""What only the sizes of disturbances tell of parameters: a scale of states that nobody measures.

Where a channel reads a charge over a capacity, half the capacity with half the charge shows the same, and so do an
inductance and a resistance twice as large. All that changes is how large the disturbances are, which nobody knows, and
which the fit estimates itself. With their levels held the normal equations take them for a measure. Where a direction
of the parameters is told much worse than each of them alone, the changes of the whitened innovations by parameters and
levels (the filter's gains move along)

    g_i = de/dp_i,    d_k = de/dlog(level_k),    G freed of all that D can do

say what is told beside the levels: G'G. It is the least that is told: what pins the levels themselves is left out.

Rules of this file: a fit in, numbers out; the fit is not changed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import Noise, gains

Array = NDArray[np.float64]

# Directions are looked at that are told by less than this share of what tells each parameter alone; one is of levels
# where less than half of what seems to tell it is left without them.
WEAK, LEFT = 0.01, 0.5
# Of parameters that are told alone to this share of their values; what rounding leaves tells nothing of a direction.
ALONE, ROUNDING = 0.2, 1e-10
# Steps of the differences: of the logarithm of a level, and of a parameter in deviations that it would have alone.
LEVEL_STEP, STEP = 0.02, 0.1


def freed_of_levels(found: HypothesisFit) -> Array | None:
    """The information about the free parameters without what levels alone tell.

    Parameters
    ----------
    found : HypothesisFit
        A fit with its whitened rows.

    Returns
    -------
    Array of shape (m, m), optional
        The products of its rows, less what is not left of directions that levels tell; None where they tell none.
    """
    rows = found.stacked()[:, 1:]
    size = np.linalg.norm(rows, axis=0)
    seen = told_alone(found, ALONE)
    products = rows[:, seen].T @ rows[:, seen]
    values, vectors = np.linalg.eigh(products / np.outer(size[seen], size[seen]))
    known = values > ROUNDING
    if not known.any() or values[known][0] >= WEAK:
        return None
    left = _left_without_levels(found, seen, size)
    if left is None:
        return None
    # steps (seen, k) that each tell one, and how much of that is left
    steps = vectors[:, known] / np.sqrt(values[known]) / size[seen][:, None]
    shares, turns = np.linalg.eigh(steps.T @ left @ steps)
    steps = steps @ turns
    untold = (shares < LEFT) & (np.sum((steps * size[seen][:, None]) ** 2, axis=0) > 1.0 / WEAK)
    if not untold.any():
        return None
    lost = (products @ steps)[:, untold]
    information = rows.T @ rows
    information[np.ix_(seen, seen)] -= (lost * (1.0 - np.maximum(shares[untold], 0.0))) @ lost.T
    return np.asarray(information)


def told_alone(found: HypothesisFit, share: float) -> list[int]:
    """Places of the free parameters that are each told to this share of their values, were all others known."""
    lengths = np.linalg.norm(found.stacked()[:, 1:], axis=0)
    return [i for i, name in enumerate(found.free) if lengths[i] * abs(found.values[name]) * share > 1.0]


def _left_without_levels(found: HypothesisFit, seen: Sequence[int], size: Array) -> Array | None:
    """(seen, seen) products of the changes by parameters, freed of what levels do; None where one is no number."""
    changes = np.column_stack([_by_parameter(found, found.free[i], STEP / size[i]) * size[i] / STEP for i in seen])
    levels = _by_levels(found)
    if not (np.isfinite(changes).all() and np.isfinite(levels).all()):
        return None
    changes -= levels @ np.linalg.lstsq(levels, changes, rcond=None)[0]
    return np.asarray(changes.T @ changes)


def _by_levels(found: HypothesisFit) -> Array:
    """(rows, k) changes of the whitened innovations by the logarithm of each level of a disturbance."""
    columns = []
    for recording, noise in found.noise.items():
        for j in range(len(noise.force)):
            up, down = (_innovations(found, {recording: _scaled(noise, j, s)}) for s in (LEVEL_STEP, -LEVEL_STEP))
            columns.append((up - down) / (2.0 * LEVEL_STEP))
    return np.column_stack(columns)


def _scaled(noise: Noise, j: int, by: float) -> Noise:
    force = noise.force.copy()
    force[j] *= np.exp(by)
    return noise._replace(force=force)


def _by_parameter(found: HypothesisFit, name: str, step: float) -> Array:
    """(rows,) change of the whitened innovations by a small step of a parameter."""
    up, down = (_innovations(found, {}, {name: found.values[name] + d}) for d in (step, -step))
    return np.asarray((up - down) / 2.0)


def _innovations(found: HypothesisFit, noise: Mapping[str, Noise], values: Mapping[str, float] | None = None) -> Array:
    """(rows,) with other levels or parameters, along the same reference."""
    parts = []
    for i, track in enumerate(found.tracks):
        # what leads a memory moves the track
        columns = found.columns[i] if values is None else copy(track).columns({**found.values, **values}, ())
        gain = gains(columns.model, noise.get(track.stretch.recording, found.noise[track.stretch.recording]))
        parts.append(track.whitened(columns, gain)[:, 0])
    return np.concatenate(parts)
