"""Ways to solve A x = y in more rows than unknowns, to be handed to `arx`, `ar` and `plr` as `estimator`.

Rules of this file: an estimator takes A (n, p), y (n,) and returns x (p,); a function that makes one carries its
settings. Memory is linear in n.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Estimator = Callable[[Array, Array], Array]

# Efficiency of 95 % on normal noise (Huber, Robust Statistics, 1981; Holland & Welsch, 1977).
TUNING = {"huber": 1.345, "tukey": 4.685}
# Median absolute deviation of a normal variable with standard deviation one.
MAD = 0.6744897501960817
ITERATIONS = 50
SETTLED = 1e-8


def least_squares(a: Array, y: Array) -> Array:
    """Solve A x = y by least squares, argmin |A x - y|.

    Parameters
    ----------
    a : ndarray, shape (n, p)
        Regressors.
    y : ndarray, shape (n,)
        What they are to give.

    Returns
    -------
    ndarray, shape (p,)
        The solution.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import least_squares
    >>> least_squares(np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 2.0]]), np.array([1.0, 3.0, 5.0])).round(6)
    array([1., 2.])
    """
    return np.asarray(np.linalg.lstsq(a, y, rcond=None)[0])


def total_least_squares(a: Array, y: Array) -> Array:
    """Solve A x = y with errors of equal size in every column of A and in y.

    Parameters
    ----------
    a : ndarray, shape (n, p)
        Regressors.
    y : ndarray, shape (n,)
        What they are to give.

    Returns
    -------
    ndarray, shape (p,)
        The solution, of the right singular vector of the least singular value.

    Notes
    -----
    Source: Golub & Van Loan, SIAM J. Numer. Anal. 17 (1980).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import least_squares, total_least_squares
    >>> x, e, f = np.random.default_rng(0).standard_normal((3, 4000))
    >>> a, y = (x + 0.5 * e)[:, None], 2.0 * x + 0.5 * f  # the slope is 2
    >>> least_squares(a, y).round(1), total_least_squares(a, y).round(1)
    (array([1.6]), array([2.]))
    """
    return _from_null(_triangle(np.column_stack([a, y])))


def weighted_total_least_squares(noise: ArrayLike, weights: ArrayLike | None = None) -> Estimator:
    """Make an estimator by total least squares with noise of known size in each column.

    Minimises sum_t w_t^2 (z_t v)^2 / (v' diag(noise^2) v), z_t = [a_t, y_t], v = [x, -1]. For white noise on an output
    it is consistent.

    Parameters
    ----------
    noise : array_like, shape (p + 1,)
        Standard deviation in the columns of A and in y; columns with zero noise are exact.
    weights : array_like, shape (n,), optional
        Inverse standard deviations of the rows.

    Returns
    -------
    callable
        (A, y) -> x.

    Raises
    ------
    ValueError
        No column has noise.

    Notes
    -----
    Sources: Van Huffel & Vandewalle, The Total Least Squares Problem (1991), 3.6; Koopmans-Levin: Levin, IEEE Trans.
    Automat. Control 9, 1964.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import weighted_total_least_squares
    >>> x, e, f = np.random.default_rng(0).standard_normal((3, 4000))
    >>> a, y = np.column_stack([x + 0.5 * e, np.ones(4000)]), 2.0 * x + 3.0 + 0.5 * f
    >>> weighted_total_least_squares([0.5, 0.0, 0.5])(a, y).round(1)  # the constant is exact
    array([2., 3.])
    """
    deviation = np.asarray(noise, dtype=float)
    rows = None if weights is None else np.asarray(weights, dtype=float)
    if not (deviation.ndim == 1 and (deviation >= 0.0).all() and (deviation > 0.0).any()):
        raise ValueError("noise is one standard deviation for each column of A and one for y, at least one positive")

    def solve(a: Array, y: Array) -> Array:
        if len(deviation) != a.shape[1] + 1:
            raise ValueError(f"noise has {len(deviation)} numbers, A and y have {a.shape[1] + 1} columns")
        z = np.column_stack([a, y]) if rows is None else np.column_stack([a, y]) * rows[:, None]
        return _errors_in_some(z, deviation)

    return solve


def output_noise(na: int, nb: int, sigma_y: float = 1.0, sigma_u: float = 0.0) -> Array:
    """Noise of the columns [-y(t-1) ... -y(t-na), u ... (nb of them), y(t)] for measurement noise on y and u."""
    return np.concatenate([np.full(na, sigma_y), np.full(nb, sigma_u), [sigma_y]])


def frequency_weighted(low_hz: float, high_hz: float, dt: float = 1.0, order: int = 2) -> Estimator:
    """Make an estimator by least squares in a band.

    Rows are weighted by the symmetric Toeplitz matrix of a zero-phase Butterworth filter. The filter runs along the
    columns, no matrix of n x n is made. Rows must be consecutive samples.

    Parameters
    ----------
    low_hz, high_hz : float
        The band in Hz; 0 as the lower or infinity as the upper limit leaves that side open.
    dt : float
        Step in s.
    order : int
        Order of the filter, which runs forwards and backwards.

    Returns
    -------
    callable
        (A, y) -> x.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import frequency_weighted
    >>> t, x = 0.01 * np.arange(2000), np.random.default_rng(0).standard_normal(2000)
    >>> y = 2.0 * x + 5.0 * np.sin(2 * np.pi * 10.0 * t)  # a hum at 10 Hz
    >>> frequency_weighted(0.0, 5.0, dt=0.01)(x[:, None], y).round(1)
    array([2.])
    """
    from scipy.signal import sosfiltfilt

    sections = band(low_hz, high_hz, dt, order)

    def solve(a: Array, y: Array) -> Array:
        filtered = sosfiltfilt(sections, np.column_stack([a, y]), axis=0)
        return least_squares(filtered[:, :-1], filtered[:, -1])

    return solve


def band(low_hz: float, high_hz: float, dt: float, order: int = 2) -> Array:
    """Second-order sections of a Butterworth low-pass, high-pass or band-pass; ValueError for an empty band."""
    from scipy.signal import butter

    if not 0.0 <= low_hz < high_hz or (low_hz == 0.0 and high_hz >= 0.5 / dt) or low_hz >= 0.5 / dt:
        raise ValueError(f"no band between {low_hz} and {high_hz} Hz below {0.5 / dt:.4g} Hz")
    if low_hz == 0.0:
        return np.asarray(butter(order, high_hz, "lowpass", fs=1.0 / dt, output="sos"))
    if high_hz >= 0.5 / dt:
        return np.asarray(butter(order, low_hz, "highpass", fs=1.0 / dt, output="sos"))
    return np.asarray(butter(order, [low_hz, high_hz], "bandpass", fs=1.0 / dt, output="sos"))


def robust(loss: Literal["huber", "tukey"] = "huber", tuning: float | None = None) -> Estimator:
    """Make an estimator by iteratively reweighted least squares against outliers.

    Huber's weights min(1, k s/|r|); Tukey's (1 - (r/(k s))^2)^2, zero beyond, started from Huber's answer; the scale s
    by the median absolute deviation.

    Parameters
    ----------
    loss : {"huber", "tukey"}
        The weights.
    tuning : float, optional
        k; without it the usual one of the loss.

    Returns
    -------
    callable
        (A, y) -> x.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import least_squares, robust
    >>> rng = np.random.default_rng(0)
    >>> x = rng.standard_normal(200)
    >>> y = 2.0 * x + 0.1 * rng.standard_normal(200)
    >>> y[:20] = 50.0 * np.sign(x[:20])  # outliers
    >>> least_squares(x[:, None], y).round(1), robust("tukey")(x[:, None], y).round(1)
    (array([5.5]), array([2.]))
    """
    k = TUNING[loss] if tuning is None else float(tuning)

    def solve(a: Array, y: Array) -> Array:
        x = least_squares(a, y)
        x = _reweighted(a, y, x, _huber, TUNING["huber"] if loss == "tukey" else k)
        return x if loss == "huber" else _reweighted(a, y, x, _tukey, k)

    return solve


def _reweighted(a: Array, y: Array, x: Array, weigh: Callable[[Array], Array], k: float) -> Array:
    for _ in range(ITERATIONS):
        rest = y - a @ x
        scale = float(np.median(np.abs(rest))) / MAD
        if scale <= 0.0:
            return x
        root = np.sqrt(weigh(rest / (k * scale)))
        new = least_squares(a * root[:, None], y * root)
        if np.linalg.norm(new - x) <= SETTLED * np.linalg.norm(x):
            return new
        x = new
    return x


def _huber(z: Array) -> Array:
    return 1.0 / np.maximum(np.abs(z), 1.0)


def _tukey(z: Array) -> Array:
    return np.asarray(np.maximum(1.0 - z**2, 0.0) ** 2)


def _triangle(z: Array) -> Array:
    return np.asarray(np.linalg.qr(z, mode="r"))


def _from_null(r: Array) -> Array:
    """x of the direction [x, -1] in which R shrinks most."""
    v = np.linalg.svd(r)[2][-1]
    if abs(v[-1]) < np.finfo(float).eps:
        raise ValueError("total least squares has no solution here: the columns of A depend on each other")
    return np.asarray(-v[:-1] / v[-1])


def _errors_in_some(z: Array, deviation: Array) -> Array:
    """The exact columns are projected out, the rest is scaled to unit noise and solved as a whole."""
    noisy = np.flatnonzero(deviation > 0.0)
    exact = np.flatnonzero(deviation <= 0.0)
    r = _triangle(z[:, np.concatenate([exact, noisy])])
    m = len(exact)
    v = np.zeros(z.shape[1])
    v[noisy] = np.linalg.svd(r[m:, m:] / deviation[noisy])[2][-1] / deviation[noisy]
    v[exact] = -np.linalg.lstsq(r[:m, :m], r[:m, m:] @ v[noisy], rcond=None)[0]
    if abs(v[-1]) < np.finfo(float).eps * np.abs(v).max():
        raise ValueError("total least squares has no solution here: the columns of A depend on each other")
    return np.asarray(-v[:-1] / v[-1])
