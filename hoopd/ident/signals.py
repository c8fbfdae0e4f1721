"""Test signals for identification: PRBS, chirp, multisine, steps and kicks, and what to ask of a signal.

Rules of this file: pure and seeded, numpy only, the same arguments give the same numbers; every generator returns a
peak of one (the caller brings the amplitude and its unit), one value a tick.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi, sqrt, tau
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

Signal = NDArray[np.float64]

# Feedback taps of shift registers of maximal length (primitive polynomials over GF(2); Xilinx XAPP 052, table 3).
TAPS: Mapping[int, tuple[int, ...]] = MappingProxyType(
    {
        3: (3, 2),
        4: (4, 3),
        5: (5, 3),
        6: (6, 5),
        7: (7, 6),
        8: (8, 6, 5, 4),
        9: (9, 5),
        10: (10, 7),
        11: (11, 9),
        12: (12, 6, 4, 1),
        13: (13, 4, 3, 1),
        14: (14, 5, 3, 1),
        15: (15, 14),
        16: (16, 15, 13, 4),
    }
)


# ---------------------------------------------------------------------------------------------- generators


def prbs(order: int, clock_ticks: int = 1, seed: int = 0) -> Signal:
    """Give one period of a pseudo-random binary sequence of +-1.

    s_k = s_k-a xor s_k-b ... over the taps of `TAPS`. Over a period the sum is one value and the autocorrelation is
    that of white noise: power (sin(pi f T) / (pi f T))^2 with T the clock, empty at 1/T.

    Parameters
    ----------
    order : int
        Length of the shift register.
    clock_ticks : int
        Samples for which each value is held.
    seed : int
        Picks where in the period it begins.

    Returns
    -------
    ndarray, shape (clock_ticks * (2^order - 1),)
        The signal.

    Raises
    ------
    ValueError
        An order or clock that is none.

    Notes
    -----
    Source: Golomb, Shift Register Sequences (1967); Ljung, System Identification (1999), 13.3.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import prbs
    >>> u = prbs(order=7)
    >>> len(u), abs(int(u.sum())), int(u @ np.roll(u, 5))  # white: -1 at every lag but 0
    (127, 1, -1)
    """
    if order not in TAPS or clock_ticks < 1:
        raise ValueError(f"order must be {min(TAPS)} to {max(TAPS)} and clock_ticks at least 1")
    state = int(np.random.default_rng(seed).integers(1, 2**order))
    values = np.empty(2**order - 1)
    for k in range(len(values)):
        values[k] = 2.0 * (state & 1) - 1.0
        fed_back = sum(state >> (order - tap) for tap in TAPS[order]) & 1
        state = state >> 1 | fed_back << (order - 1)
    return np.repeat(values, clock_ticks)


def prbs_order(samples: int, clock_ticks: int) -> int:
    """The smallest order whose period lasts for `samples`; ValueError when none does."""
    for order in TAPS:
        if clock_ticks * (2**order - 1) >= samples:
            return order
    raise ValueError(f"no sequence lasts for {samples} samples at {clock_ticks} samples a value")


def chirp(samples: int, step_s: float, low_hz: float, high_hz: float, seed: int = 0) -> Signal:
    """Give a sine whose frequency rises by the same factor every second: as long on each octave.

    sin(2 pi f0 D / ln(f1/f0) ((f1/f0)^(t/D) - 1)), D the whole length.

    Parameters
    ----------
    samples : int
        Length.
    step_s : float
        Step in s.
    low_hz, high_hz : float
        First and last frequency in Hz.
    seed : int
        An odd one turns it round in sign.

    Returns
    -------
    ndarray, shape (samples,)
        The signal, peak one.

    Raises
    ------
    ValueError
        Frequencies that are not 0 < low < high <= half of the sampling frequency.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import chirp
    >>> u = chirp(3000, 0.01, 0.5, 4.0)  # three octaves, 10 s each
    >>> np.diff(np.signbit(u.reshape(3, 1000))).sum(axis=1)  # each crosses zero twice as often
    array([14, 29, 57])
    """
    _check_band(step_s, low_hz, high_hz)
    duration = samples * step_s
    t = np.arange(samples) * step_s
    ratio = high_hz / low_hz
    phase = tau * low_hz * duration / np.log(ratio) * (ratio ** (t / duration) - 1.0)
    return np.asarray(np.sin(phase if seed % 2 == 0 else -phase))


def multisine(samples: int, step_s: float, low_hz: float, high_hz: float, seed: int = 0) -> Signal:
    """Give a sum of equal sines on every line of 1/(samples step_s) from low to high; periodic, without a mean.

    u = sum_k cos(2 pi k t / D + phi_k), phi_k = -pi k (k - 1) / K: Schroeder's phases keep the crest factor below 2
    (random ones: 3 and more).

    Parameters
    ----------
    samples : int
        Length of the period.
    step_s : float
        Step in s.
    low_hz, high_hz : float
        The band in Hz.
    seed : int
        Turns the period in time, which changes neither spectrum nor crest.

    Returns
    -------
    ndarray, shape (samples,)
        The signal, peak one.

    Raises
    ------
    ValueError
        A band without a line.

    Notes
    -----
    Source: M. R. Schroeder, Synthesis of low-peak-factor signals, IEEE Trans. Inf. Theory 16 (1970).

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import crest_factor, multisine
    >>> u = multisine(1000, 0.01, 0.5, 2.0)
    >>> lines = np.flatnonzero(np.abs(np.fft.rfft(u)) > 1e-6)  # of 0.1 Hz
    >>> lines.min().item(), lines.max().item(), crest_factor(u) < 2.0
    (5, 20, True)
    """
    _check_band(step_s, low_hz, high_hz)
    duration = samples * step_s
    lines = np.arange(max(1, int(np.ceil(low_hz * duration - 1e-9))), int(np.floor(high_hz * duration + 1e-9)) + 1)
    if len(lines) == 0 or 2 * lines[-1] >= samples:
        raise ValueError(f"{samples} samples of {step_s:g} s have no line between {low_hz:g} and {high_hz:g} Hz")
    k = np.arange(1, len(lines) + 1)
    spectrum = np.zeros(samples // 2 + 1, complex)
    spectrum[lines] = np.exp(-1j * pi * k * (k - 1) / len(lines))
    u = np.fft.irfft(spectrum, samples)
    return np.roll(u / np.abs(u).max(), int(np.random.default_rng(seed).integers(samples)))


def steps(samples: int, hold_ticks: int, seed: int = 0) -> Signal:
    """Give pairs of steps, up and down again by the same amount with rests between; what is left over is rest.

    One block is (+a, 0, -a, 0), so that an integrator ends each block where it began; `a` runs through 1, 0.5 and 0.75
    with a seeded sign.

    Parameters
    ----------
    samples : int
        Length.
    hold_ticks : int
        Samples of each quarter of a block.
    seed : int
        Of the signs.

    Returns
    -------
    ndarray, shape (samples,)
        The signal, peak one.

    Raises
    ------
    ValueError
        Not one block fits.

    Examples
    --------
    >>> from hoopd.ident import steps
    >>> u = steps(24, hold_ticks=2)
    >>> abs(u[::2]), u.sum().item()
    (array([1.  , 0.  , 1.  , 0.  , 0.5 , 0.  , 0.5 , 0.  , 0.75, 0.  , 0.75,
           0.  ]), 0.0)
    """
    blocks = _blocks(samples, 4 * hold_ticks)
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), blocks)
    levels = signs * np.resize((1.0, 0.5, 0.75), blocks)
    shape = np.repeat((1.0, 0.0, -1.0, 0.0), hold_ticks)
    return _padded((levels[:, None] * shape).ravel(), samples)


def kicks(samples: int, kick_ticks: int, rest_ticks: int, seed: int = 0) -> Signal:
    """A kick of `kick_ticks` and then nothing for `rest_ticks`, again and again with turning sign, (samples,).

    The rests show the free decay of ball and hoop; only whole kicks with their rests are played, an odd seed begins
    with the other sign. ValueError when not one fits.
    """
    repeats = _blocks(samples, kick_ticks + rest_ticks)
    signs = (-1.0) ** (np.arange(repeats) + seed)
    shape = np.concatenate((np.ones(kick_ticks), np.zeros(rest_ticks)))
    return _padded((signs[:, None] * shape).ravel(), samples)


# ---------------------------------------------------------------------------------------------- what to ask of one


def crest_factor(u: ArrayLike) -> float:
    """Give the largest |u| over the root of the mean square.

    Parameters
    ----------
    u : array_like, shape (n,)
        A signal.

    Returns
    -------
    float
        1 for two levels, sqrt 2 for a sine; NaN for nothing at all.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import crest_factor
    >>> crest_factor([1.0, -1.0, -1.0]), round(crest_factor(np.sin(np.arange(1000))), 2)
    (1.0, 1.41)
    """
    values = np.asarray(u, float)
    rms = sqrt(float(np.mean(values**2))) if values.size else 0.0
    return float(np.abs(values).max()) / rms if rms > 0.0 else float("nan")


def balance(u: ArrayLike) -> float:
    """Sum over the sum of magnitudes, -1 to 1: 0 when as much goes one way as the other."""
    values = np.asarray(u, float)
    total = float(np.abs(values).sum())
    return float(values.sum()) / total if total > 0.0 else 0.0


def spectrum(u: ArrayLike, step_s: float) -> tuple[Signal, Signal]:
    """Frequencies in Hz and the power on each (unit of u squared), one-sided: the powers add up to the mean square."""
    values = np.asarray(u, float)
    power = np.abs(np.fft.rfft(values)) ** 2 / len(values) ** 2
    power[1 : (len(values) + 1) // 2] *= 2.0
    return np.asarray(np.fft.rfftfreq(len(values), step_s), float), power


def coverage(u: ArrayLike, step_s: float, share: float = 0.9) -> tuple[float, float]:
    """Frequencies in Hz between which the middle `share` of the signal's power lies, its mean left out."""
    frequency, power = spectrum(u, step_s)
    total = np.cumsum(power[1:])
    if len(total) == 0 or total[-1] <= 0.0:
        return float("nan"), float("nan")
    low, high = np.searchsorted(total / total[-1], (0.5 * (1.0 - share), 0.5 * (1.0 + share)))
    return float(frequency[1 + low]), float(frequency[min(1 + high, len(frequency) - 1)])


# ---------------------------------------------------------------------------------------------- inside


def _check_band(step_s: float, low_hz: float, high_hz: float) -> None:
    if not 0.0 < low_hz < high_hz <= 0.5 / step_s:
        raise ValueError(f"needs 0 < low < high <= {0.5 / step_s:g} Hz, got {low_hz:g} and {high_hz:g}")


def _blocks(samples: int, block: int) -> int:
    if block < 1 or samples < block:
        raise ValueError(f"{samples} samples are too short for one of {block}")
    return samples // block


def _padded(values: Signal, samples: int) -> Signal:
    return np.concatenate((values, np.zeros(samples - len(values))))
