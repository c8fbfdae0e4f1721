"""How well a simulation repeats a measurement, in percent.

Rules of this file: numbers only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def nrmse_percent(measured: Array, simulated: Array) -> float:
    """100 (1 - |y - yhat| / |y - mean y|); NaN for fewer than two values or a constant."""
    if len(measured) < 2:
        return float("nan")
    spread = float(np.linalg.norm(measured - measured.mean()))
    return 100.0 * (1.0 - float(np.linalg.norm(measured - simulated)) / spread) if spread > 0.0 else float("nan")
