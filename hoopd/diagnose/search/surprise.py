"""How much of a gain in log-likelihood is left when it is told how often, and how freely, was looked.

A change of m columns gains chi2_m / 2 nats by chance, the best of k such changes more: the surprise of a gain is
-log P(best of k chance gains >= gain), so that an effect with one number, one with phases and a grid, and a curve with
a dozen knots stand on one scale (nats).

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaincc, gammaln, log_ndtr

# A library of some forty effects and a chance of 1 in 100 ask for log(40 / 0.01) = 8.3 nats; the rest is for
# disturbances that are no Ornstein-Uhlenbeck process (docs/concealed.md: how often nulls are called something).
THRESHOLD = 12.0
# Nats above which the tail of a chi-square comes near the smallest number there is.
GAMMA_HOLDS = 500.0


def surprise(gain: float, columns: int, looked_at: float = 1) -> float:
    """Nats; 0 for a gain that chance gives."""
    if gain <= 0.0:
        return 0.0
    return max(0.0, -log_chance(gain, max(columns, 1)) - float(np.log(looked_at)))


def log_chance(gain: float, columns: int) -> float:
    """log P(a chance gain of so many columns >= gain): twice that gain is chi-square (Wilks 1938)."""
    gain, a = max(gain, 0.0), columns / 2.0
    if columns == 1:
        # P = 2 Phi(-sqrt(2 gain))
        return float(np.log(2.0) + log_ndtr(-np.sqrt(2.0 * gain)))
    if gain < GAMMA_HOLDS:
        return float(np.log(gammaincc(a, gain)))
    # Gamma(a, x) = x^(a-1) e^-x (1 + (a-1)/x + ...), Abramowitz and Stegun 6.5.32
    return float((a - 1.0) * np.log(gain) - gain - gammaln(a) + np.log1p((a - 1.0) / gain))
