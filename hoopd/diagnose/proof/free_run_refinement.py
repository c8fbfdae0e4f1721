"""The parameters that simulate best: output-error refinement of a hypothesis on free runs.

Starts of all windows are eliminated, parameters move by damped least squares (`hoopd.ident.damped_least_squares`).
A long run forgives no error on its way: windows grow from two seconds to the whole stretch, and the
starts of longer ones are the states that the shorter ones had there.

Rules of this file: the criterion is the measure of `tables` (each channel's error over its spread); a hypothesis is
named elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

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
    usual_sizes,
)
from hoopd.diagnose.proof.window_lengths import growth_of
from hoopd.ident.damped_least_squares import Damping, Ends, Starts, StartsEliminated, minimise
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, ranges_of
from hoopd.plants.likelihood.recording_parameters import plain
from hoopd.plants.likelihood.stretch_scatter import StretchShare
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.scales import LEAST_SIZE, parameter_size

Array = NDArray[np.float64]

# Lengths of the windows, one after the other; None: the whole stretch. Of what moves away by itself the first alone.
LENGTHS_S: tuple[float | None, ...] = (2.0, 5.0, None)
MOST_STEPS = 12
# A search ends when a step lowers the cost by less than this share.
SETTLED = 1e-4
DAMPING = Damping(first=1e-3, easier=0.2, harder=6.0, least=1e-9, most=1e6)
# Finite differences, relative to a parameter's size.
DIFFERENCE = 1e-5
# Starts stay near what the smoother says: START_SPREAD counts as little as this.
START_WEIGHT = 1e-4
# Prior of a parameter, of so many times its size: what the runs say nothing about stays where it is.
PRIOR_SIZE, PRIOR_WEIGHT = 3.0, 1e-4


@dataclass(frozen=True)
class Pull:
    """Parameters drawn to values that are believed: weight (value - centre)^2 / size^2 each, added to the cost."""

    centre: Mapping[str, float]
    size: Mapping[str, float]
    weight: float


@dataclass
class Refined:
    """A hypothesis on free runs."""

    values: dict[str, float]
    free: tuple[str, ...]
    runs: list[Simulated]
    cost: float  # sum of |y - yhat|^2 / |y - mean y|^2 over channels and recordings, with what starts and prior add
    parts: list[Part] = field(default_factory=list)  # of which the runs are made, with the starts that were found


def refine(
    stretches: Sequence[Stretch],
    references: Sequence[Array],
    effects: Sequence[Effect],
    values: Mapping[str, float],
    free: Sequence[str],
    lengths_s: Sequence[float | None] = LENGTHS_S,
    settled: float = SETTLED,
    drawn: Pull | None = None,
) -> Refined:
    """The hypothesis with the free parameters that simulate best; references (nodes, nx or more): a smoother's;
    `drawn`: to where they are drawn beside the runs' error, which counts in `cost`."""
    here, starts = dict(values), list(references)
    weights = channel_weights(stretches)
    parts: list[Part] = []
    falls = any(growth_of(one.plant) > 0.0 for one in stretches)
    for length in lengths_s[:1] if falls else lengths_s:
        parts = [part_of(s, r, effects, w, free, length) for s, r, w in zip(stretches, starts, weights, strict=True)]
        here, cost = _search(parts, here, tuple(free), effects, settled, drawn)
        starts = [node_states(part, here) for part in parts]
    runs = [simulated(part, here) for part in parts]
    return Refined(here, tuple(free), runs, cost, parts)


def window_pieces(found: Refined, scale: Array) -> list[StretchShare]:
    """Share of each window in the normal equations of the parameters, these in units of `scale` (m,)."""
    pieces = []
    for part in found.parts:
        pp, p, (ss, sp, s) = _equations(part, part.start, found.values, found.free, scale)
        by_start = np.linalg.solve(ss, sp)
        information = pp - np.einsum("bnm,bnk->bmk", sp, by_start)
        slope = p - np.einsum("bnm,bn->bm", by_start, s)
        # a piece's slope is that of the likelihood, which grows where the squares fall
        pieces += [StretchShare(*each) for each in zip(information, -slope, strict=True)]
    return pieces


# ---------------------------------------------------------------------------------------------- search


@dataclass(frozen=True)
class _Point:
    """Parameters, starts of every part (nx, b), cost."""

    values: dict[str, float]
    starts: list[Array]
    cost: float


def _search(
    parts: list[Part],
    values: dict[str, float],
    free: tuple[str, ...],
    effects: Sequence[Effect],
    settled: float,
    drawn: Pull | None,
) -> tuple[dict[str, float], float]:
    """Parameters and starts of least cost; the parts keep the starts."""
    plants = [part.stretch.plant for part in parts]
    scale, bounds = sizes(values, free, effects, plants), _bounds(effects, plants)
    centre, pull = _pulls(values, free, scale, drawn)

    def at(values: dict[str, float], starts: list[Array]) -> _Point:
        return _Point(values, starts, _cost(parts, values, starts, free, centre, pull / scale**2))

    def linearised(point: _Point) -> StartsEliminated:
        off = (np.array([point.values[name] for name in free]) - centre) / scale
        normal, slope, groups = np.diag(pull), pull * off, []
        for part, start in zip(parts, point.starts, strict=True):
            pp, p, group = _equations(part, start, point.values, free, scale)
            normal, slope = normal + pp.sum(axis=0), slope + p.sum(axis=0)
            groups.append(group)
        return StartsEliminated(normal, slope, groups)

    def moved(point: _Point, step: tuple[Array, list[Array]]) -> _Point:
        starts = [start + move.T for start, move in zip(point.starts, step[1], strict=True)]
        return at(_moved(point.values, free, step[0] * scale, bounds), starts)

    first = at(values, [part.start for part in parts])
    if not np.isfinite(first.cost):  # there is no such plant here: no step could be called better
        return values, first.cost
    found = minimise(first, linearised, moved, DAMPING, Ends(MOST_STEPS, gain=settled))
    for part, start in zip(parts, found.point.starts, strict=True):
        part.start = start
    return found.point.values, found.point.cost


def sizes(
    values: Mapping[str, float], free: Sequence[str], effects: Sequence[Effect], plants: Sequence[Plant]
) -> Array:
    """(m,) usual size of each free parameter."""
    own = {e.key(p.name): p for e in effects for p in e.parameters}
    usual = {name: parameter_size(plant, name) for plant in plants for name in plant.values}
    out = []
    for name in free:
        p = own.get(plain(name))
        size = usual.get(name, LEAST_SIZE) if p is None else (1.0 if p.role == "phase" else abs(p.size))
        out.append(max(abs(values[name]), size))
    return np.array(out)


def _pulls(values: Mapping[str, float], free: Sequence[str], scale: Array, drawn: Pull | None) -> tuple[Array, Array]:
    """(m,) where each parameter is drawn to, and how strongly (m,), in units of `scale`: to where it begins where
    nothing is believed."""
    centre = np.array([values[name] for name in free], dtype=float)
    pull = np.full(len(free), PRIOR_WEIGHT / PRIOR_SIZE**2)
    for i, name in enumerate(free if drawn is not None else ()):
        if drawn is not None and name in drawn.size:
            centre[i] = drawn.centre[name]
            pull[i] = drawn.weight * (scale[i] / drawn.size[name]) ** 2
    return centre, pull


Bounds = Mapping[str, tuple[float, float]]


def _bounds(effects: Sequence[Effect], plants: Sequence[Plant]) -> Bounds:
    """By name, of the plants and of effects; phases go round."""
    return {name: ends for plant in plants for name, ends in plant.bounds.items()} | ranges_of(effects)


def _moved(values: Mapping[str, float], free: Sequence[str], delta: Array, bounds: Bounds) -> dict[str, float]:
    """Values after a step, within their ranges."""
    out = dict(values)
    for name, step in zip(free, delta, strict=True):
        low, high = bounds.get(plain(name), (-np.inf, np.inf))
        out[name] = float(np.clip(values[name] + step, low, high))
    return out


def _cost(
    parts: Sequence[Part], values: Mapping[str, float], starts: Sequence[Array], free: Sequence[str], centre: Array,
    pull: Array,
) -> float:  # fmt: skip
    total = 0.0
    for part, start in zip(parts, starts, strict=True):
        local = part.local(values)
        y = part.simulator.readings(local, part.simulator.run(local, start[:, :, None]))[..., 0]
        off = (start - part.anchor) / start_spread(part)
        total += float(np.sum(errors(part, y) ** 2)) + START_WEIGHT * float(np.sum(off**2)) / off.size
    off = np.array([values[name] for name in free]) - centre
    return total + float(pull @ off**2)


def _equations(
    part: Part, begin: Array, values: Mapping[str, float], free: Sequence[str], scale: Array
) -> tuple[Array, Array, Starts]:
    """Of one stretch from the starts `begin` (nx, b): J'J (b, m, m) and J'e (b, m) of the parameters, window by window,
    and the starts'."""
    nx = len(begin)
    local, m = part.local(values), len(free)
    mine = [(i, part.names[name]) for i, name in enumerate(free) if name in part.names]
    columns = [local] * (1 + nx) + [{**local, own: local[own] + DIFFERENCE * scale[i]} for i, own in mine]
    start = np.repeat(begin[:, :, None], len(columns), axis=2)
    steps = DIFFERENCE * np.maximum(np.abs(begin), usual_sizes(part))
    for i in range(nx):
        start[i, :, 1 + i] += steps[i]
    y = part.simulator.readings(columns, part.simulator.run(columns, start))
    e = errors(part, y[..., 0])
    by = np.stack([-(errors(part, y[..., j]) - e) for j in range(1, len(columns))], axis=-1)
    jx = np.nan_to_num(by[..., :nx] / steps.T[None, None])
    jp = np.zeros((*e.shape, m))
    for column, (i, _) in enumerate(mine):
        jp[..., i] = by[..., nx + column] / DIFFERENCE  # by the parameter in units of its size
    spread, count = start_spread(part), begin.size
    pull = START_WEIGHT / count / spread**2
    xx = np.einsum("ncbi,ncbj->bij", jx, jx) + np.eye(nx) * pull.T[None]
    x = (pull * (begin - part.anchor)).T - np.einsum("ncbi,ncb->bi", jx, e)
    starts = Starts(xx, np.einsum("ncbi,ncbj->bij", jx, jp), x)
    return np.einsum("ncbi,ncbj->bij", jp, jp), -np.einsum("ncbi,ncb->bi", jp, e), starts
