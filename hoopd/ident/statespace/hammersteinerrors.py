"""Errors of a linear model between static maps, and their derivatives by all that is fitted.

Derivatives of the linear part are exact filters, those of the maps central differences.

Rules of this file: time runs along the last axis; unknowns are the coordinates of the matrices, then the initial states
by experiment, then the parameters p of the maps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.models import Innovations
from hoopd.ident.statespace import coordinates
from hoopd.ident.statespace.coordinates import Freedom
from hoopd.ident.statespace.linear import radius, states
from hoopd.ident.statespace.sensitivities import Directions, Piece

Array = NDArray[np.float64]
Static = Callable[[Array, Array], Array]

STEP = 1e-6  # of the central differences of the maps, in the units of their arguments' size


@dataclass(frozen=True)
class HammersteinTask:
    """The data, the maps g of the input and h of the output, and what of the matrices is free."""

    pieces: Sequence[Piece]
    g: Static
    h: Static
    free: Freedom


@dataclass(frozen=True)
class Path:
    """One experiment through the model: behind the input map, states, before the output map, errors."""

    v: Array
    x: Array
    z: Array
    e: Array


@dataclass(frozen=True)
class SearchPoint:
    """Values of all unknowns, what they give, and the sum of squared errors; `ended`: no step makes it less."""

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
    cost = float(sum(np.vdot(one.e, one.e) for one in paths))
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


def normal_equations(task: HammersteinTask, point: SearchPoint, columns: Array) -> tuple[Array, Array]:
    """Gradient and Gram over the model's coordinates, the initial states by experiment, and p."""
    m, nx, count = columns.shape[1], point.model.nx, len(point.p)
    total = m + nx * len(task.pieces) + count
    gradient, gram = np.zeros(total), np.zeros((total, total))
    along = coordinates.joined(coordinates.directions(point.model, columns), coordinates.starts(point.model))
    for i, (data, path) in enumerate(zip(task.pieces, point.paths, strict=True)):
        j = _change(task, data, point, path, along).transpose(1, 0, 2).reshape(m + nx + count, -1)
        own = np.concatenate([np.arange(m), m + i * nx + np.arange(nx), total - count + np.arange(count)])
        gradient[own] += j @ path.e.ravel()
        gram[np.ix_(own, own)] += j @ j.T
    return gradient, gram


def _change(task: HammersteinTask, data: Piece, point: SearchPoint, path: Path, along: Directions) -> Array:
    """de (ny, directions + p, n)."""
    model, p = point.model, point.p
    slope = _slope(task.h, path.z, p)  # (ny, ny, n) of the output map by its signal
    of_p = _by_parameters(task.h, path.z, p)  # (ny, count, n)
    dv = _by_parameters(task.g, data.u, p)
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


def _by_parameters(of: Static, z: Array, p: Array) -> Array:
    """(rows, count, n): derivative of a map by its parameters."""
    if of is same or not len(p):
        return np.zeros((len(z), len(p), z.shape[1]))
    steps = STEP * np.maximum(np.abs(p), 1e-3)
    sides = [(of(z, p + h * unit), of(z, p - h * unit), h) for h, unit in zip(steps, np.eye(len(p)), strict=True)]
    return np.stack([(np.asarray(up) - np.asarray(down)) / (2.0 * h) for up, down, h in sides], axis=1)
