"""The parameters that simulate best: output-error refinement of a hypothesis on free runs.

Starts of all windows are eliminated (variable projection, Golub and Pereyra 1973), parameters move by damped
Gauss-Newton steps. A long run forgives no error on its way: windows grow from two seconds to the whole stretch, and the
starts of longer ones are the states that the shorter ones had there.

Rules of this file: the criterion is the measure of `tables` (each channel's error over its spread); a hypothesis is
named elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.engine.dataset import Stretch
from hoopd.diagnose.proof.simulation import LARGEST, Simulated, Simulator, Windows, windows_of
from hoopd.physics.effects.base import Effect

Array = NDArray[np.float64]

# Lengths of the windows, one after the other; None: the whole stretch.
LENGTHS_S: tuple[float | None, ...] = (2.0, 5.0, None)
MOST_STEPS = 12
# A search ends when a step lowers the cost by less than this share.
SETTLED = 1e-4
DAMPING, EASIER, HARDER, MOST_DAMPING = 1e-3, 0.2, 6.0, 1e6
# Finite differences, relative to a parameter's size.
DIFFERENCE = 1e-5
# Starts stay near what the smoother says, within these (rad or m, rad/s or m/s) times the weight below.
START_SPREAD = (0.1, 2.0)
START_WEIGHT = 1e-4
# Prior of a parameter, of so many times its size: what the runs say nothing about stays where it is.
PRIOR_SIZE, PRIOR_WEIGHT = 3.0, 1e-4


@dataclass
class Refined:
    """A hypothesis on free runs."""

    values: dict[str, float]
    free: tuple[str, ...]
    runs: list[Simulated]
    cost: float  # sum over channels of |y - yhat|^2 / |y - mean y|^2, mean over the recordings
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def deviation(self, name: str) -> float:
        """Standard error of a free parameter."""
        i = self.free.index(name)
        return float(np.sqrt(max(self.covariance[i, i], 0.0)))


@dataclass
class Part:
    """One stretch on its way: windows, simulator, starts (nx, b)."""

    stretch: Stretch
    windows: Windows
    simulator: Simulator
    start: Array
    anchor: Array
    weight: Array  # (nc,) one over a channel's |y - mean y|
    names: dict[str, str]  # free parameter -> its name in this stretch
    states: Array | None = None

    def local(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of this stretch: those of its recording go before those of all."""
        return local_values(self.simulator, values)


def local_values(simulator: Simulator, values: Mapping[str, float]) -> dict[str, float]:
    """Values in one stretch: those of its recording go before those of all."""
    mark = f"@{simulator.windows.stretch.recording}"
    own = {name.removesuffix(mark): value for name, value in values.items() if name.endswith(mark)}
    return {**simulator.composite.values, **{n: v for n, v in values.items() if "@" not in n}, **own}


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
        here, cost, covariance = _search(parts, here, tuple(free), effects, settled)
        starts = [_states(part, here) for part in parts]
    runs = [_simulated(part, here) for part in parts]
    return Refined(here, tuple(free), runs, cost, covariance)


def channel_weights(stretches: Sequence[Stretch]) -> list[Array]:
    """(nc,) of each stretch: one over |y - mean y| of the channel in its recording; 0 for a channel without a vote.

    An angle that has a measured rate beside it counts by its slope, and the measured rate itself is not asked.
    """
    return [
        np.array([_weight([one for one in stretches if one.recording == s.recording], c) for c in s.plant.channels])
        for s in stretches
    ]


def _weight(same: Sequence[Stretch], channel: str) -> float:
    plant = same[0].plant
    if _asked_by_its_angle(plant.channels, channel):
        return 0.0
    column = list(plant.channels).index(channel)
    parts = [_signal(one.t, one.y[:, column], _turns(plant.channels, channel)) for one in same]
    seen = np.concatenate([part[np.isfinite(part)] for part in parts])
    spread = float(np.linalg.norm(seen - seen.mean())) if len(seen) > 2 else 0.0
    return 1.0 / spread if spread > 1e-9 else 0.0


def _turns(channels: Mapping[str, str], channel: str) -> bool:
    return f"d{channels[channel]}" in channels.values()


def _asked_by_its_angle(channels: Mapping[str, str], channel: str) -> bool:
    state = channels[channel]
    return state.startswith("d") and state[1:] in channels.values()


def _signal(t: Array, y: Array, turns: bool) -> Array:
    """What is compared of (n, ...): the reading, or its slope between the neighbours."""
    if not turns:
        return y
    out = np.full_like(y, np.nan)
    span = (t[2:] - t[:-2]).reshape(-1, *([1] * (y.ndim - 1)))
    out[1:-1] = (y[2:] - y[:-2]) / span
    return out


def part_of(
    stretch: Stretch,
    reference: Array,
    effects: Sequence[Effect],
    weight: Array,
    free: Sequence[str],
    length: float | None,
) -> Part:
    windows = windows_of(stretch, length)
    simulator = Simulator(windows, effects)
    nx = simulator.composite.nx
    wide = np.zeros((len(reference), nx))
    known = min(nx, reference.shape[1])
    wide[:, :known] = reference[:, :known]
    start = wide[windows.first].T.copy()
    mark = f"@{stretch.recording}"
    mine = {n: n.removesuffix(mark) for n in free if n.endswith(mark) or "@" not in n}
    names = {n: own for n, own in mine.items() if own in simulator.composite.names}
    return Part(stretch, windows, simulator, start, start.copy(), weight, names)


# ---------------------------------------------------------------------------------------------- search


def _search(
    parts: list[Part], values: dict[str, float], free: tuple[str, ...], effects: Sequence[Effect], settled: float
) -> tuple[dict[str, float], float, Array]:
    """Levenberg-Marquardt on parameters and starts."""
    scale = sizes(values, free, effects)
    centre = np.array([values[name] for name in free])
    damping, cost = DAMPING, _cost(parts, values, [part.start for part in parts], free, centre, scale)
    information = np.eye(len(free))
    for _ in range(MOST_STEPS):
        blocks = [_blocks(part, values, free, scale) for part in parts]
        before = cost
        while damping < MOST_DAMPING:
            delta, moves, information = _step(blocks, values, free, centre, scale, damping)
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
    return values, cost, _covariance(parts, information, scale, cost)


def sizes(values: Mapping[str, float], free: Sequence[str], effects: Sequence[Effect]) -> Array:
    """(m,) usual size of each free parameter."""
    own = {e.key(p.name): p for e in effects for p in e.parameters}
    out = []
    for name in free:
        p = own.get(name.split("@")[0])
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
        low, high = ranges.get(name.split("@")[0], (-np.inf, np.inf))
        out[name] = float(np.clip(values[name] + step, low, high))
    return out


def errors_of(windows: Windows, weight: Array, y: Array) -> Array:
    """(n, nc, b) weighted; 0 where nothing was measured."""
    # a run that left every bound is as bad as can be, not as good as none
    finite = np.clip(np.nan_to_num(y, nan=LARGEST), -1e6, 1e6)
    return np.asarray(np.nan_to_num(_compared(windows, weight, windows.y) - _compared(windows, weight, finite)))


def _compared(w: Windows, weight: Array, y: Array) -> Array:
    """Weighted signals of (n, nc, b)."""
    nodes = np.minimum(w.first + np.arange(w.length)[:, None], len(w.stretch.t) - 1)
    channels = w.stretch.plant.channels
    seen = np.isfinite(w.y)
    out = np.full(y.shape, np.nan)
    for column, channel in enumerate(channels):
        if weight[column] == 0.0:
            continue
        one = np.where(seen[:, column], y[:, column], np.nan)
        if _turns(channels, channel):
            span = w.stretch.t[nodes[2:]] - w.stretch.t[nodes[:-2]]
            slope = np.full(one.shape, np.nan)
            slope[1:-1] = (one[2:] - one[:-2]) / np.maximum(span, 1e-9)
            one = slope
        out[:, column] = weight[column] * one
    return out


def _cost(
    parts: Sequence[Part], values: Mapping[str, float], starts: Sequence[Array], free: Sequence[str], centre: Array,
    scale: Array,
) -> float:  # fmt: skip
    total = 0.0
    for part, start in zip(parts, starts, strict=True):
        local = part.local(values)
        y = part.simulator.readings(local, part.simulator.run(local, start[:, :, None]))[..., 0]
        off = (start - part.anchor) / _spread(part)
        total += (
            float(np.sum(errors_of(part.windows, part.weight, y) ** 2))
            + START_WEIGHT * float(np.sum(off**2)) / off.size
        )
    off = (np.array([values[name] for name in free]) - centre) / (PRIOR_SIZE * scale)
    return total + PRIOR_WEIGHT * float(off @ off)


def _spread(part: Part) -> Array:
    """(nx, 1)"""
    nx = len(part.start)
    return np.array([START_SPREAD[i % 2] for i in range(nx)])[:, None]


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
    e = errors_of(part.windows, part.weight, y[..., 0])
    by = np.stack([-(errors_of(part.windows, part.weight, y[..., j]) - e) for j in range(1, len(columns))], axis=-1)
    jx = np.nan_to_num(by[..., :nx] / steps.T[None, None])
    jp = np.zeros((*e.shape, m))
    for column, (i, _) in enumerate(mine):
        jp[..., i] = by[..., nx + column] / DIFFERENCE  # by the parameter in units of its size
    spread, count = _spread(part), part.start.size
    pull = START_WEIGHT / count / spread**2
    xx = np.einsum("ncbi,ncbj->bij", jx, jx) + np.eye(nx) * pull.T[None]
    x = np.einsum("ncbi,ncb->bi", jx, e) - (pull * (part.start - part.anchor)).T
    return _Blocks(
        xx, np.einsum("ncbi,ncbj->bij", jx, jp), np.einsum("ncbi,ncbj->ij", jp, jp), x, np.einsum("ncbi,ncb->i", jp, e)
    )


def _step(
    blocks: Sequence[_Blocks], values: Mapping[str, float], free: Sequence[str], centre: Array, scale: Array,
    damping: float,
) -> tuple[Array, list[Array], Array]:  # fmt: skip
    """Parameters' step (m,), starts' steps (nx, b) of each stretch, and the information on the parameters."""
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
    return delta * scale, moves, normal


def _diagonals(a: Array) -> Array:
    out = np.zeros_like(a)
    i = np.arange(a.shape[1])
    out[:, i, i] = a[:, i, i]
    return out


def _covariance(parts: Sequence[Part], information: Array, scale: Array, cost: float) -> Array:
    """Of the parameters, from the residual's own variance; windows are taken as independent, samples as correlated."""
    inverse = np.linalg.pinv(information, hermitian=True) if len(scale) else np.zeros((0, 0))
    windows = max(sum(part.start.shape[1] for part in parts), 1)
    return np.asarray(inverse * np.outer(scale, scale) * cost / max(windows, 1))


def _states(part: Part, values: Mapping[str, float]) -> Array:
    """(nodes, nx) what the windows had at every node of the stretch."""
    states = part.simulator.run(part.local(values), part.start[:, :, None])[..., 0]
    nx, w = len(part.start), part.windows
    out = np.empty((len(part.stretch.t), nx))
    for b, (first, count) in enumerate(zip(w.first, w.count, strict=True)):
        out[first : first + count] = states[:count, :nx, b]
    return out


def _simulated(part: Part, values: Mapping[str, float]) -> Simulated:
    local = part.local(values)
    states = part.simulator.run(local, part.start[:, :, None])
    return Simulated(part.windows, part.start, part.simulator.readings(local, states)[..., 0], states[..., 0])
