"""A motor by the midpoint rule, for recordings whose drive or friction changes whenever it likes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLE_S, PARTS = 0.01, 10


def levels(random: np.random.Generator, values: Sequence[float], held: int, n: int) -> Array:
    """(n-1,) one of the values for so many samples, then another one."""
    return np.repeat(random.choice(values, n // held + 1), held)[: n - 1]


def turned(
    n: int, moment: Callable[[int, int, float], float], inertia: float, parts: int = PARTS
) -> tuple[Array, Array]:
    """Angle (rad) and speed (rad/s) of n samples from rest, (n-1, parts) each: at the end of each part of a sample.

    `moment`: of the sample, the part and the speed, N m.
    """
    h, th, w = SAMPLE_S / parts, 0.0, 0.0
    angle, speed = np.zeros((n - 1, parts)), np.zeros((n - 1, parts))
    for k in range(n - 1):
        for part in range(parts):
            middle = w + h / 2.0 * moment(k, part, w) / inertia
            th, w = th + h * middle, w + h * moment(k, part, middle) / inertia
            angle[k, part], speed[k, part] = th, w
    return angle, speed


def sampled(fine: Array) -> Array:
    """(n,) at the samples, 0 at the first one."""
    return np.append(0.0, fine[:, -1])
