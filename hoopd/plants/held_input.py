"""The inputs held between the nodes of a time axis, and their means over shorter or later times.

Rules of this file: numbers only. Before the first node the torque is the first, after the last node the last.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# Times closer to each other are the same, s: an edge that rounding moved past a node still belongs to its hold.
SAME_S = 1e-9


def node_axis(t: ArrayLike, u: ArrayLike | None = None, inputs: int = 1) -> tuple[Array, Array, Array]:
    """Nodes (n,), inputs (n-1,) or (n-1, inputs) and distances (n-1,); ValueError when they do not fit.

    A plant without an input needs no `u`.
    """
    t = np.asarray(t, float)
    u = np.zeros(max(len(t) - 1, 0)) if u is None and inputs == 0 else np.asarray(u, float)
    form = (len(t) - 1,) if inputs < 2 else (len(t) - 1, inputs)
    if t.ndim != 1 or len(t) < 2 or u.shape != form:
        wanted = "n - 1 torques" if inputs < 2 else f"n - 1 rows of {inputs} inputs"
        raise ValueError(f"expected n nodes and {wanted}, not {t.shape} and {u.shape}")
    h = np.diff(t)
    if not (h > 0.0).all():
        raise ValueError("the nodes must increase")
    return t, u, h


def mean_inputs(edges: Array, t: Array, u: Array, delay: float = 0.0) -> Array:
    """`mean_torque` of every input side by side, (..., m inputs); only the first one is late."""
    if u.ndim == 1:
        return mean_torque(edges, t, u, delay)
    return np.concatenate([mean_torque(edges, t, u[:, i], delay if i == 0 else 0.0) for i in range(u.shape[1])], -1)


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
