"""The torque held between the nodes of a time axis, and its means over shorter or later times.

Rules of this file: numbers only. Before the first node the torque is the first, after the last node the last.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Times closer to each other are the same, s: an edge that rounding moved past a node still belongs to its hold.
SAME_S = 1e-9


def mean_torque(edges: ArrayLike, t: ArrayLike, u: ArrayLike, delay: float = 0.0) -> Array:
    """Means (..., m) of u(time - delay) between the edges (..., m + 1) s; torques u (n-1,) held from nodes t (n,) s."""
    when, t, u = np.asarray(edges, float) - delay, np.asarray(t, float), np.asarray(u, float)
    first, last = _hold(when[..., :-1] + SAME_S, t), _hold(when[..., 1:] - SAME_S, t)
    mean = np.diff(_integral(when, t, u)) / np.maximum(np.diff(when), SAME_S)
    # within one hold the mean is its torque, to the last bit
    return np.where(first >= last, u[first], mean)


def _hold(when: Array, t: Array) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(t, when, side="right") - 1, 0, len(t) - 2)


def _integral(when: Array, t: Array, u: Array) -> Array:
    """Integral of the torque from the first node, N m s."""
    sums = np.concatenate([[0.0], np.cumsum(u * np.diff(t))])
    hold = _hold(when, t)
    return np.asarray(sums[hold] + u[hold] * (when - t[hold]))
