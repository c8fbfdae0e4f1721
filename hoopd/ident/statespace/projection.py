"""From the moments of past and future windows to observability, order, state and noise covariances.

With p past and f future samples the rows are [U_f; Z_p; Y_f], Z_p = past inputs and outputs, and their LQ factor is
    U_f   L11           Q1
    Z_p = L21 L22       Q2
    Y_f   L31 L32 L33   Q3
Of the prediction of Y_f from Z_p less what U_f explains, G = W1 L32 W2, the left singular vectors span W1 (C; CA; ...)
(Van Overschee & De Moor, 1996, chapter 4; Ljung, 1999, section 10.6).
MOESP: W1 = I, on L32. N4SID: W1 = I, on L32 L22^-1 [L21 L22]. CVA: W1 = (L32 L32' + L33 L33')^-1/2, on L32.
IVM: the same W1, on L32 L22' (L21 L21' + L22 L22')^-1/2.

Rules of this file: only the factor is used, never the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from hoopd.ident.statespace import windows

Array = NDArray[np.float64]
Weighting = Literal["MOESP", "N4SID", "CVA", "IVM"]
WEIGHTINGS = ("MOESP", "N4SID", "CVA", "IVM")

# Relative size below which a singular value of a factor is rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class WindowSplit:
    """Rows of a window of past + future samples of z = [u; y]."""

    past: int
    future: int
    nu: int
    ny: int

    @property
    def length(self) -> int:
        """Samples of a window."""
        return self.past + self.future

    def rows(self, samples: range, *, inputs: bool, outputs: bool) -> Array:
        """Row numbers in the window of z."""
        m = self.nu + self.ny
        own = [i for i in range(m) if (inputs and i < self.nu) or (outputs and i >= self.nu)]
        return np.array([s * m + i for s in samples for i in own], dtype=int)

    @property
    def order(self) -> Array:
        """U_f, Z_p, Y_f."""
        past, future = range(self.past), range(self.past, self.length)
        return np.concatenate([
            self.rows(future, inputs=True, outputs=False),
            self.rows(past, inputs=True, outputs=True),
            self.rows(future, inputs=False, outputs=True),
        ])  # fmt: skip

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Rows of U_f, Z_p, Y_f."""
        return self.future * self.nu, self.past * (self.nu + self.ny), self.future * self.ny


@dataclass(frozen=True)
class TriangularFactor:
    """The lower triangular factor of `count` windows, in the order of the split."""

    low: Array
    split: WindowSplit
    count: int

    def block(self, i: int, j: int) -> Array:
        """Block L_ij, numbered from 1 as in the head of the file."""
        edges = np.concatenate([[0], np.cumsum(self.split.sizes)])
        return np.asarray(self.low[edges[i - 1] : edges[i], edges[j - 1] : edges[j]])

    def window_rows(self, rows: Array) -> Array:
        """Rows of the factor that belong to rows of the window of z."""
        place = np.empty(len(self.low), dtype=int)
        place[self.split.order] = np.arange(len(self.low))
        return np.asarray(self.low[place[rows]])


@dataclass(frozen=True)
class Decomposition:
    """Singular values, and the extended observability matrix (f ny, nx) of any order by `observability`."""

    u: Array
    s: Array
    unweight: Array | None  # W1^-1

    def observability(self, nx: int) -> Array:
        """W1^-1 U S^1/2."""
        gamma = self.u[:, :nx] * np.sqrt(self.s[:nx])
        return gamma if self.unweight is None else np.asarray(self.unweight @ gamma)


def factor(pieces: Sequence[Array], split: WindowSplit, gram: Array | None = None) -> TriangularFactor:
    """The factor of all windows of the pieces (n, nu + ny)."""
    low = windows.factor(pieces, split.length, split.order, gram)
    return TriangularFactor(low, split, windows.count(pieces, split.length))


def decompose(found: TriangularFactor, weighting: Weighting) -> Decomposition:
    """The weighted singular value decomposition."""
    past, l32 = _past(found), found.block(3, 2)
    if weighting == "MOESP":
        return _svd(l32, None)
    if weighting == "N4SID":
        return _svd(past @ np.hstack([found.block(2, 1), found.block(2, 2)]), None)
    root = _noise_root(found)
    on = l32
    if weighting == "IVM":
        l21, l22 = found.block(2, 1), found.block(2, 2)
        both = np.hstack([l21, l22])
        q, s, _ = linalg.svd(both, full_matrices=False)
        keep = s > ROUNDING * s[0]
        on = (l32 @ l22.T @ q[:, keep]) / s[keep]
    return _svd(linalg.solve_triangular(root, on, lower=True), root)


def correlations(found: TriangularFactor) -> Array:
    """Canonical correlations of past and future given the future inputs, from 1 down."""
    return np.asarray(linalg.svdvals(linalg.solve_triangular(_noise_root(found), found.block(3, 2), lower=True)))


def choose_order(found: TriangularFactor, most: int) -> int:
    """The order that makes the information criterion least, of d(n) = n (2 ny + nu) numbers of the model:

        NIC(n) = sum_(k > n) -log(1 - s_k^2) + log(T) d(n) / T
    s are the canonical correlations, T the windows: correlations near 1, of states that are left out, count without
    bound, as they do in the likelihood (Peternell, Scherrer & Deistler, Signal Processing 52, 1996); those no larger
    than chance gives do not count.
    """
    split, t = found.split, found.count
    s = np.minimum(correlations(found), 1.0 - ROUNDING)
    n = np.arange(min(most, len(s) - 1) + 1)
    told = np.where(s > chance(found), -np.log1p(-(s**2)), 0.0)
    left = np.concatenate([np.cumsum(told[::-1])[::-1], [0.0]])
    criterion = left[n] + np.log(t) * n * (2 * split.ny + split.nu) / t
    return max(int(np.argmin(criterion)), 1)


def chance(found: TriangularFactor) -> float:
    """The largest correlation of independent past and future (Marchenko & Pastur, 1967, for many more samples)."""
    _, past, future = found.split.sizes
    return float((np.sqrt(past) + np.sqrt(future)) / np.sqrt(found.count))


def state_map(found: TriangularFactor, gamma: Array) -> Array:
    """(nx, rows of Z_p): the state at the end of the past is this times Z_p."""
    return np.asarray(np.linalg.lstsq(gamma, _past(found), rcond=None)[0])


def excitation(found: TriangularFactor) -> float:
    """Least over largest singular value of the scaled inputs of a window; 0 where some combination never moves."""
    split = found.split
    rows = found.window_rows(split.rows(range(split.length), inputs=True, outputs=False))
    if not len(rows):
        return 1.0
    size = np.linalg.norm(rows, axis=1)
    if size.min() == 0.0:
        return 0.0
    s = linalg.svdvals(rows / size[:, None])
    return float(s[-1] / s[0])


def _past(found: TriangularFactor) -> Array:
    """L32 L22^-1."""
    l22, l32 = found.block(2, 2), found.block(3, 2)
    pivots = np.abs(np.diag(l22)) / np.maximum(np.linalg.norm(found.block(2, 1), axis=1) + np.abs(np.diag(l22)), 1e-300)
    if pivots.min(initial=1.0) > 1e-6:
        return np.asarray(linalg.solve_triangular(l22, l32.T, lower=True, trans="T").T)
    return np.asarray(l32 @ linalg.pinv(l22, rtol=ROUNDING))


def _noise_root(found: TriangularFactor) -> Array:
    """Lower triangular root of L32 L32' + L33 L33', lifted a little where the data have no noise."""
    both = np.hstack([found.block(3, 2), found.block(3, 3)])
    covariance = both @ both.T
    lift = ROUNDING * np.trace(covariance) / len(covariance)
    return np.asarray(linalg.cholesky(covariance + (lift + 1e-300) * np.eye(len(covariance)), lower=True))


def _svd(matrix: Array, unweight: Array | None) -> Decomposition:
    # the left singular vectors of a wide matrix are those of its square triangular factor
    r = linalg.qr(matrix.T, mode="r", check_finite=False)[0][: len(matrix)] if matrix.shape[1] > len(matrix) else None
    u, s, _ = linalg.svd(matrix if r is None else r.T, full_matrices=False, check_finite=False)
    return Decomposition(u, s, unweight)
