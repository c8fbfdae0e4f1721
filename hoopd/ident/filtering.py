"""Data of another band or another rate, and models of another rate.

Rules of this file: outputs and inputs go through the same filter, so the dynamics between them stay the same; a gap in
an output is an error, a filter would smear it; frequencies in Hz, as a recording speaks of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg, signal

from hoopd.ident.data import Data, iddata
from hoopd.ident.discretization import c2d, d2c
from hoopd.ident.gaps import whole
from hoopd.ident.statespace.sampling import sampled_noise, unsampled_noise

Array = NDArray[np.float64]
Band = tuple[float, float]

# Largest whole number of a ratio of rates: 44.1 kHz to 48 kHz is 160/147.
LARGEST = 1000


def prefilter(data: Data, *bands_hz: Band, order: int = 2, stop: bool = False) -> Data:
    """Keep what lies within bands, by Butterworth filters run forwards and backwards (no phase).

    The gain at a corner is 1/2 (1/sqrt 2 each way), the slope 2 x `order`.

    Parameters
    ----------
    data : Data
        One experiment without gaps.
    *bands_hz : tuple of float
        Bands (low, high) in Hz: low <= 0 is a low-pass, high = inf a high-pass; several pass together, those that
        overlap as one.
    order : int
        Order of each filter.
    stop : bool
        Keep what lies outside instead.

    Returns
    -------
    Data
        Outputs and inputs through the same filter.

    Raises
    ------
    ValueError
        Bands that are none below half of the sampling frequency, gaps, too few samples.

    Notes
    -----
    Source: F. Gustafsson, Determining the initial states in forward-backward filtering, IEEE Trans. SP 44 (1996).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, prefilter
    >>> t = 0.01 * np.arange(1000)
    >>> slow, fast = np.sin(2 * np.pi * t), np.sin(2 * np.pi * 20.0 * t)
    >>> kept = prefilter(iddata(slow + fast, dt=0.01), (0.0, 5.0))
    >>> float(np.abs(kept.y[:, 0] - slow)[100:-100].max().round(2))
    0.0
    """
    each = _united(bands_hz, data.fs)
    done = whole(data, "prefilter")

    def passed(values: Array) -> Array:
        kept = sum((_both_ways(_sections(one, order, data.fs), values) for one in each), np.zeros_like(values))
        return values - kept if stop else kept

    return _mapped(done, passed)


def idfilt(data: Data, numerator: ArrayLike | ct.TransferFunction, denominator: ArrayLike | None = None) -> Data:
    """Filter outputs and inputs, one way and from rest.

    Parameters
    ----------
    data : Data
        One experiment without gaps.
    numerator : array_like or control.TransferFunction
        Coefficients in q^-1, or a discrete system of one input and output with the step of the data.
    denominator : array_like, optional
        Coefficients in q^-1, 1 of a moving average; none beside a system.

    Returns
    -------
    Data
        The result.

    Raises
    ------
    ValueError
        A gap, a denominator that begins with 0 or is unstable, a system that is no filter, coefficients without a
        denominator (two numbers might be a band: that is `prefilter`).

    Examples
    --------
    >>> from hoopd.ident import idfilt, iddata
    >>> idfilt(iddata([1.0, 2.0, 4.0]), [1.0, -1.0], 1.0).y[:, 0]  # differences
    array([1., 1., 2.])
    """
    if isinstance(numerator, ct.TransferFunction):
        num, den = _coefficients(numerator, data)
    elif denominator is None:
        raise ValueError(
            "coefficients in q^-1 want a denominator too (1 of a moving average); a band is prefilter(data, (low_hz, "
            "high_hz))"
        )
    else:
        num, den = np.atleast_1d(np.asarray(numerator, float)), np.atleast_1d(np.asarray(denominator, float))
    if den[0] == 0.0:
        raise ValueError("the denominator begins with 0: that filter would need the future")
    if (radius := float(np.abs(np.roots(den)).max(initial=0.0))) >= 1.0:
        raise ValueError(f"the filter is unstable: its denominator in q^-1 has a root of modulus {radius:.3g}")
    return _mapped(whole(data, "filter"), lambda values: np.asarray(signal.lfilter(num, den, values, axis=0)))


def resample(data: Data, ratio: float) -> Data:
    """Bring data to another rate, behind a linear-phase FIR that lets no image or alias through.

    The ends are continued in the line between first and last sample. Where a held input is to stay held, take every
    k-th sample: data[::k].

    Parameters
    ----------
    data : Data
        One experiment without gaps.
    ratio : float
        New rate over old rate, a fraction of whole numbers up to 1000.

    Returns
    -------
    Data
        The data at the new step.

    Raises
    ------
    ValueError
        A ratio that is no such fraction, or a gap.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import iddata, resample
    >>> done = resample(iddata(np.sin(0.1 * np.arange(200)), dt=0.01), 0.5)
    >>> done.n, done.dt
    (100, 0.02)
    """
    fraction = Fraction(ratio).limit_denominator(LARGEST)
    if ratio <= 0.0 or fraction.numerator > LARGEST or abs(float(fraction) - ratio) > 1e-9 * ratio:
        raise ValueError(f"a rate changes by a fraction of whole numbers up to {LARGEST}, not by {ratio}")
    up, down = fraction.numerator, fraction.denominator
    done = whole(data, "resample")

    def moved(values: Array) -> Array:
        return np.asarray(signal.resample_poly(values, up, down, axis=0, padtype="line"))

    x = None if done.x is None else moved(done.x)
    return iddata(
        moved(done.y), moved(done.u) if done.nu else None, data.dt * down / up,
        t0=data.t0, x=x, outputs=data.outputs, inputs=data.inputs if data.nu else None,
    )  # fmt: skip


def resample_system(system: Any, dt: float) -> ct.StateSpace | ct.TransferFunction:
    """Give a discrete system at another step, its input held: to continuous time by the matrix logarithm, and back.

    Parameters
    ----------
    system : control.StateSpace, control.TransferFunction or a result
        A discrete system; of a result of this package its `system` from u to y (`d2d` brings the noise along).
    dt : float
        New step in s.

    Returns
    -------
    control.StateSpace or control.TransferFunction
        The system at the new step.

    Raises
    ------
    ValueError
        A pole at or left of 0 (a delay, an alias): no real continuous system has it; a system that is continuous or has
        no sample time.

    Examples
    --------
    >>> import control
    >>> from hoopd.ident import resample_system
    >>> slower = resample_system(control.ss([[0.9]], [[1.0]], [[1.0]], [[0.0]], 0.1), 0.2)
    >>> slower.A.round(6), slower.B.round(6)  # 0.9 ** 2 and 1 + 0.9
    (array([[0.81]]), array([[1.9]]))
    """
    return c2d(d2c(getattr(system, "system", system), "zoh"), dt, "zoh")


def resample_covariance(a: ArrayLike, q: ArrayLike, dt: float, new_dt: float) -> Array:
    """Give the covariance of white process noise over another step.

    By way of the density of the continuous noise, F = log(a)/dt.

    Parameters
    ----------
    a : array_like, shape (nx, nx)
        Dynamics over `dt`, x+ = a x + w.
    q : array_like, shape (nx, nx)
        Covariance of w.
    dt : float
        Step in s of a and q.
    new_dt : float
        Step in s of the result.

    Returns
    -------
    ndarray, shape (nx, nx)
        Covariance of the noise over `new_dt`.

    Examples
    --------
    >>> from hoopd.ident import resample_covariance
    >>> resample_covariance([[0.9]], [[1.0]], dt=0.1, new_dt=0.2).round(6)  # 1 + 0.9 ** 2
    array([[1.81]])
    """
    rate = np.real(linalg.logm(np.asarray(a, float))) / dt
    return sampled_noise(rate, unsampled_noise(rate, np.asarray(q, float), dt), new_dt)


# ---------------------------------------------------------------------------------------------- inside


def _united(bands_hz: Sequence[Band], fs: float) -> list[Band]:
    if not bands_hz:
        raise ValueError("no band given: prefilter(data, (low_hz, high_hz))")
    united: list[Band] = []
    for low, high in sorted((max(low, 0.0), high) for low, high in bands_hz):
        if not low < high or low >= 0.5 * fs:
            raise ValueError(f"a band needs low < high and low < {0.5 * fs:g} Hz, not {low:g} to {high:g}")
        if united and low <= united[-1][1]:
            united[-1] = (united[-1][0], max(united[-1][1], high))
        else:
            united.append((low, high))
    return united


def _sections(band: Band, order: int, fs: float) -> Array | None:
    """Second-order sections of one band; None for the band that holds everything."""
    low, high = band
    if low <= 0.0 and high >= 0.5 * fs:
        return None
    if low <= 0.0:
        return np.asarray(signal.butter(order, high, "lowpass", fs=fs, output="sos"))
    if high >= 0.5 * fs:
        return np.asarray(signal.butter(order, low, "highpass", fs=fs, output="sos"))
    return np.asarray(signal.butter(order, band, "bandpass", fs=fs, output="sos"))


def _both_ways(sections: Array | None, values: Array) -> Array:
    if sections is None or not values.size:
        return values
    shortest = 3 * (2 * len(sections) + 1)
    if len(values) <= shortest:
        raise ValueError(f"{len(values)} samples are too few to filter both ways: more than {shortest}")
    return np.asarray(signal.sosfiltfilt(sections, values, axis=0))


def _mapped(data: Data, change: Callable[[Array], Array]) -> Data:
    return iddata(
        change(data.y), change(data.u) if data.nu else None, data.dt, t0=data.t0,
        outputs=data.outputs, inputs=data.inputs if data.nu else None,
    )  # fmt: skip


def _coefficients(system: ct.TransferFunction, data: Data) -> tuple[Array, Array]:
    if not system.issiso() or not system.dt or (system.dt is not True and not np.isclose(system.dt, data.dt, atol=0.0)):
        raise ValueError(f"a filter is a discrete system of one input and output with a step of {data.dt} s")
    num, den = np.asarray(system.num[0][0], float), np.asarray(system.den[0][0], float)
    return np.concatenate([np.zeros(max(len(den) - len(num), 0)), num]), den
