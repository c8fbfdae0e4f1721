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
    """The beginning of a PRBS that lasts so long, between two levels, each value held for `clock_ticks`.

    Over a whole period it is balanced and white up to the clock, a part of one is so roughly: choose 2^k - 1 clocks.
    What is longer than the longest period (65,535 clocks) begins again.
    """
    if samples < 1:
        return np.zeros(0)
    whole = prbs(prbs_order(min(samples, LONGEST * clock_ticks), clock_ticks), clock_ticks, seed)
    return low + (high - low) * 0.5 * (1.0 + np.resize(whole, samples))


def linear_chirp(samples: int, step_s: float, low_hz: float, high_hz: float) -> Signal:
    """Sine whose frequency rises evenly from low to high, (samples,): as much power on each Hz.

    sin(2 pi (f0 t + (f1 - f0) t^2 / (2 D))). ValueError for frequencies that are not 0 < low < high <= half of 1/step.
    """
    if not 0.0 < low_hz < high_hz <= 0.5 / step_s:
        raise ValueError(f"needs 0 < low < high <= {0.5 / step_s:g} Hz, got {low_hz:g} and {high_hz:g}")
    t = step_s * np.arange(samples)
    rate = (high_hz - low_hz) / max(samples * step_s, step_s)
    return np.asarray(np.sin(2.0 * np.pi * (low_hz * t + 0.5 * rate * t**2)))


def step(samples: int, step_s: float, at_s: float, amplitude: float = 1.0, offset: float = 0.0) -> Signal:
    """`offset`, and `amplitude` more from the first sample at or after `at_s`; ValueError when that is not within."""
    first = int(np.ceil(at_s / step_s - 1e-9))
    if samples and not 0 <= first < samples:
        raise ValueError(f"the step at {at_s:g} s is not within {samples} samples of {step_s:g} s")
    u = np.full(samples, offset, dtype=float)
    u[first:] += amplitude
    return u


def low_crest(samples: int, step_s: float, frequencies_hz: Sequence[float], amplitudes: ArrayLike = 1.0) -> Signal:
    """Sum of sines with the given amplitudes and phases that keep its peak low, scaled to a peak of one, (samples,).

    The p-norms of u for p = 4, 8 .. 256 are lowered one after the other, from Schroeder's phases and a few others; the
    lowest peak is taken. ValueError for frequencies that are no lines of 1/(samples step_s) below half of 1/step_s:
    only those are periodic.
    Sources: Schroeder, IEEE Trans. IT 16 (1970); Guillaume, Schoukens, Pintelon, Kollar, Crest-factor minimization
    using nonlinear Chebyshev approximation methods, IEEE Trans. IM 40 (1991).
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


class Excitation(NamedTuple):
    """Order up to which a signal excites, condition number of its correlation matrix of `most` lags, crest factor."""

    order: int
    condition: float
    crest: float


def excitation(u: ArrayLike, most: int = 50) -> Excitation:
    """How many parameters a signal can tell apart: the rank of the correlation matrix of its lags, `most` at most.

    A constant has order 1, k sines 2 k, a PRBS of order n 2^n - 1, white noise any. Source: Ljung 1999, 13.2.
    """
    values = np.asarray(u, dtype=float).reshape(-1)
    size = min(most, (len(values) + 1) // 2)
    if not size or not np.any(values):
        return Excitation(0, float("inf"), float("nan"))
    lags = sliding_window_view(values, size)
    eigenvalues = np.linalg.eigvalsh(lags.T @ lags / len(lags))
    order = int(np.sum(eigenvalues > EXCITED * eigenvalues[-1]))
    rounding = np.finfo(float).eps * size * eigenvalues[-1]
    return Excitation(order, float(eigenvalues[-1] / max(eigenvalues[0], rounding)), crest_factor(values))


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
