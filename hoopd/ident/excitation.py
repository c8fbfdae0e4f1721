"""Inputs for experiments off line, beside the test signals of the daemon (`signals.py`), and what they can identify.

From there: `prbs` of maximal length, `chirp` with as long on each octave, `multisine` of equal lines, `steps`, `kicks`,
`crest_factor`, `spectrum`, `coverage`. Here: two levels of any length, sines of one's own choice with a low crest, the
chirp that is linear in time, one step, and the order up to which a signal excites.

Rules of this file: the same arguments give the same numbers, no generator outside is touched; samples (n,) at a step in
s, frequencies in Hz.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from hoopd.ident.signals import TAPS, crest_factor, prbs, prbs_order

Signal = NDArray[np.float64]

# Norms of u that are lowered one after the other, each nearer to the peak itself, by so many steps at most.
NORMS = (4, 8, 16, 32, 64, 128, 256)
STEPS = 60
# Starts beside Schroeder's phases.
TRIES = 3
# Eigenvalue of the correlation matrix, beside the largest, below which a direction counts as not excited.
EXCITED = 1e-6
LONGEST = 2 ** max(TAPS) - 1


def two_levels(samples: int, clock_ticks: int = 1, low: float = -1.0, high: float = 1.0, seed: int = 0) -> Signal:
    """Give the beginning of a PRBS that lasts so long, between two levels.

    Over a whole period it is balanced and white up to the clock, a part of one is so roughly: choose 2^k - 1 clocks.
    What is longer than the longest period (65,535 clocks) begins again.

    Parameters
    ----------
    samples : int
        Length.
    clock_ticks : int
        Samples for which each value is held.
    low, high : float
        The two levels.
    seed : int
        Picks where in the period it begins.

    Returns
    -------
    ndarray, shape (samples,)
        The signal.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import two_levels
    >>> u = two_levels(62, clock_ticks=2, low=0.0, high=5.0)
    >>> np.unique(u), len(u)
    (array([0., 5.]), 62)
    """
    if samples < 1:
        return np.zeros(0)
    whole = prbs(prbs_order(min(samples, LONGEST * clock_ticks), clock_ticks), clock_ticks, seed)
    return low + (high - low) * 0.5 * (1.0 + np.resize(whole, samples))


def linear_chirp(samples: int, step_s: float, low_hz: float, high_hz: float) -> Signal:
    """Give a sine whose frequency rises evenly from low to high: as much power on each Hz.

    sin(2 pi (f0 t + (f1 - f0) t^2 / (2 D))), D the whole length.

    Parameters
    ----------
    samples : int
        Length.
    step_s : float
        Step in s.
    low_hz, high_hz : float
        First and last frequency in Hz.

    Returns
    -------
    ndarray, shape (samples,)
        The signal, peak one.

    Raises
    ------
    ValueError
        Frequencies that are not 0 < low < high <= half of 1/step.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import linear_chirp
    >>> u = linear_chirp(1000, 0.01, 1.0, 5.0)  # 3 Hz on average, for 10 s
    >>> round(np.count_nonzero(np.diff(np.signbit(u[1:]))) / 2)
    30
    """
    if not 0.0 < low_hz < high_hz <= 0.5 / step_s:
        raise ValueError(f"needs 0 < low < high <= {0.5 / step_s:g} Hz, got {low_hz:g} and {high_hz:g}")
    t = step_s * np.arange(samples)
    rate = (high_hz - low_hz) / max(samples * step_s, step_s)
    return np.asarray(np.sin(2.0 * np.pi * (low_hz * t + 0.5 * rate * t**2)))


def step(samples: int, step_s: float, at_s: float, amplitude: float = 1.0, offset: float = 0.0) -> Signal:
    """Give a step: `offset`, and `amplitude` more from the first sample at or after `at_s`.

    Parameters
    ----------
    samples : int
        Length.
    step_s : float
        Step in s.
    at_s : float
        Time of the step in s.
    amplitude, offset : float
        Its size, and the level before it.

    Returns
    -------
    ndarray, shape (samples,)
        The signal.

    Raises
    ------
    ValueError
        A time that is not within.

    Examples
    --------
    >>> from hoopd.ident import step
    >>> step(6, step_s=0.1, at_s=0.3, amplitude=2.0)
    array([0., 0., 0., 2., 2., 2.])
    """
    first = int(np.ceil(at_s / step_s - 1e-9))
    if samples and not 0 <= first < samples:
        raise ValueError(f"the step at {at_s:g} s is not within {samples} samples of {step_s:g} s")
    u = np.full(samples, offset, dtype=float)
    u[first:] += amplitude
    return u


def low_crest(samples: int, step_s: float, frequencies_hz: Sequence[float], amplitudes: ArrayLike = 1.0) -> Signal:
    """Give a sum of sines with the given amplitudes and with phases that keep its peak low.

    The p-norms of u for p = 4, 8 .. 256 are lowered one after the other, from Schroeder's phases and a few others; the
    lowest peak is taken.

    Parameters
    ----------
    samples : int
        Length of the period.
    step_s : float
        Step in s.
    frequencies_hz : sequence of float
        Lines of 1/(samples step_s) below half of 1/step_s in Hz: only those are periodic.
    amplitudes : float or array_like
        One for all, or one each, before the scaling.

    Returns
    -------
    ndarray, shape (samples,)
        The signal, peak one.

    Raises
    ------
    ValueError
        A frequency that is no such line, an amplitude that is not positive.

    Notes
    -----
    Sources: Schroeder, IEEE Trans. IT 16 (1970); Guillaume, Schoukens, Pintelon, Kollar, IEEE Trans. IM 40 (1991).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import crest_factor, low_crest
    >>> t, lines = 0.01 * np.arange(50), [2.0, 4.0, 6.0]
    >>> in_phase = sum(np.cos(2 * np.pi * f * t) for f in lines)
    >>> bool(crest_factor(low_crest(50, 0.01, lines)) < 0.75 * crest_factor(in_phase))
    True
    """
    lines = _lines(samples, step_s, frequencies_hz)
    size = np.broadcast_to(np.asarray(amplitudes, dtype=float), lines.shape)
    if not (np.isfinite(size).all() and (size > 0.0).all()):
        raise ValueError("amplitudes must be positive")
    power = size**2 / np.sum(size**2)
    # Schroeder: phi_k = -2 pi sum_j<k (k - j) p_j, the group delay runs through the period as the power does
    first = -2.0 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(power))[:-1]])
    rng = np.random.default_rng(0)
    starts = [first, *(2.0 * np.pi * rng.random((TRIES, len(lines))))]
    each = (_lowered(samples, lines, size, phases) for phases in starts)
    best = min(each, key=lambda u: float(np.abs(u).max()))
    return np.asarray(best / np.abs(best).max())


class ExcitationOrder(NamedTuple):
    """Order up to which a signal excites, condition number of its correlation matrix of `most` lags, crest factor."""

    order: int
    condition: float
    crest: float


def excitation(u: ArrayLike, most: int = 50) -> ExcitationOrder:
    """How many parameters a signal can tell apart: the rank of the correlation matrix of its lags, `most` at most.

    A constant has order 1, k sines 2 k, a PRBS of order n 2^n - 1, white noise any. Source: Ljung 1999, 13.2.
    """
    values = np.asarray(u, dtype=float).reshape(-1)
    size = min(most, (len(values) + 1) // 2)
    if not size or not np.any(values):
        return ExcitationOrder(0, float("inf"), float("nan"))
    lags = sliding_window_view(values, size)
    eigenvalues = np.linalg.eigvalsh(lags.T @ lags / len(lags))
    order = int(np.sum(eigenvalues > EXCITED * eigenvalues[-1]))
    rounding = np.finfo(float).eps * size * eigenvalues[-1]
    return ExcitationOrder(order, float(eigenvalues[-1] / max(eigenvalues[0], rounding)), crest_factor(values))


def _lines(samples: int, step_s: float, frequencies_hz: Sequence[float]) -> NDArray[np.intp]:
    wanted = np.asarray(frequencies_hz, dtype=float) * samples * step_s
    lines = np.rint(wanted).astype(np.intp)
    if not len(lines) or (np.diff(lines) <= 0).any() or (np.abs(wanted - lines) > 1e-6 * np.maximum(lines, 1)).any():
        spacing = 1.0 / (samples * step_s) if samples else float("inf")
        raise ValueError(f"frequencies must rise and be whole multiples of {spacing:g} Hz")
    if lines[0] < 1 or 2 * lines[-1] >= samples:
        raise ValueError(f"frequencies must lie between 0 and {0.5 / step_s:g} Hz, both left out")
    return lines


def _lowered(samples: int, lines: NDArray[np.intp], size: Signal, phases: Signal) -> Signal:
    for norm in NORMS:
        own = (samples, lines, size, norm)
        phases = optimize.minimize(_norm, phases, own, jac=True, method="L-BFGS-B", options={"maxiter": STEPS}).x
    return _sum(samples, lines, size * np.exp(1j * phases))


def _norm(phases: Signal, samples: int, lines: NDArray[np.intp], size: Signal, p: int) -> tuple[float, Signal]:
    """log (sum |u|^p)^(1/p) and its gradient: du/dphi_k = -(2/n) size_k sin(w_k t + phi_k)."""
    turned = np.exp(1j * phases)
    u = _sum(samples, lines, size * turned)
    peak = float(np.abs(u).max())
    powers = np.abs(u / peak) ** (p - 1) * np.sign(u)
    total = float(np.sum(powers * u) / peak)
    slope = np.fft.rfft(powers / (total * peak))[lines].conj()
    return np.log(peak) + np.log(total) / p, -2.0 / samples * size * np.imag(turned * slope)


def _sum(samples: int, lines: NDArray[np.intp], values: NDArray[np.complex128]) -> Signal:
    spectrum = np.zeros(samples // 2 + 1, complex)
    spectrum[lines] = values
    return np.fft.irfft(spectrum, samples)
