"""How much of a gain in log-likelihood is left when it is told how often, and how freely, was looked.

A change of m columns gains chi2_m / 2 nats by chance, the best of k such changes more: the surprise of a gain is
-log P(best of k chance gains >= gain), so that an effect with one number, one with phases and a grid, and a curve with a
dozen knots stand on one scale (nats).

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

# Surprise that a library of some forty effects reaches by chance in less than one of a hundred recordings; raised by
# what disturbances that are no Ornstein-Uhlenbeck process add (measured on tuning cases, docs/diagnose.md).
THRESHOLD = 12.0


def surprise(gain: float, columns: int, looked_at: int = 1) -> float:
    """Nats; 0 for a gain that chance gives."""
    if gain <= 0.0:
        return 0.0
    log_p = float(chi2.logsf(2.0 * gain, max(columns, 1)))
    if not np.isfinite(log_p):  # beyond the table: the tail's own law, -gain + (m/2 - 1) log gain
        log_p = -gain + (columns / 2.0 - 1.0) * float(np.log(gain))
    return max(0.0, -log_p - float(np.log(looked_at)))
