"""Errors of a linear grey box and their derivatives, by all that is searched: parameters, gain, initial states.

Errors of the predictor (or of the simulation) are filters of the data; their derivatives by the matrices are exact
filters, those of the matrices by the parameters central differences of the user's function.

Rules of this file: the variables z are the parameters, then K by rows where it is free, then the initial states by
experiment where they are estimated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.models import Innovations
from hoopd.ident.statespace import coordinates
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.sensitivities import Directions, Piece, sensitivities, trajectory
from hoopd.ident.statespace.step_sizes import difference_steps, variable_sizes

Array = NDArray[np.float64]

SLOW = 20.0
FAR = 1e6  # errors (in standard deviations of the output) of parameters whose predictor is not stable


@dataclass(frozen=True)
class Task:
    """What is fitted to what: the sampled innovation form of the parameters, the data, and what is searched."""

    constructor: Callable[[Array], Innovations]
    pieces: Sequence[Piece]
    dt: float
    count: int  # parameters
    free_gain: bool
    estimate: bool  # initial states
    fixed: tuple[Array, ...]  # initial states otherwise
    horizon: int
    simulation: bool
    regulariser: Callable[[Array, Innovations], Array] | None
    names: tuple[str, ...]
    sizes: Array  # of the parameters (count,), in their units


def parameter_sizes(constructor: Callable[[Array], Innovations], p: Array, bounds: tuple[Array, Array]) -> Array:
    """Sizes (count,) of parameters, by what they do to the matrices and to an initial state where they are small."""
    here = _blocks(constructor(p))

    def share(sets: Array) -> Array:
        return np.array([_share(here, _blocks(constructor(v))) for v in sets.T])

    return variable_sizes(share, p, bounds)


def _blocks(model: Innovations) -> list[Array]:
    start = np.zeros(0) if model.x0 is None else model.x0
    return [model.a, model.b, model.c, model.d, model.k, start]


def _share(before: Sequence[Array], after: Sequence[Array]) -> float:
    """The largest change of a block beside what it was; a block of zeros tells nothing."""
    pairs = [(np.linalg.norm(b - a), np.linalg.norm(a)) for a, b in zip(before, after, strict=True)]
    return max((float(change / size) for change, size in pairs if size > 0.0), default=0.0)


def sizes_of(task: Task, count: int) -> Array:
    """Sizes (count,) of all variables; of a gain and of initial states 1."""
    return np.concatenate([task.sizes, np.ones(count - task.count)])


def parts_of(task: Task, z: Array) -> tuple[Innovations, tuple[Array, ...]]:
    """Model and initial states of all variables."""
    model = task.constructor(z[: task.count])
    first = task.count
    if task.free_gain:
        model = replace(model, k=z[first : first + model.nx * model.ny].reshape(model.nx, model.ny))
        first += model.nx * model.ny
    if not task.estimate:
        return model, task.fixed
    return model, tuple(z[first + i * model.nx : first + (i + 1) * model.nx] for i in range(len(task.pieces)))


def allowed(task: Task, model: Innovations) -> bool:
    """Whether the matrices are finite and the predictor does not run away within the data."""
    finite = all(np.isfinite(one).all() for one in (model.a, model.b, model.c, model.d, model.k))
    # an error that grows less than SLOW-fold over the data is judged by the errors themselves, an integrator among them
    edge = 1.0 + np.log(SLOW) / max(one.n for one in task.pieces)
    return finite and (not model.k.any() or radius(model.a - model.k @ model.c) < edge)


def errors(task: Task, z: Array, weight: Array) -> Array:
    """Weighted errors of all experiments over the root of their number, then the regulariser's entries."""
    model, starts = parts_of(task, z)
    count = sum(one.y.size for one in task.pieces)
    if not allowed(task, model):
        return np.full(count + _extra(task, z, model), FAR)
    paths = [trajectory(model, one, x, task.horizon).ahead for one, x in zip(task.pieces, starts, strict=True)]
    out = np.concatenate([(weight @ e).ravel() for e in paths]) / np.sqrt(count)
    out = np.where(np.isfinite(out), out, FAR)
    return out if task.regulariser is None else np.concatenate([out, _penalty(task, z, model)])


def _penalty(task: Task, z: Array, model: Innovations) -> Array:
    assert task.regulariser is not None
    return np.atleast_1d(np.asarray(task.regulariser(z[: task.count], model), dtype=float))


def _extra(task: Task, z: Array, model: Innovations) -> int:
    return 0 if task.regulariser is None else len(_penalty(task, z, model))


def slope(task: Task, z: Array, weight: Array) -> Array:
    """Derivatives (rows, variables) of `errors`."""
    model, starts = parts_of(task, z)
    along = _directions(task, z, model)
    count = sum(one.y.size for one in task.pieces)
    blocks, m = [], along.count
    for i, (one, x) in enumerate(zip(task.pieces, starts, strict=True)):
        change = sensitivities(model, one, trajectory(model, one, x, task.horizon), along, task.horizon)
        flat = np.tensordot(weight, change, 1).transpose(0, 2, 1).reshape(-1, m) / np.sqrt(count)
        rows = np.zeros((len(flat), len(z)))
        shared = m - model.nx if task.estimate else m
        rows[:, :shared] = flat[:, :shared]
        if task.estimate:
            rows[:, shared + i * model.nx : shared + (i + 1) * model.nx] = flat[:, shared:]
        blocks.append(rows)
    whole = np.vstack(blocks)
    if task.regulariser is None:
        return whole
    return np.vstack(
        [whole, _differences(lambda v: _penalty(task, v, parts_of(task, v)[0]), z, sizes_of(task, len(z)))]
    )


def _differences(of: Callable[[Array], Array], z: Array, sizes: Array) -> Array:
    columns = []
    for step in np.diag(difference_steps(z, sizes)):
        columns.append((of(z + step) - of(z - step)) / (2.0 * step.sum()))
    return np.stack(columns, axis=1)


def _directions(task: Task, z: Array, model: Innovations) -> Directions:
    """What each parameter does to the matrices, then the free gain's entries, then the initial state's."""
    p = z[: task.count]

    def full(v: Array) -> Array:
        return np.concatenate([coordinates.values(task.constructor(v)), _own_start(task, v)])

    change = _differences(full, p, task.sizes)
    size = len(coordinates.values(model))
    along = coordinates.directions(model, change[:size])
    along = replace(along, x0=change[size:].T) if not task.estimate and len(change) > size else along
    if task.free_gain:
        along = replace(along, k=np.zeros_like(along.k))
        along = coordinates.joined(along, coordinates.directions(model, np.eye(size)[:, size - model.k.size :]))
    return coordinates.joined(along, coordinates.starts(model)) if task.estimate else along


def _own_start(task: Task, p: Array) -> Array:
    """Initial states that the user's function gives may depend on the parameters."""
    x0 = task.constructor(p).x0
    return np.zeros(0) if x0 is None else x0


def paths_of(task: Task, z: Array) -> list[Array]:
    """Errors (ny, n) by experiment."""
    model, starts = parts_of(task, z)
    return [trajectory(model, one, x, task.horizon).ahead for one, x in zip(task.pieces, starts, strict=True)]


def _power(task: Task) -> Array:
    return np.asarray(
        sum(np.sum(one.y**2, axis=1) for one in task.pieces) / sum(one.known.sum(axis=1) for one in task.pieces)
    )


def variance_of(task: Task, paths: Sequence[Array]) -> Array:
    """Mean squared error by output (ny,), of the samples that were measured."""
    return np.asarray(sum(np.sum(e**2, axis=1) for e in paths) / sum(one.known.sum(axis=1) for one in task.pieces))


def weight_of(task: Task, paths: Sequence[Array] | None) -> Array:
    """Diagonal: outputs by their power first, then by their errors, of the same overall size."""
    power = _power(task)
    if paths is None:
        return np.diag(1.0 / np.sqrt(power))
    share = np.maximum(variance_of(task, paths) / power, 1e-18)
    return np.diag(np.sqrt(np.exp(np.mean(np.log(share))) / share / power))
