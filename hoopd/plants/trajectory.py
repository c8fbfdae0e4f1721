"""A free run with its derivatives, as every model of a plant gives it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Trajectory(NamedTuple):
    """What a run gives at its nodes (k states or readings), with derivatives by free parameters and initial state."""

    x: Array  # (n, k)
    by_parameters: Array  # (n, k, m)
    by_start: Array  # (n, k, nx)
