"""Minimal local coordinates of a state-space model: the directions that change what it does, and no others.

All matrices are free, less the tangent space of the changes of basis: with T = I + X, dA = A X - X A, dB = -X B,
dC = C X, dK = -X K (data driven local coordinates: McKelvey, Helmersson & Ribarits, Automatica 40, 2004).

Rules of this file: the full vector holds A, B, C, D, K row by row, in this order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.models import Innovations
from hoopd.ident.statespace.sensitivities import Directions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Freedom:
    """Which matrices may change."""

    direct: bool = True
    gain: bool = True
    dynamics: bool = True  # A and C
    fixed: int = 0  # states at the end whose entries are given, as those of a slow disturbance


def shapes(model: Innovations) -> list[tuple[str, tuple[int, int]]]:
    """Letter and shape of every matrix, in the order of the full vector."""
    nx, ny, nu = model.nx, model.ny, model.nu
    return [("a", (nx, nx)), ("b", (nx, nu)), ("c", (ny, nx)), ("d", (ny, nu)), ("k", (nx, ny))]


def names(model: Innovations) -> tuple[str, ...]:
    """a[0,0], a[0,1], ... of the full vector."""
    return tuple(f"{x}[{i},{j}]" for x, (rows, columns) in shapes(model) for i in range(rows) for j in range(columns))


def values(model: Innovations) -> Array:
    """The full vector."""
    return np.concatenate([getattr(model, letter).ravel() for letter, _ in shapes(model)])


def with_values(model: Innovations, full: Array) -> Innovations:
    """The model with other matrices."""
    parts: dict[str, Any] = {}
    first = 0
    for letter, shape in shapes(model):
        size = shape[0] * shape[1]
        parts[letter] = full[first : first + size].reshape(shape)
        first += size
    return replace(model, **parts)


def basis(model: Innovations, free: Freedom) -> Array:
    """Orthonormal (full, m): the free entries less the changes of basis."""
    if free.fixed:
        return _embedded(model, free)
    allowed = np.flatnonzero(_mask(model, free))
    if not free.dynamics:
        return np.asarray(np.eye(len(_mask(model, free)))[:, allowed])
    tangent = _tangent(model)[allowed]
    u, s, _ = linalg.svd(tangent, full_matrices=True)
    rank = int((s > 1e-10 * s[0]).sum()) if s.size and s[0] > 0.0 else 0
    q = np.zeros((len(_mask(model, free)), u.shape[1] - rank))
    q[allowed] = u[:, rank:]
    return q


def _embedded(model: Innovations, free: Freedom) -> Array:
    """The basis of the model without its last states, in the full vector of the whole."""
    n = model.nx - free.fixed
    own = replace(model, a=model.a[:n, :n], b=model.b[:n], c=model.c[:, :n], k=model.k[:n])
    inside = with_values(model, np.zeros(len(values(model))))
    for letter, shape in shapes(own):
        getattr(inside, letter)[: shape[0], : shape[1]] = 1.0
    columns = basis(own, replace(free, fixed=0))
    found = np.zeros((len(values(model)), columns.shape[1]))
    found[np.flatnonzero(values(inside))] = columns
    return found


def directions(model: Innovations, columns: Array) -> Directions:
    """The columns (full, m) as changes of the matrices, without one of the initial state."""
    parts, first = [], 0
    for _, (rows, wide) in shapes(model):
        parts.append(columns[first : first + rows * wide].T.reshape(-1, rows, wide))
        first += rows * wide
    return Directions(*[*parts, np.zeros((columns.shape[1], model.nx))])


def starts(model: Innovations) -> Directions:
    """The changes of the initial state alone."""
    m = model.nx
    zero = [np.zeros((m, *shape)) for _, shape in shapes(model)]
    return Directions(*[*zero, np.eye(m)])


def joined(first: Directions, second: Directions) -> Directions:
    """Both sets of directions."""
    pairs = [(getattr(first, x), getattr(second, x)) for x in ("a", "b", "c", "d", "k", "x0")]
    return Directions(*(np.concatenate(pair) for pair in pairs))


def _mask(model: Innovations, free: Freedom) -> NDArray[np.bool_]:
    on = {"a": free.dynamics, "b": True, "c": free.dynamics, "d": free.direct, "k": free.gain}
    return np.concatenate([np.full(rows * columns, on[letter]) for letter, (rows, columns) in shapes(model)])


def _tangent(model: Innovations) -> Array:
    """(full, nx^2): what the changes of basis do to the matrices."""
    nx = model.nx
    x = np.eye(nx * nx).reshape(-1, nx, nx)
    parts = [model.a @ x - x @ model.a, -x @ model.b, model.c @ x, np.zeros((nx * nx, *model.d.shape)), -x @ model.k]
    return np.concatenate([one.reshape(nx * nx, -1) for one in parts], axis=1).T
