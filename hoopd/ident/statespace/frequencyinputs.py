"""B, C, D and x0 of a model whose A is known, from frequency data: each a linear least squares.

Y = C (zI - A)^-1 (B U + z x0) + D U is linear in B, D, x0 with C known, and in C, D with B, x0 known.

Rules of this file: complex rows are solved as real parts above imaginary ones; unknowns are real.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.models import Innovations
from hoopd.ident.statespace.inputs import least_squares

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Spectra:
    """Points of z (n,), outputs (n, ny, m) and inputs (n, nu, m); a frequency response has m = nu unit inputs."""

    z: Complex
    y: Complex
    u: Complex
    weights: Array


def fit_rest(data: Spectra, a: Array, c: Array, direct: bool, transient: bool) -> Innovations:
    """B, D, x0, then C and D, then B, D, x0 again: each a linear least squares."""
    model = fit_inputs(data, a, c, direct, transient)
    start = np.zeros(len(a)) if model.x0 is None else model.x0
    model = fit_outputs(data, a, model.b, start, direct)
    return fit_inputs(data, a, model.c, direct, transient)


def fit_inputs(data: Spectra, a: Array, c: Array, direct: bool, transient: bool) -> Innovations:
    """Y = C (zI - A)^-1 (B U + z x0) + D U for B, D, x0."""
    nx, (ny, nu) = len(a), (data.y.shape[1], data.u.shape[1])
    seen = np.linalg.solve(_minus(data.z, a).transpose(0, 2, 1), np.broadcast_to(c.T, (len(data.z), nx, ny))).transpose(
        0, 2, 1
    )
    parts = [np.einsum("nyx,num->nymux", seen, data.u)]
    if direct:
        parts.append(np.einsum("yi,num->nymui", np.eye(ny), data.u))
    if transient:
        parts.append(np.einsum("n,nyx,nm->nymx", data.z, seen, ones(data)[:, 0])[:, :, :, None])
    found = _solved(data, [one.reshape(*data.y.shape, -1) for one in parts], data.y)
    b, rest = found[: nu * nx].reshape(nu, nx).T, found[nu * nx :]
    d = rest[: nu * ny].reshape(nu, ny).T if direct else np.zeros((ny, nu))
    return replace(_model(a, b, c, rest[len(rest) - nx :] if transient else np.zeros(nx)), d=d)


def fit_outputs(data: Spectra, a: Array, b: Array, x0: Array, direct: bool) -> Innovations:
    """The same equation for C and D."""
    nx, (ny, nu) = len(a), (data.y.shape[1], data.u.shape[1])
    pushed = b @ data.u + data.z[:, None, None] * x0[:, None]
    x = np.linalg.solve(_minus(data.z, a), pushed)
    parts = [np.einsum("yi,nxm->nymix", np.eye(ny), x)]
    if direct:
        parts.append(np.einsum("yi,num->nymiu", np.eye(ny), data.u))
    found = _solved(data, [one.reshape(*data.y.shape, -1) for one in parts], data.y)
    d = found[ny * nx :].reshape(ny, nu) if direct else np.zeros((ny, nu))
    return replace(_model(a, b, found[: ny * nx].reshape(ny, nx), x0), d=d)


def _solved(data: Spectra, parts: list[Complex], y: Complex) -> Array:
    columns = np.concatenate(parts, axis=3) * data.weights[:, None, None, None]
    target = (y * data.weights[:, None, None]).ravel()
    flat = columns.reshape(target.size, -1)
    return least_squares(np.vstack([flat.real, flat.imag]), np.concatenate([target.real, target.imag]))


def _minus(z: Complex, a: Array) -> Complex:
    return np.asarray(z[:, None, None] * np.eye(len(a)) - a)


def _model(a: Array, b: Array, c: Array, x0: Array) -> Innovations:
    return Innovations(a, b, c, np.zeros((len(c), b.shape[1])), np.zeros((len(a), len(c))), 1.0, x0=x0)


def ones(data: Spectra) -> Complex:
    """A unit input (n, 1, m): the transient's."""
    return np.ones((len(data.z), 1, data.y.shape[2]), dtype=complex)
