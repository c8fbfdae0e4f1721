"""Piecewise-linear hats over a variable: what any curve is made of that nobody has named.

hat_i is 1 at knot i and 0 at its neighbours; beyond the outermost knots a curve keeps its last value, so that a free
run that leaves the data does not run away. Over an angle that comes back after a turn the last knot's neighbour is the
first.

Rules of this file: knots and hats only; numbers and CasADi expressions of the same curve agree to rounding.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Outermost knots leave so much of the data beyond them: a curve's ends are held by more than one sample.
TAIL = 0.01
# Knots nearer than this share of the range are one: a two-level signal has two.
NEAREST = 0.02


def spread_knots(x: Array, count: int) -> Array:
    """At most `count` knots at quantiles of x (n,), increasing; 0 is one of them where x has both signs."""
    x = x[np.isfinite(x)]
    knots = np.quantile(x, np.linspace(TAIL, 1.0 - TAIL, count))
    if knots[0] < 0.0 < knots[-1]:
        knots[np.argmin(np.abs(knots))] = 0.0
    apart = NEAREST * float(knots[-1] - knots[0])
    kept = [knots[0]]
    for knot in knots[1:]:
        if knot > kept[-1] and knot - kept[-1] >= apart:
            kept.append(knot)
    return np.asarray(kept)


def turn_knots(count: int, period: float) -> Array:
    """`count` knots evenly over a turn, from 0."""
    return np.arange(count) * period / count


def hats(x: Array, knots: Array, period: float | None = None) -> Array:
    """(..., m) hats at x (...)."""
    if period is None:
        at, ends, m = np.clip(x, knots[0], knots[-1]), knots, len(knots)
    else:
        at, ends, m = _in_turn(x, knots[0], period), np.append(knots, knots[0] + period), len(knots)
    left = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
    share = (at - ends[left]) / (ends[left + 1] - ends[left])
    found = np.zeros((*np.shape(x), m))
    np.put_along_axis(found, left[..., None], (1.0 - share)[..., None], axis=-1)
    np.put_along_axis(found, ((left + 1) % m)[..., None], share[..., None], axis=-1)
    return found


def _in_turn(x: Array, first: float, period: float) -> Array:
    return np.asarray(first + np.mod(x - first, period))


def curve_expression(x: Any, knots: Array, values: Any, period: float | None = None) -> Any:
    """sum_i c_i hat_i(x) as a CasADi expression; values: m symbols or numbers."""
    ends, c = list(map(float, knots)), [values[i] for i in range(len(knots))]
    if period is not None:
        x = ends[0] + (x - ends[0]) - period * ca.floor((x - ends[0]) / period)
        ends, c = [*ends, ends[0] + period], [*c, c[0]]
    # c_0 + sum of slope_i * (way of x inside piece i)
    found = c[0]
    for i in range(len(ends) - 1):
        length = ends[i + 1] - ends[i]
        found += (c[i + 1] - c[i]) / length * ca.fmin(ca.fmax(x - ends[i], 0.0), length)
    return found
