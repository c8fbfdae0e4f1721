"""A state-space model in other states: its matrices, its noise, its initial state, and how well they are known.

Rules of this file: the full vector of a model holds A, B, C, D, K row by row, in this order; models import this file,
and it imports none.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

if TYPE_CHECKING:
    from hoopd.ident.models import Innovations

Array = NDArray[np.float64]


def covariance_of_matrices(model: Innovations) -> Array | None:
    """The covariance that a model has, where it is that of the full vector and not of parameters behind it."""
    full = _full(model)
    if model.covariance is None or len(model.covariance) != len(full):
        return None
    return model.covariance if not len(model.values) or np.array_equal(model.values, full) else None


def in_states(model: Innovations, t: Array, inverse: Array) -> Innovations:
    """The same model in the states z = inverse x, x = t z, the numbers of its estimate with it."""
    # the slow states of a disturbance are the last ones no more, where the data would be asked for a covariance
    known = model.choice is None or model.choice.disturbance is None
    moved = replace(projected(model, t, inverse), choice=model.choice if known else None)
    covariance = covariance_of_matrices(model)
    if covariance is None:
        return moved
    change = _of_full_vector(model, t, inverse)
    return replace(
        moved, values=_full(moved) if len(model.values) else model.values, covariance=change @ covariance @ change.T
    )  # fmt: skip


def projected(model: Innovations, t: Array, inverse: Array) -> Innovations:
    """The matrices, x = t z, z = inverse x; fewer columns of t than states truncate."""
    return replace(
        model, a=inverse @ model.a @ t, b=inverse @ model.b, c=model.c @ t, k=inverse @ model.k,
        q=None if model.q is None else inverse @ model.q @ inverse.T,
        s=None if model.s is None else inverse @ model.s,
        x0=None if model.x0 is None else inverse @ model.x0,
    )  # fmt: skip


def _full(model: Innovations) -> Array:
    return np.concatenate([one.ravel() for one in (model.a, model.b, model.c, model.d, model.k)])


def _of_full_vector(model: Innovations, t: Array, inverse: Array) -> Array:
    """(full, full): what a small change of the full vector becomes in the states T^-1 x, A' = T^-1 A T and so on."""
    ny, nu = model.ny, model.nu
    # row by row, L X R is (L kron R') x
    of_b, of_k = (np.kron(inverse, np.eye(count)) for count in (nu, ny))
    return np.asarray(
        linalg.block_diag(np.kron(inverse, t.T), of_b, np.kron(np.eye(ny), t.T), np.eye(ny * nu), of_k), float
    )
