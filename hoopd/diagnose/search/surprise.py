"""How much of a gain in log-likelihood is left when it is told how often, and how freely, was looked.

A change of m columns gains chi2_m / 2 nats by chance, the best of k such changes more: the surprise of a gain is
-log P(best of k chance gains >= gain), so that an effect with one number, one with phases and a grid, and a curve with
a dozen knots stand on one scale (nats).

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

from math import lgamma

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import gammaincc

Array = NDArray[np.float64]

# A library of some forty effects and a chance of 1 in 100 ask for log(40 / 0.01) = 8.3 nats; the rest is for
# disturbances that are no Ornstein-Uhlenbeck process (docs/explanations/concealed.md: how often nulls are named).
THRESHOLD = 12.0
# gammaincc holds its digits above this; below it the continued fraction does.
SMALLEST = 1e-200
FRACTION_STEPS = 60


def surprise(gain: float, columns: int, looked_at: float = 1) -> float:
    """Nats; 0 for a gain that chance gives."""
    if gain <= 0.0:
        return 0.0
    return max(0.0, -log_chance(gain, max(columns, 1)) - float(np.log(looked_at)))


def needed_gain(wanted: float, columns: int, looked_at: float = 1) -> float:
    """The gain (nats) that has this surprise: what a gain is to be compared with."""
    high = wanted + columns + float(np.log(looked_at)) + 1.0
    while surprise(high, columns, looked_at) < wanted:
        high *= 2.0
    return float(brentq(lambda gain: surprise(gain, columns, looked_at) - wanted, 0.0, high))


def log_chance(gain: float, columns: int) -> float:
    """log P(a chance gain of so many columns >= gain)."""
    return float(log_chances(np.array(gain), columns))


def log_chances(gains: Array, columns: int) -> Array:
    """(...,) log P(chi2_m / 2 >= gain): twice a chance gain is chi-square (Wilks 1938).

    The logarithm of the regularised upper incomplete gamma function Q(m/2, gain).
    """
    gains = np.asarray(gains, dtype=float)
    if columns <= 0:
        return np.zeros(gains.shape)
    a = columns / 2.0
    chances = np.asarray(gammaincc(a, np.maximum(gains, 0.0)))
    far = chances <= SMALLEST
    found = np.array(np.log(np.where(far, 1.0, chances)))
    if far.any():
        found[far] = _log_tail(gains[far], a)
    return found


def _log_tail(x: Array, a: float) -> Array:
    """log Q(a, x) far beyond a."""
    # Q(a, x) = e^-x x^a / Gamma(a) / (x+1-a- 1(1-a)/(x+3-a- 2(2-a)/(x+5-a- ...)))  (Abramowitz, Stegun 6.5.31)
    value = x + 2 * FRACTION_STEPS + 1.0 - a
    for k in range(FRACTION_STEPS, 0, -1):
        value = x + 2 * k - 1.0 - a - k * (k - a) / value
    return np.asarray(-x + a * np.log(x) - lgamma(a) - np.log(value))
