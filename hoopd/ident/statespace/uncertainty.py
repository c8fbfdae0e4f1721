"""Covariance of an estimated state-space model, and of what follows from it: frequency response, poles.

Rules of this file: the covariance lives in the coordinates orthogonal to changes of basis, so what does not depend on
the basis (response, poles) has its true variance; single entries of the matrices do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from hoopd.ident.data import Data
from hoopd.ident.models import Innovations
from hoopd.ident.statespace import coordinates, gaussnewton
from hoopd.ident.statespace.coloured import autoregression_of, shaped
from hoopd.ident.statespace.coordinates import Freedom
from hoopd.ident.statespace.gaussnewton import PemPoint, PemProblem
from hoopd.ident.statespace.sensitivities import paired, piece, sensitivities

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Samples of an experiment that the curvature is taken from; the rest counts by its number.
MOST = 20_000


def coordinates_covariance(problem: PemProblem, point: PemPoint, *, white: bool) -> Array:
    """(full, full) of the full vector at a minimum; the weight makes the errors' covariance one.

    White errors: the inverse of the Gram of their derivatives (Ljung, 1999, 9.30), times rho's share of a robust loss.
    Coloured ones (simulation, several steps ahead): J'SJ between two inverses, S the covariance of all the errors by an
    autoregression of theirs.
    """
    normal = gaussnewton.normal_equations(problem, point)
    scale = np.sqrt(np.maximum(np.diag(normal.gram), 1e-300))
    inverse = linalg.pinvh(normal.gram / np.outer(scale, scale), rtol=1e-12) / np.outer(scale, scale)
    m = normal.columns.shape[1]
    if white and problem.loss is None:
        count = sum(one.known.sum() for one in problem.pieces)
        whole = inverse * (point.cost / max(count - len(inverse), 1) if problem.regulariser is None else 1.0)
    else:
        whole = inverse @ _scores(problem, point, normal.columns, white) @ inverse
    return np.asarray(normal.columns @ whole[:m, :m] @ normal.columns.T)


def curvature_covariance(model: Innovations, each: Sequence[Data]) -> Array | None:
    """(full, full) of a model that predicts the data of its fit about as well as any, by the curvature there.

    What efficient estimates scatter by, subspace estimates with enough of a horizon among them (Bauer, J. Econometrics
    123, 2004). None where the predictor forgets nothing.
    """
    gained = bool(model.k.any())
    fixed = model.ny if model.choice is not None and model.choice.disturbance is not None else 0
    free = Freedom(direct=bool(model.d.any()), gain=gained, fixed=fixed)
    problem = PemProblem([piece(one) for one in each], np.eye(model.ny), free)
    point = gaussnewton.with_best_starts(problem, model)
    if not np.isfinite(point.cost):
        return None
    r = paired([path.ahead for path in point.paths], [one.known for one in problem.pieces])
    power = max(float(np.trace(r)), 1e-300)
    problem = replace(problem, weight=np.linalg.inv(np.linalg.cholesky(r + 1e-12 * power * np.eye(len(r)))))
    point = gaussnewton.evaluate(problem, model, point.starts)
    return coordinates_covariance(problem, point, white=gained)


def matrices_covariance(model: Innovations) -> Array | None:
    """The covariance that a model has, or that its data give: of a fit that this room made."""
    if model.covariance is not None:
        return model.covariance if len(model.covariance) == len(coordinates.values(model)) else None
    if model.report is None or model.choice is None or not model.dt:
        return None
    each = [one[:MOST] for one in model.report.data if isinstance(one, Data)]
    found = curvature_covariance(model, each) if each else None
    seen, used = (sum(one.n for one in part) for part in (model.report.data, each))
    return None if found is None else found * (used / seen)


def _known(model: Innovations) -> Array:
    found = matrices_covariance(model)
    if found is None:
        raise ValueError("the model has no covariance of its matrices (pem and subspaceid give one)")
    return found


def response_covariance(model: Innovations, w: ArrayLike) -> Array:
    """Give the covariance of the frequency response of an estimated state-space model, by linearisation.

    Parameters
    ----------
    model : Innovations
        A model with the covariance of its matrices, as `pem` and `subspaceid` give it.
    w : array_like, shape (nw,)
        Frequencies in rad/s.

    Returns
    -------
    ndarray, shape (nw, ny, nu, 2, 2)
        Of real and imaginary part of the response from u to y.

    Raises
    ------
    ValueError
        A model without covariance.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import iddata, pem, response_covariance
    >>> u, e = np.random.default_rng(0).standard_normal((2, 500))
    >>> data = iddata(lfilter([0.0, 2.0], [1.0, -0.8], u) + 0.1 * e, u, 0.1)
    >>> model = pem(data, order=1)
    >>> error = model.system.dcgain() - 10.0  # the true gain at rest
    >>> bool(abs(error) < 3.0 * np.sqrt(response_covariance(model, [0.0])[0, 0, 0, 0, 0]))
    True
    """
    covariance = _known(model)
    z = np.exp(1j * np.asarray(w, dtype=float) * model.dt) if model.dt else 1j * np.asarray(w, dtype=float)
    change = _response_change(model, z)
    parts = np.stack([change.real, change.imag], axis=-2)
    return np.asarray(parts @ covariance @ parts.swapaxes(-1, -2))


def pole_covariance(model: Innovations) -> tuple[Complex, Array]:
    """Give the poles of an estimated state-space model and their covariances; simple poles only.

    Parameters
    ----------
    model : Innovations
        A model with the covariance of its matrices, as `pem` and `subspaceid` give it.

    Returns
    -------
    poles : ndarray of complex, shape (nx,)
        The poles.
    covariance : ndarray, shape (nx, 2, 2)
        Of their real and imaginary parts.

    Raises
    ------
    ValueError
        A model without covariance.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import iddata, pem, pole_covariance
    >>> u, e = np.random.default_rng(0).standard_normal((2, 500))
    >>> data = iddata(lfilter([0.0, 2.0], [1.0, -0.8], u) + 0.1 * e, u, 0.1)
    >>> poles, covariance = pole_covariance(pem(data, order=1))
    >>> bool(abs(poles[0] - 0.8) < 3.0 * np.sqrt(covariance[0, 0, 0]))
    True
    """
    covariance = _known(model)
    poles, left, right = linalg.eig(model.a, left=True)
    # d pole = l* dA r / (l* r)
    scale = np.einsum("ik,ik->k", left.conj(), right)
    change = np.einsum("ik,jk->kij", left.conj(), right).reshape(model.nx, -1) / scale[:, None]
    parts = np.stack([change.real, change.imag], axis=1)
    own = covariance[: model.nx**2, : model.nx**2]
    return poles, np.asarray(parts @ own @ parts.swapaxes(-1, -2))


def _scores(problem: PemProblem, point: PemPoint, columns: Array, white: bool) -> Array:
    """Covariance of the gradient: the sum of squared scores of a robust loss, or J'SJ of coloured errors."""
    along = coordinates.directions(point.model, columns)
    both = coordinates.joined(along, coordinates.starts(point.model)) if problem.start else along
    m, nx = columns.shape[1], point.model.nx if problem.start else 0
    noise = None if white else autoregression_of([(problem.weight @ path.ahead).T for path in point.paths])
    total = np.zeros((m + nx * len(problem.pieces),) * 2)
    for i, (data, path) in enumerate(zip(problem.pieces, point.paths, strict=True)):
        change = np.tensordot(problem.weight, sensitivities(point.model, data, path, both, problem.horizon), 1)
        e = problem.weight @ path.ahead
        if problem.loss is not None:
            weights = problem.loss(np.square(e))[1]
            change, e = change * weights[:, None, :], e * weights
        score = np.einsum("ymn,yn->mn", change, e) if noise is None else shaped(change, *noise)
        own = np.concatenate([np.arange(m), m + i * nx + np.arange(nx)])
        total[np.ix_(own, own)] += score @ score.T
    return total


def _response_change(model: Innovations, z: Complex) -> Complex:
    """Derivatives (nw, ny, nu, full) of C (zI - A)^-1 B + D."""
    nx, ny, nu, nw = model.nx, model.ny, model.nu, len(z)
    minus = z[:, None, None] * np.eye(nx) - model.a
    right = np.linalg.solve(minus, np.broadcast_to(model.b, (nw, nx, nu)))
    left = np.linalg.solve(minus.transpose(0, 2, 1), np.broadcast_to(model.c.T, (nw, nx, ny))).transpose(0, 2, 1)
    of_a = np.einsum("wyi,wju->wyuij", left, right)
    of_b = np.einsum("wyi,uj->wyuij", left, np.eye(nu))
    of_c = np.einsum("yi,wju->wyuij", np.eye(ny), right)
    of_d = np.broadcast_to(np.einsum("yi,uj->yuij", np.eye(ny), np.eye(nu)), (nw, ny, nu, ny, nu))
    of_k = np.zeros((nw, ny, nu, nx, ny))
    return np.concatenate([one.reshape(nw, ny, nu, -1) for one in (of_a, of_b, of_c, of_d, of_k)], axis=3)
