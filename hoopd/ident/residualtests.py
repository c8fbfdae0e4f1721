"""Whether what a model leaves is what it believes: white, independent of past inputs, with no way back to the input.

Rules of this file: pure numbers; NaN is a sample that was not measured and counts nowhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from hoopd.ident.data import Data
from hoopd.ident.models import Model
from hoopd.ident.normal import Z95
from hoopd.ident.prediction import Start, prediction_error

Array = NDArray[np.float64]

# A test fails below this chance.
SIGNIFICANCE = 0.01
# Lags that are tested, both ways.
MOST_LAGS = 25
# A loop that is closed acts within a few samples; more lags would hide it among chance.
LOOP_LAGS = 10


def correlation(x: ArrayLike, y: ArrayLike, lags: int) -> Array:
    """(2 lags + 1,) r_xy(k) = mean x(t) y(t + k) / (s_x s_y) for k = -lags ... lags; NaN pairs are left out."""
    a, b = (np.asarray(one, dtype=float).reshape(-1) for one in (x, y))
    a, b = a - np.nanmean(a), b - np.nanmean(b)
    scale = np.sqrt(np.nanmean(a**2) * np.nanmean(b**2))
    n, out = len(a), np.zeros(2 * lags + 1)
    known = np.isfinite(a) & np.isfinite(b)
    total = max(int(known.sum()), 1)
    a, b = np.nan_to_num(a), np.nan_to_num(b)
    for k in range(-lags, lags + 1):
        left, right = (a[: n - k], b[k:]) if k >= 0 else (a[-k:], b[: n + k])
        out[k + lags] = float(left @ right) / total
    return out / scale if scale > 0.0 else out


@dataclass(frozen=True)
class Test:
    """Correlations of one pair of signals at their lags, the 95 % band of each, and the chance of all together."""

    name: str
    lags: NDArray[np.int64]
    values: Array
    band: float
    chance: float

    @property
    def passed(self) -> bool:
        """Whether chance gives as much often enough."""
        return self.chance >= SIGNIFICANCE


def whiteness(e: ArrayLike, lags: int = MOST_LAGS, fitted: int = 0, name: str = "e") -> Test:
    """Whether errors (n,) are white: n (n + 2) sum r_k^2/(n - k) over the lags is chi-square (Ljung and Box 1978).

    `fitted`: parameters that were estimated on these very data; they take as many degrees of freedom.
    """
    x = np.asarray(e, dtype=float).reshape(-1)
    n = int(np.isfinite(x).sum())
    lags = min(lags, max(n // 4, 1))
    r = correlation(x, x, lags)[lags + 1 :]
    k = np.arange(1, lags + 1)
    statistic = n * (n + 2.0) * float(np.sum(r**2 / np.maximum(n - k, 1)))
    return Test(
        f"{name}, {name}", k, r, Z95 / np.sqrt(max(n, 1)), float(stats.chi2.sf(statistic, max(lags - fitted, 1)))
    )


def independence(e: ArrayLike, u: ArrayLike, lags: int = MOST_LAGS, *, after: bool = True, name: str = "e, u") -> Test:
    """Whether errors (n,) follow the past input (`after`), or the input follows past errors (a loop is closed).

    sqrt(n) r_ue(k) is normal with variance sum_j r_e(j) r_u(j) (Ljung, System Identification, 1999, 16.6); all lags
    together are chi-square with the covariance of neighbouring ones by the same formula.
    """
    x, w = (np.asarray(one, dtype=float).reshape(-1) for one in (e, u))
    n = int((np.isfinite(x) & np.isfinite(w)).sum())
    lags = min(lags, max(n // 4, 1))
    both = correlation(w, x, lags)
    ks = np.arange(0, lags + 1) if after else np.arange(-lags, 0)
    r = both[ks + lags]
    reach = min(4 * lags, max(n // 4, 1))
    own = correlation(x, x, reach) * correlation(w, w, reach)
    # cov(r_i, r_j) n = sum_l r_e(l) r_u(l + i - j)
    re, ru = correlation(x, x, reach), correlation(w, w, 2 * reach)
    gap = ks[:, None] - ks[None, :]
    table = {int(g): float(re @ ru[reach + g : reach + g + 2 * reach + 1]) for g in np.unique(gap)}
    covariance = np.array([[table[int(g)] for g in row] for row in gap])
    weight = np.linalg.pinv(covariance, rcond=1e-6, hermitian=True)
    rank = int(np.linalg.matrix_rank(covariance, tol=1e-6 * float(np.abs(covariance).max())))
    statistic = n * float(r @ weight @ r)
    band = Z95 * float(np.sqrt(max(own.sum(), 1.0) / max(n, 1)))
    return Test(name, ks, r, band, float(stats.chi2.sf(statistic, max(rank, 1))))


@dataclass(frozen=True)
class ResidualReport:
    """Tests of one model's one-step errors: white, independent of past inputs, no feedback from them to the input."""

    errors: Array  # (n, ny)
    white: tuple[Test, ...]  # by output
    independent: tuple[Test, ...]  # output by output, input by input
    feedback: tuple[Test, ...]

    @property
    def warnings(self) -> list[str]:
        """What failed, in words."""
        said = [
            f"{one.name}: the residual is not white: the noise model is too simple"
            for one in self.white
            if not one.passed
        ]
        said += [
            f"{one.name}: the residual follows the input: order or delay do not fit"
            for one in self.independent
            if not one.passed
        ]
        return said + [
            f"{one.name}: the input follows past residuals: the data were taken in closed loop" for one in self.feedback
            if not one.passed
        ]  # fmt: skip


def residuals(model: Model, data: Data, lags: int = MOST_LAGS, x0: Start = "estimate") -> ResidualReport:
    """The one-step errors of a model on data, tested."""
    e = prediction_error(model, data, 1, x0)
    pairs = [(i, j) for i in range(data.ny) for j in range(data.nu)]
    return ResidualReport(
        e,
        tuple(whiteness(e[:, i], lags, name=f"e({data.outputs[i]})") for i in range(data.ny)),
        tuple(
            independence(e[:, i], data.u[:, j], lags, name=f"{data.inputs[j]} -> e({data.outputs[i]})")
            for i, j in pairs
        ),
        tuple(
            independence(
                e[:, i],
                data.u[:, j],
                min(lags, LOOP_LAGS),
                after=False,
                name=f"e({data.outputs[i]}) -> {data.inputs[j]}",
            )
            for i, j in pairs
        ),
    )
