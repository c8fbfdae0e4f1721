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
    """Check nodes and the inputs held between them.

    Parameters
    ----------
    t : array_like, shape (n,)
        Nodes in s.
    u : array_like, shape (n - 1,) or (n - 1, inputs), optional
        Inputs; a plant without an input needs none.
    inputs : int
        How many the plant has; without one nothing is held, and that is a column of zeros.

    Returns
    -------
    t : ndarray, shape (n,)
        Nodes in s.
    u : ndarray, shape (n - 1, inputs), at least one column
        Inputs.
    h : ndarray, shape (n - 1,)
        Distances in s.

    Raises
    ------
    ValueError
        They do not fit, or the nodes do not increase.

    Examples
    --------
    >>> from hoopd.plants.held_input import node_axis
    >>> t, u, h = node_axis([0.0, 0.5, 2.0], [1.0, 3.0])
    >>> h.tolist()
    [0.5, 1.5]
    """
    t, count = np.asarray(t, float), max(1, inputs)
    held = np.zeros((max(t.size - 1, 0), 1)) if u is None and inputs == 0 else np.asarray(u, float)
    rows = held if held.ndim == 2 else held.reshape(-1, 1)
    rows = rows if rows.shape[1] else np.zeros((len(rows), 1))
    if t.ndim != 1 or len(t) < 2 or held.ndim not in (1, 2) or rows.shape != (len(t) - 1, count):
        wanted = "n - 1 inputs" if count == 1 else f"n - 1 rows of {count} inputs"
        raise ValueError(f"expected n nodes and {wanted}, not {t.shape} and {held.shape}")
    h = np.diff(t)
    if not (h > 0.0).all():
        raise ValueError("the nodes must increase")
    return t, rows, h


def mean_inputs(edges: Array, t: Array, u: Array, delay: float = 0.0) -> Array:
    """Give the means between edges of every input side by side; only the first one is late.

    Parameters
    ----------
    edges : ndarray, shape (..., m + 1)
        Edges in s.
    t : ndarray, shape (n,)
        Nodes in s.
    u : ndarray, shape (n - 1,) or (n - 1, inputs)
        Inputs held from the nodes.
    delay : float
        Seconds by which the first input is late.

    Returns
    -------
    ndarray, shape (..., m) or (..., m inputs)
        The means.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.plants.held_input import mean_inputs
    >>> t, u = np.array([0.0, 1.0, 2.0]), np.array([[1.0, 10.0], [3.0, 30.0]])
    >>> mean_inputs(np.array([0.5, 1.5]), t, u).tolist()
    [2.0, 20.0]
    """
    if u.ndim == 1:
        return mean_torque(edges, t, u, delay)
    return np.concatenate([mean_torque(edges, t, u[:, i], delay if i == 0 else 0.0) for i in range(u.shape[1])], -1)


def mean_torque(edges: ArrayLike, t: ArrayLike, u: ArrayLike, delay: float = 0.0) -> Array:
    """Give the means of u(time - delay) between edges.

    Parameters
    ----------
    edges : array_like, shape (..., m + 1)
        Edges in s.
    t : array_like, shape (n,)
        Nodes in s.
    u : array_like, shape (n - 1,)
        Torques held from the nodes; before the first node it is the first, after the last the last.
    delay : float
        Seconds by which the torque is late.

    Returns
    -------
    ndarray, shape (..., m)
        The means.

    Examples
    --------
    >>> from hoopd.plants.held_input import mean_torque
    >>> mean_torque([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [1.0, 3.0], delay=0.5).tolist()
    [1.0, 2.0]
    """
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
