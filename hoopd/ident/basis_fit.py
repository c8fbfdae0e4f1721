"""A system as a sum of known functions, fitted to data by least squares.

Rules of this file: from rest; rows without the output are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import control as ct
import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.bases import Basis
from hoopd.ident.checks import BROAD, Orders, check
from hoopd.ident.data import Data, experiments
from hoopd.ident.estimation_report import EstimationReport, estimated
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.loopchecks import check_record
from hoopd.ident.modelchecks import check_excess

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class BasisFit(IdentifiedModel):
    """Coefficients (ny, nu, n), the system they make, residual variances (ny,) and standard errors (ny, nu, n)."""

    coefficients: Array
    system: ct.StateSpace
    variance: Array
    deviation: Array
    report: EstimationReport | None = field(default=None, compare=False)

    @property
    def parameters(self) -> dict[str, float]:
        """Coefficients by name: c[k], or c[output, input, k] of several channels."""
        return dict(zip(self._names(), self.coefficients.reshape(-1).tolist(), strict=True))

    def deviations(self) -> dict[str, float]:
        """Standard errors of the coefficients by name."""
        return dict(zip(self._names(), self.deviation.reshape(-1).tolist(), strict=True))

    def _names(self) -> list[str]:
        ny, nu, n = self.coefficients.shape
        pairs = [f"{i + 1}, {j + 1}, " if ny * nu > 1 else "" for i in range(ny) for j in range(nu)]
        return [f"c[{pair}{k + 1}]" for pair in pairs for k in range(n)]


@estimated("basis functions")
def fit_basis(data: Data | Sequence[Data], basis: Basis, *, ridge: float = 0.0) -> BasisFit:
    """Fit every output by all inputs through a basis, by least squares from rest.

    Parameters
    ----------
    data : Data or sequence of Data
        One or several experiments; rows without the output are left out.
    basis : Basis
        The functions, continuous or at the step of the data.
    ridge : float
        Weight on the sum of squared coefficients.

    Returns
    -------
    BasisFit
        `coefficients` (ny, nu, n), the `system` that they make, residual `variance` (ny,) and the standard errors
        `deviation` (ny, nu, n).

    Raises
    ------
    ValueError
        No input, inputs that do not tell the functions apart, steps that differ.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import fit_basis, iddata, laguerre
    >>> rng = np.random.default_rng(0)
    >>> basis, u = laguerre(0.8, 3, dt=0.1), rng.standard_normal(500)
    >>> y = basis.filtered(u) @ [2.0, -1.0, 0.5] + 0.05 * rng.standard_normal(500)
    >>> fit_basis(iddata(y, u, 0.1), basis).coefficients[0, 0].round(2)
    array([ 2. , -1. ,  0.5])
    """
    each = experiments(data)
    if basis.dt and not np.isclose(basis.dt, each[0].dt, atol=0.0):
        raise ValueError(f"the basis has a step of {basis.dt} s, the data of {each[0].dt} s")
    if each[0].nu == 0:
        raise ValueError("no input: a basis filters inputs")
    check(each, orders=Orders(0, min(len(basis), BROAD)))
    check_record(each)
    rows = np.vstack([np.hstack([basis.filtered(u, one.dt) for u in one.u.T]) for one in each])
    y = np.vstack([one.y for one in each])
    found = [_regressed(rows, column, ridge) for column in y.T]
    shape = (each[0].ny, each[0].nu, len(basis))
    coefficients = np.array([one[0] for one in found]).reshape(shape)
    deviation = np.array([one[2] for one in found]).reshape(shape)
    if len(basis) > 1 and not ridge:
        last = np.square(coefficients[..., -1] / np.maximum(deviation[..., -1], 1e-300))
        check_excess([("function", float(last.sum()), last.size)], len(rows))
    return BasisFit(
        coefficients, _parallel(basis, coefficients), np.array([one[1] for one in found]),
        deviation,
    )  # fmt: skip


def _regressed(rows: Array, y: Array, ridge: float) -> tuple[Array, float, Array]:
    seen = np.isfinite(y)
    own, target, n = rows[seen], y[seen], rows.shape[1]
    if len(own) <= n or (not ridge and np.linalg.matrix_rank(own) < n):
        raise ValueError(f"{len(own)} samples do not tell {n} functions apart: take fewer, or a weight `ridge`")
    weighted = np.vstack([own, np.sqrt(ridge) * np.eye(n)]) if ridge else own
    padded = np.concatenate([target, np.zeros(len(weighted) - len(own))])
    coefficients = np.linalg.lstsq(weighted, padded, rcond=None)[0]
    variance = float(np.sum((target - own @ coefficients) ** 2)) / (len(own) - n)
    inverse = np.linalg.inv(weighted.T @ weighted)
    spread = variance * np.einsum("ij,jk,ki->i", inverse, own.T @ own, inverse)
    return coefficients, variance, np.sqrt(spread)


def _parallel(basis: Basis, coefficients: Array) -> ct.StateSpace:
    own, nu = basis.system, coefficients.shape[1]
    c = np.hstack([coefficients[:, i] @ own.C for i in range(nu)])
    d = np.hstack([coefficients[:, i] @ own.D for i in range(nu)])
    return ct.ss(linalg.block_diag(*[own.A] * nu), linalg.block_diag(*[own.B] * nu), c, d, basis.dt)
