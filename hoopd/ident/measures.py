"""How far predictions are from what was measured: sums of squares, root mean squares, fit in percent.

Rules of this file: pure numbers; NaN is a sample that was not measured and counts nowhere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def as_columns(y: ArrayLike) -> Array:
    """(n, channels) of one channel (n,) or several."""
    found = np.asarray(y, dtype=float)
    return found[:, None] if found.ndim == 1 else found


def sse(e: ArrayLike) -> Array:
    """Sum the squares of errors.

    Parameters
    ----------
    e : array_like, shape (n,) or (n, ny)
        Errors; NaN counts not.

    Returns
    -------
    ndarray, shape (ny,)
        The sum of squares of each output.

    Examples
    --------
    >>> from hoopd.ident import sse
    >>> sse([3.0, float("nan"), 4.0])
    array([25.])
    """
    return np.asarray(np.nansum(as_columns(e) ** 2, axis=0))


def mse(e: ArrayLike) -> Array:
    """Give the mean square of errors.

    Parameters
    ----------
    e : array_like, shape (n,) or (n, ny)
        Errors; NaN counts not.

    Returns
    -------
    ndarray, shape (ny,)
        The mean square of each output.

    Examples
    --------
    >>> from hoopd.ident import mse
    >>> mse([3.0, float("nan"), 4.0])
    array([12.5])
    """
    return np.asarray(np.nanmean(as_columns(e) ** 2, axis=0))


def rms(e: ArrayLike) -> Array:
    """Give the root of the mean square of errors.

    Parameters
    ----------
    e : array_like, shape (n,) or (n, ny)
        Errors; NaN counts not.

    Returns
    -------
    ndarray, shape (ny,)
        The root mean square of each output, in its unit.

    Examples
    --------
    >>> from hoopd.ident import rms
    >>> rms([3.0, -3.0, float("nan")])
    array([3.])
    """
    return np.sqrt(mse(e))


def fit_percent(y: ArrayLike, yhat: ArrayLike) -> Array:
    """Give the fit in percent, 100 (1 - |y - yhat|/|y - mean y|).

    Parameters
    ----------
    y : array_like, shape (n,) or (n, ny)
        Measured outputs; NaN counts not.
    yhat : array_like, same shape
        Predicted or simulated outputs.

    Returns
    -------
    ndarray, shape (ny,)
        100 for a model that leaves nothing, 0 for one as good as the mean, negative for a worse one; NaN for an output
        that never changes.

    Raises
    ------
    ValueError
        Shapes that differ.

    Examples
    --------
    >>> from hoopd.ident import fit_percent
    >>> y = [1.0, -1.0, 1.0, -1.0]
    >>> fit_percent(y, [0.9, -0.9, 0.9, -0.9]).round(6), fit_percent(y, [0.0] * 4)
    (array([90.]), array([0.]))
    """
    measured, said = as_columns(y), as_columns(yhat)
    if measured.shape != said.shape:
        raise ValueError(f"measured is {measured.shape}, predicted {said.shape}")
    spread = measured - np.nanmean(measured, axis=0)
    own = np.sqrt(np.nansum(np.where(np.isfinite(said), spread, np.nan) ** 2, axis=0))
    off = np.sqrt(np.nansum((measured - said) ** 2, axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(own > 0.0, 100.0 * (1.0 - off / own), np.nan))


def nrmse(y: ArrayLike, yhat: ArrayLike) -> Array:
    """Give the error relative to the measured change, |y - yhat|/|y - mean y|.

    Parameters
    ----------
    y : array_like, shape (n,) or (n, ny)
        Measured outputs; NaN counts not.
    yhat : array_like, same shape
        Predicted or simulated outputs.

    Returns
    -------
    ndarray, shape (ny,)
        0 for a model that leaves nothing, 1 for one as good as the mean.

    Examples
    --------
    >>> from hoopd.ident import nrmse
    >>> nrmse([1.0, -1.0, 1.0, -1.0], [0.9, -0.9, 0.9, -0.9]).round(6)
    array([0.1])
    """
    return np.asarray(1.0 - fit_percent(y, yhat) / 100.0)
