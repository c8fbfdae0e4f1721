"""The parameters that simulate best: output-error refinement of a hypothesis on free runs.

Starts of all windows are eliminated (variable projection, Golub and Pereyra 1973), parameters move by damped
Gauss-Newton steps. A long run forgives no error on its way: windows grow from two seconds to the whole stretch, and the
starts of longer ones are the states that the shorter ones had there.

Rules of this file: the criterion is the measure of `tables` (each channel's error over its spread); a hypothesis is
named elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.simulation import Simulated
from hoopd.diagnose.proof.window_comparison import (
    Part,
    channel_weights,
    errors,
    node_states,
    part_of,
    simulated,
    start_spread,
)
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.recording_parameters import plain
from hoopd.plants.likelihood.stretches import Stretch

Array = NDArray[np.float64]

# Lengths of the windows, one after the other; None: the whole stretch.
LENGTHS_S: tuple[float | None, ...] = (2.0, 5.0, None)
MOST_STEPS = 12
# A search ends when a step lowers the cost by less than this share.
SETTLED = 1e-4
DAMPING, EASIER, HARDER, MOST_DAMPING = 1e-3, 0.2, 6.0, 1e6
# Finite differences, relative to a parameter's size.
DIFFERENCE = 1e-5
# Starts stay near what the smoother says: START_SPREAD counts as little as this.
START_WEIGHT = 1e-4
# Prior of a parameter, of so many times its size: what the runs say nothing about stays where it is.
PRIOR_SIZE, PRIOR_WEIGHT = 3.0, 1e-4


@dataclass
class Refined:
    """A hypothesis on free runs."""

    values: dict[str, float]
    free: tuple[str, ...]
    runs: list[Simulated]
    cost: float  # sum of |y - yhat|^2 / |y - mean y|^2 over channels and recordings, with what starts and prior add


def refine(
    stretches: Sequence[Stretch],
    references: Sequence[Array],
    effects: Sequence[Effect],
    values: Mapping[str, float],
    free: Sequence[str],
    lengths_s: Sequence[float | None] = LENGTHS_S,
    settled: float = SETTLED,
) -> Refined:
    """The hypothesis with the free parameters that simulate best; references (nodes, nx or more): a smoother's."""
    here, starts = dict(values), list(references)
    weights = channel_weights(stretches)
    parts: list[Part] = []
    for length in lengths_s:
        parts = [part_of(s, r, effects, w, free, length) for s, r, w in zip(stretches, starts, weights, strict=True)]
        here, cost = _search(parts, here, tuple(free), effects, settled)
        starts = [node_states(part, here) for part in parts]
    runs = [simulated(part, here) for part in parts]
    return Refined(here, tuple(free), runs, cost)


# ---------------------------------------------------------------------------------------------- search


def _search(
    parts: list[Part], values: dict[str, float], free: tuple[str, ...], effects: Sequence[Effect], settled: float
) -> tuple[dict[str, float], float]:
    """Levenberg-Marquardt on parameters and starts."""
    scale = sizes(values, free, effects)
    centre = np.array([values[name] for name in free])
    damping, cost = DAMPING, _cost(parts, values, [part.start for part in parts], free, centre, scale)
    for _ in range(MOST_STEPS):
        blocks = [_blocks(part, values, free, scale) for part in parts]
        before = cost
        while damping < MOST_DAMPING:
            delta, moves = _step(blocks, values, free, centre, scale, damping)
            trial = _moved(values, free, delta, effects)
            starts = [part.start + move for part, move in zip(parts, moves, strict=True)]
            now = _cost(parts, trial, starts, free, centre, scale)
            if now < cost:
                values, cost, damping = trial, now, max(damping * EASIER, 1e-9)
                for part, start in zip(parts, starts, strict=True):
                    part.start = start
                break
            damping *= HARDER
        if before - cost < settled * before:
            break
    return values, cost


def sizes(values: Mapping[str, float], free: Sequence[str], effects: Sequence[Effect]) -> Array:
    """(m,) usual size of each free parameter."""
    own = {e.key(p.name): p for e in effects for p in e.parameters}
    out = []
    for name in free:
        p = own.get(plain(name))
        size = 0.3 if p is None else (1.0 if p.role == "phase" else abs(p.size))
        out.append(max(abs(values[name]), size))
    return np.array(out)


def _moved(
    values: Mapping[str, float], free: Sequence[str], delta: Array, effects: Sequence[Effect]
) -> dict[str, float]:
    """Values after a step, effects within their ranges."""
    ranges = {e.key(p.name): (p.low, p.high) for e in effects for p in e.parameters if p.role != "phase"}
    out = dict(values)
    for name, step in zip(free, delta, strict=True):
        low, high = ranges.get(plain(name), (-np.inf, np.inf))
        out[name] = float(np.clip(values[name] + step, low, high))
    return out


def _cost(
    parts: Sequence[Part], values: Mapping[str, float], starts: Sequence[Array], free: Sequence[str], centre: Array,
    scale: Array,
) -> float:  # fmt: skip
    total = 0.0
    for part, start in zip(parts, starts, strict=True):
        local = part.local(values)
        y = part.simulator.readings(local, part.simulator.run(local, start[:, :, None]))[..., 0]
        off = (start - part.anchor) / start_spread(part)
        total += float(np.sum(errors(part, y) ** 2)) + START_WEIGHT * float(np.sum(off**2)) / off.size
    off = (np.array([values[name] for name in free]) - centre) / (PRIOR_SIZE * scale)
    return total + PRIOR_WEIGHT * float(off @ off)


@dataclass(frozen=True)
class _Blocks:
    """Normal equations of one stretch: starts of each window (b, nx, nx), mixed (b, nx, m), parameters (m, m)."""

    xx: Array
    xp: Array
    pp: Array
    x: Array
    p: Array


def _blocks(part: Part, values: Mapping[str, float], free: Sequence[str], scale: Array) -> _Blocks:
    nx = len(part.start)
    local, m = part.local(values), len(free)
    mine = [(i, part.names[name]) for i, name in enumerate(free) if name in part.names]
    columns = [local] * (1 + nx) + [{**local, own: local[own] + DIFFERENCE * scale[i]} for i, own in mine]
    start = np.repeat(part.start[:, :, None], len(columns), axis=2)
    steps = DIFFERENCE * np.maximum(np.abs(part.start), 1.0)
    for i in range(nx):
        start[i, :, 1 + i] += steps[i]
    y = part.simulator.readings(columns, part.simulator.run(columns, start))
    e = errors(part, y[..., 0])
    by = np.stack([-(errors(part, y[..., j]) - e) for j in range(1, len(columns))], axis=-1)
    jx = np.nan_to_num(by[..., :nx] / steps.T[None, None])
    jp = np.zeros((*e.shape, m))
    for column, (i, _) in enumerate(mine):
        jp[..., i] = by[..., nx + column] / DIFFERENCE  # by the parameter in units of its size
    spread, count = start_spread(part), part.start.size
    pull = START_WEIGHT / count / spread**2
    xx = np.einsum("ncbi,ncbj->bij", jx, jx) + np.eye(nx) * pull.T[None]
    x = np.einsum("ncbi,ncb->bi", jx, e) - (pull * (part.start - part.anchor)).T
    return _Blocks(
        xx, np.einsum("ncbi,ncbj->bij", jx, jp), np.einsum("ncbi,ncbj->ij", jp, jp), x, np.einsum("ncbi,ncb->i", jp, e)
    )


def _step(
    blocks: Sequence[_Blocks], values: Mapping[str, float], free: Sequence[str], centre: Array, scale: Array,
    damping: float,
) -> tuple[Array, list[Array]]:  # fmt: skip
    """Parameters' step (m,), starts' steps (nx, b) of each stretch."""
    m = len(free)
    off = (np.array([values[name] for name in free]) - centre) / scale
    normal = np.eye(m) * PRIOR_WEIGHT / PRIOR_SIZE**2
    right = -PRIOR_WEIGHT / PRIOR_SIZE**2 * off
    solved: list[Array] = []
    for one in blocks:
        damped = one.xx + damping * _diagonals(one.xx)
        gain: Array = np.linalg.solve(damped, np.concatenate([one.xp, one.x[..., None]], axis=2))
        solved.append(gain)
        normal = normal + one.pp - np.einsum("bim,bin->mn", one.xp, gain[..., :m])
        right = right + one.p - np.einsum("bim,bi->m", one.xp, gain[..., m])
    normal = (normal + normal.T) / 2
    delta = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), right) if m else np.zeros(0)
    moves: list[Array] = [np.asarray((gain[..., m] - gain[..., :m] @ delta).T) for gain in solved]
    return delta * scale, moves


def _diagonals(a: Array) -> Array:
    out = np.zeros_like(a)
    i = np.arange(a.shape[1])
    out[:, i, i] = a[:, i, i]
    return out
