"""Errors of a linear model between static maps, and their derivatives by all that is fitted.

Derivatives of the linear part are exact filters, those of the maps central differences.

Rules of this file: time runs along the last axis; unknowns are the coordinates of the matrices, then the initial states
by experiment, then the parameters p of the maps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.models import Innovations
from hoopd.ident.statespace import coordinates
from hoopd.ident.statespace.coloured import shaped
from hoopd.ident.statespace.coordinates import Freedom
from hoopd.ident.statespace.linear import radius, states
from hoopd.ident.statespace.sensitivities import Directions, Piece
from hoopd.ident.statespace.step_sizes import NEAR, variable_sizes

Array = NDArray[np.float64]
Static = Callable[[Array, Array], Array]

STEP = 1e-6  # of the central differences of the maps, in the units of their arguments' size


@dataclass(frozen=True)
class HammersteinTask:
    """The data, the maps g of the input and h of the output, what of the matrices is free, what an output counts."""

    pieces: Sequence[Piece]
    g: Static
    h: Static
    free: Freedom
    weight: Array  # (ny,) of the outputs' errors
    sizes: Array  # of the parameters of the maps, in their units


@dataclass(frozen=True)
class Path:
    """One experiment through the model: behind the input map, states, before the output map, errors."""

    v: Array
    x: Array
    z: Array
    e: Array


@dataclass(frozen=True)
class SearchPoint:
    """Values of all unknowns, what they give, the sum of squared weighted errors; `ended`: no step makes it less."""

    model: Innovations
    p: Array
    starts: tuple[Array, ...]
    paths: tuple[Path, ...]
    cost: float
    ended: bool = True


def same(signal: Array, p: Array) -> Array:
    """The map that does nothing."""
    return signal


def evaluated(task: HammersteinTask, model: Innovations, p: Array, starts: tuple[Array, ...] | None) -> SearchPoint:
    """The point of these values (from rest where no states are given); an infinite cost where the model runs away."""
    own = starts if starts is not None else tuple(np.zeros(model.nx) for _ in task.pieces)
    if radius(model.a) >= 1.0 + 1e-9:
        return SearchPoint(model, p, own, (), np.inf)
    with np.errstate(all="ignore"):
        paths = tuple(_path(task, one, model, p, x) for one, x in zip(task.pieces, own, strict=True))
    cost = float(sum(np.sum(np.square(task.weight[:, None] * one.e)) for one in paths))
    return SearchPoint(model, p, own, paths, cost if np.isfinite(cost) else np.inf)


def _path(task: HammersteinTask, data: Piece, model: Innovations, p: Array, x0: Array) -> Path:
    v = np.asarray(task.g(data.u, p), dtype=float)
    if not model.k.any():
        x = states(model.a, model.b @ v, x0)
        z = model.c @ x + model.d @ v
        return Path(v, x, z, (data.y - task.h(z, p)) * data.known)
    x, z, e, now = np.empty((model.nx, data.n)), np.empty(data.y.shape), np.empty(data.y.shape), x0
    driven, direct = model.b @ v, model.d @ v
    for i in range(data.n):
        x[:, i] = now
        z[:, i] = model.c @ now + direct[:, i]
        e[:, i] = (data.y[:, i] - task.h(z[:, i : i + 1], p)[:, 0]) * data.known[:, i]
        now = model.a @ now + driven[:, i] + model.k @ e[:, i]
    return Path(v, x, z, e)


def weighted_by(task: HammersteinTask, point: SearchPoint | None) -> HammersteinTask:
    """The task with every output counted by its size, or by that of its errors at a point; one output as it is."""
    if len(task.weight) == 1:
        return task
    known = np.maximum(sum(one.known.sum(axis=1) for one in task.pieces), 1)
    power = np.maximum(np.asarray(sum(np.sum(one.y**2, axis=1) for one in task.pieces)) / known, 1e-300)
    if point is None:
        return replace(task, weight=1.0 / np.sqrt(power))
    errors = np.asarray(sum(np.sum(one.e**2, axis=1) for one in point.paths)) / known
    return replace(task, weight=1.0 / np.sqrt(np.maximum(errors, 1e-18 * power)))


def normal_equations(task: HammersteinTask, point: SearchPoint, columns: Array) -> tuple[Array, Array]:
    """Gradient and Gram over the model's coordinates, the initial states by experiment, and p."""
    total = _unknowns(task, point, columns)
    gradient, gram = np.zeros(total), np.zeros((total, total))
    for own, change, e in _derivatives(task, point, columns):
        j = change.transpose(1, 0, 2).reshape(len(own), -1)
        gradient[own] += j @ e.ravel()
        gram[np.ix_(own, own)] += j @ j.T
    return gradient, gram


def gradient_covariance(task: HammersteinTask, point: SearchPoint, columns: Array, noise: tuple[Array, Array]) -> Array:
    """J'SJ over the same, S the covariance of the weighted errors that `noise` describes (`coloured`)."""
    total = np.zeros((_unknowns(task, point, columns),) * 2)
    for own, change, _ in _derivatives(task, point, columns):
        score = shaped(change, *noise)
        total[np.ix_(own, own)] += score @ score.T
    return total


def _unknowns(task: HammersteinTask, point: SearchPoint, columns: Array) -> int:
    return int(columns.shape[1]) + point.model.nx * len(task.pieces) + len(point.p)


def _derivatives(
    task: HammersteinTask, point: SearchPoint, columns: Array
) -> Iterator[tuple[NDArray[np.intp], Array, Array]]:
    """By experiment: which unknowns, the derivatives (ny, unknowns, n) of its weighted errors, and these (ny, n)."""
    m, nx, count, total = columns.shape[1], point.model.nx, len(point.p), _unknowns(task, point, columns)
    along = coordinates.joined(coordinates.directions(point.model, columns), coordinates.starts(point.model))
    for i, (data, path) in enumerate(zip(task.pieces, point.paths, strict=True)):
        own = np.concatenate([np.arange(m), m + i * nx + np.arange(nx), total - count + np.arange(count)])
        change = _change(task, data, point, path, along) * task.weight[:, None, None]
        yield own, change, task.weight[:, None] * path.e


def _change(task: HammersteinTask, data: Piece, point: SearchPoint, path: Path, along: Directions) -> Array:
    """de (ny, directions + p, n)."""
    model, p = point.model, point.p
    slope = _slope(task.h, path.z, p)  # (ny, ny, n) of the output map by its signal
    of_p = _by_parameters(task.h, path.z, p, task.sizes)  # (ny, count, n)
    dv = _by_parameters(task.g, data.u, p, task.sizes)
    seen = np.concatenate(
        [_on(along.c, path.x) + _on(along.d, path.v), np.tensordot(model.d, dv, 1)], axis=1
    )  # of z, before the state's share
    push = np.concatenate(
        [_on(along.a, path.x) + _on(along.b, path.v) + _on(along.k, path.e), np.tensordot(model.b, dv, 1)], axis=1
    )
    static = np.einsum("yzn,zmn->ymn", slope, seen)
    static[:, along.count :] += of_p
    start = np.concatenate([along.x0.T, np.zeros((model.nx, len(p)))], axis=1)
    known = data.known[:, None, :]
    if not model.k.any():
        dx = states(model.a, push, start)
    else:
        dx = _varying(model, push - np.tensordot(model.k, static * known, 1), slope * known, start)
    return np.asarray(-(np.einsum("yzn,zmn->ymn", slope, np.tensordot(model.c, dx, 1)) + static) * known)


def _varying(model: Innovations, push: Array, slope: Array, start: Array) -> Array:
    dx, now = np.empty_like(push), start
    for i in range(push.shape[-1]):
        dx[:, :, i] = now
        now = (model.a - model.k @ slope[:, :, i] @ model.c) @ now + push[:, :, i]
    return dx


def _on(matrices: Array, signals: Array) -> Array:
    m, rows, s = matrices.shape
    return np.asarray((matrices.transpose(1, 0, 2).reshape(rows * m, s) @ signals).reshape(rows, m, -1))


def _slope(of: Static, z: Array, p: Array) -> Array:
    """(rows, channels, n): derivative of a map by its signal."""
    if of is same:
        return np.repeat(np.eye(len(z))[:, :, None], z.shape[1], axis=2)
    columns: list[Array] = []
    for i in range(len(z)):
        h = STEP * max(float(np.abs(z[i]).max(initial=0.0)), 1e-9)
        step = np.zeros((len(z), 1))
        step[i] = h
        columns.append((of(z + step, p) - of(z - step, p)) / (2.0 * h))
    return np.asarray(np.stack(columns, axis=1))


def _by_parameters(of: Static, z: Array, p: Array, sizes: Array) -> Array:
    """(rows, count, n): derivative of a map by its parameters."""
    if of is same or not len(p):
        return np.zeros((len(z), len(p), z.shape[1]))
    steps = STEP * np.maximum(np.abs(p), NEAR * sizes)
    sides = [(of(z, p + h * unit), of(z, p - h * unit), h) for h, unit in zip(steps, np.eye(len(p)), strict=True)]
    return np.stack([(np.asarray(up) - np.asarray(down)) / (2.0 * h) for up, down, h in sides], axis=1)


def parameter_sizes(task: HammersteinTask, p: Array) -> Array:
    """Sizes (count,) of the maps' parameters, by what they do to the maps where they are small."""
    signals = [(task.g, task.pieces[0].u), (task.h, task.pieces[0].y)]
    here = [(of, z, np.asarray(of(z, p), dtype=float)) for of, z in signals if of is not same]
    far = np.full(len(p), np.inf)

    def changed(v: Array) -> float:
        shares = [np.linalg.norm(of(z, v) - y) / np.linalg.norm(y) for of, z, y in here if y.any()]
        return max(map(float, shares), default=0.0)

    return variable_sizes(lambda sets: np.array([changed(v) for v in sets.T]), p, (-far, far))
