"""The quasi-Newton search of every likelihood here: BFGS within bounds, from second derivatives that are given.

scipy's BFGS takes no bounds, and its L-BFGS-B no second derivatives to begin with: they are what saves the steps.
Source: Nocedal and Wright, Numerical Optimization, 2006, 6.1.

Rules of this file: numbers in, numbers out; no model.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SearchEnds(NamedTuple):
    """When a search has come to its end."""

    gain: float  # a step that promises less is not taken
    steps: int
    halvings: int = 8  # of one step
    longest: float = np.inf  # no coordinate changes by more in one step


class Minimum(NamedTuple):
    """Where a search ended."""

    v: Array
    value: float
    curvature: Array
    converged: bool  # by its rules


def lowest(
    evaluate: Callable[[Array], tuple[float, Array]],
    v: Array,
    curvature: Array,
    *,
    ends: SearchEnds,
    bounds: tuple[Array, Array] | None = None,
) -> Minimum:
    """Search for the point of lowest value.

    Parameters
    ----------
    evaluate : callable
        Gives the value and its gradient (m,) at a point (m,).
    v : ndarray, shape (m,)
        Where the search begins, within the bounds.
    curvature : ndarray, shape (m, m)
        Second derivatives there, all positive.
    ends : SearchEnds
        When the search ends.
    bounds : tuple of ndarray, shape (m,), optional
        Least and largest value of every coordinate.

    Returns
    -------
    Minimum
        The point, its value, the curvature that was learnt, and whether the search ended by its rules.

    Examples
    --------
    >>> import numpy as np
    >>> def bowl(v):
    ...     return float(np.cosh(v[0]) + v[1] ** 2), np.array([np.sinh(v[0]), 2.0 * v[1]])
    >>> found = lowest(bowl, np.array([1.0, 3.0]), np.eye(2), ends=SearchEnds(1e-12, 50))
    >>> found.converged, bool(np.abs(found.v).max() < 1e-5)
    (True, True)
    """
    low, high = bounds or (np.full(len(v), -np.inf), np.full(len(v), np.inf))
    value, slope = evaluate(v)
    for _ in range(ends.steps):
        step = _step(v, slope, curvature, low, high, ends.longest)
        if -slope @ step / 2 < ends.gain:
            return Minimum(v, value, curvature, True)
        for _ in range(ends.halvings):
            new_value, new_slope = evaluate(v + step)
            if new_value < value:
                break
            step = step / 2
        else:
            return Minimum(v, value, curvature, False)
        curvature = _updated(curvature, step, new_slope - slope)
        v, value, slope = v + step, new_value, new_slope
    return Minimum(v, value, curvature, False)


def positive(matrix: Array, share: float = 0.0, least: float = 0.0) -> Array:
    """A symmetric matrix with curvatures made positive, none below `share` of the largest and `least`."""
    size, axes = np.linalg.eigh(matrix)
    size = np.maximum(np.abs(size), max(share * np.abs(size).max(initial=0.0), least))
    return np.asarray(axes * size @ axes.T)


def _step(v: Array, slope: Array, curvature: Array, low: Array, high: Array, longest: float) -> Array:
    """Newton's step of what is not held by a bound, no longer than it may be."""
    free = ~(((v <= low) & (slope > 0)) | ((v >= high) & (slope < 0)))
    step = np.zeros_like(v)
    step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], slope[free])
    step *= min(1.0, longest / max(float(np.max(np.abs(step), initial=0.0)), 1e-300))
    return np.asarray(np.clip(v + step, low, high) - v)


def _updated(b: Array, s: Array, y: Array) -> Array:
    """BFGS; b stays as it is where the curvature along the step is not positive."""
    bs = b @ s
    if s @ y <= 1e-3 * (s @ bs):
        return b
    return np.asarray(b - np.outer(bs, bs) / (s @ bs) + np.outer(y, y) / (s @ y))
