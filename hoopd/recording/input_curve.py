"""How an input goes on between its rows, and the means of it that are held from node to node.

An input that is not held is a staircase for whoever integrates: as many stairs between two rows as it takes to follow
the curve. A drive's demand is held. What was averaged or filtered before it was written down goes on smoothly: a
straight line through rows that are far apart lacks the part of it that changes fast, and a body driven by the line
seems lighter than it is.

What was averaged has its rows as means: the curve's integral, which is what moves a body, is then exact from mean to
mean, and no force is lost at its corners. Readings that were averaged with it are no instants either: a mean over h
seconds is x + h^2 x''/24, and x'' is what their own differences say.

Between its rows a smooth input is known only as far as the rows are near to each other. What a curve through rows h
seconds apart misses swings at half their rate, w = pi/h, and about it: what is slower shows. Of a swing at this rate
the rows show one phase, which alternates from row to row with the amplitude a = |u-1 - 2 u + u+1|/4, and not the other,
which is as large. So the root mean square of what is missed is s = a/sqrt(2), and not more, for a slow bend of the
curve is counted as well; its integral swings by s/w. What is as large and has no mean over a row, a sin(2 pi t/h),
leaves a rate as it was when the row is over, and displaces a place by a h^2/(2 pi) for good.

Rules of this file: numbers only; scipy is not imported before there is a smooth input.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hoopd.recording.recording import MISSED_STEPS, PAUSE_STEPS

Array = NDArray[np.float64]

# Stairs between two rows: as few as leave at most this part of the input's spread between stairs and curve.
STAIRS, MOST_LEFT = (1, 2, 4, 8), 0.05
# Nodes nearer than this are one: a tick's clock is read to a microsecond.
SAME_S = 1e-6


class InputCurve:
    """One input between its rows."""

    def __init__(self, switch: Array, u: Array, hold: str) -> None:
        """`switch` (n,) s: when each of the values `u` (n,) is there; `hold` as of a signal."""
        self._switch, self._u, self._hold = switch, u, hold

    @property
    def _is_curve(self) -> bool:
        """Whether rows leave open what it did between them: it is neither held nor straight."""
        return self._hold in _CURVES and len(self._u) > 2

    @cached_property
    def _sum(self) -> Callable[[Array], Array]:
        """Its integral, where it is not held."""
        return (_CURVES[self._hold] if self._is_curve else _straight)(self._switch, self._u)

    @property
    def corners(self) -> Array:
        """Instants between the rows at which its stairs change."""
        if self._hold == "zero":
            return np.zeros(0)
        spread = float(self._u.std())
        for count in STAIRS:
            t = self._divided(count)
            # a straight piece leaves its mean by its rise over the root of twelve
            rise = np.abs(np.diff(self.between(t))) if len(t) > 2 else np.zeros(1)
            if float(np.sqrt(np.mean(rise**2) / 12.0)) <= MOST_LEFT * spread:
                break
        return np.setdiff1d(t, self._switch)

    def between(self, t: Array) -> Array:
        """(n-1,) between nodes t (n,): what is held, or the mean of the curve."""
        if self._hold == "zero":
            return np.asarray(
                self._u[np.clip(np.searchsorted(self._switch, t[:-1] + SAME_S, side="right") - 1, 0, None)]
            )
        return np.diff(self._sum(t)) / np.diff(t)

    def unresolved(self, t: Array) -> Array:
        """(n-1, 2) between nodes t (n,): how far the integral of what the rows leave open swings, and how far the
        integral of that is off for good afterwards, in the input's unit times s and s^2.

        Of what is held, or goes straight as a generator makes it, nothing is left open.
        """
        if not self._is_curve:
            return np.zeros((len(t) - 1, 2))
        h = np.diff(self._switch)
        squares = np.pad((np.diff(self._u, 2) / 4.0) ** 2 / 2.0, 1, mode="edge")
        s = np.sqrt((squares[:-1] + squares[1:]) / 2.0)
        interval = np.searchsorted(self._switch, t[:-1] + SAME_S, side="right") - 1
        interval = np.clip(interval, 0, len(h) - 1)
        # 1/w = h/pi; a = s sqrt(2)
        whole = np.column_stack([s * h / np.pi, s * h**2 / (np.sqrt(2.0) * np.pi)])
        return unresolved_in_parts(whole[interval], np.diff(t) / h[interval])

    def _divided(self, count: int) -> Array:
        rows = np.arange(len(self._switch))
        return np.interp(np.arange((len(rows) - 1) * count + 1) / count, rows, self._switch)


def unresolved_in_parts(whole: Array, share: Array) -> Array:
    """What is left open in parts (n,) of intervals, told what is in the whole ones (n, ..., 2): each part has its part
    of the variance by which an interval displaces."""
    found = whole.copy()
    found[..., 1] *= np.sqrt(share).reshape(-1, *[1] * (whole.ndim - 2))
    return found


def _smooth(switch: Array, u: Array) -> Callable[[Array], Array]:
    """The integral of a cubic spline through all rows; before the first and after the last their values."""
    from scipy.interpolate import CubicSpline

    return _going_on(CubicSpline(switch, u).antiderivative(), switch, u)


def _averaged(switch: Array, u: Array) -> Callable[[Array], Array]:
    """The integral of a curve that has each row as its mean from the middle to the row before to that to the row after:
    a cubic spline through the sums of the rows. Where rows are missing a mean is as long as usual."""
    from scipy.interpolate import CubicSpline

    step = np.diff(switch)
    usual = float(np.median(step))
    hole = step > MISSED_STEPS * usual
    half = np.where(hole, usual, step) / 2.0
    begins = switch - np.concatenate([half[:1], half])
    ends = switch + np.concatenate([half, half[-1:]])
    # over a hole straight from mean to mean
    order = np.argsort(np.concatenate([begins, ends[:-1][hole]]), kind="stable")
    knots = np.append(np.concatenate([begins, ends[:-1][hole]])[order], ends[-1])
    values = np.concatenate([u, (u[:-1] + u[1:])[hole] / 2.0])[order]
    return _going_on(CubicSpline(knots, np.concatenate([[0.0], np.cumsum(values * np.diff(knots))])), switch, u)


def _going_on(inner: Callable[[Array], Array], switch: Array, u: Array) -> Callable[[Array], Array]:
    """An integral that goes on before the first row and after the last with their values."""

    def integral(t: Array) -> Array:
        inside = np.clip(t, switch[0], switch[-1])
        beyond = np.where(t < switch[0], u[0], u[-1])
        return np.asarray(inner(inside) + beyond * (t - inside))

    return integral


def _straight(switch: Array, u: Array) -> Callable[[Array], Array]:
    """The integral of straight lines from row to row; before the first and after the last their values."""
    sums = np.concatenate([[0.0], np.cumsum((u[:-1] + u[1:]) / 2.0 * np.diff(switch))])

    def integral(t: Array) -> Array:
        row = np.clip(np.searchsorted(switch, t, side="right") - 1, 0, len(switch) - 1)
        return np.asarray(sums[row] + (u[row] + np.interp(t, switch, u)) / 2.0 * (t - switch[row]))

    return integral


_CURVES = {"smooth": _smooth, "mean": _averaged}


def deaveraged(t: Array, means: Array) -> Array:
    """(n,) values at times t (n,) of what is known by means, each about its own time and as long as its step, or as
    usual where its neighbours are missing.

    Where fewer than three are near each other their bend is not known, and they stay as they are.
    """
    if len(t) < 3:
        return means
    before, after = np.diff(t)[:-1], np.diff(t)[1:]
    slopes = np.diff(means) / np.diff(t)
    usual, widest = float(np.median(np.diff(t))), np.maximum(before, after)
    bend = np.where(widest <= PAUSE_STEPS * usual, 2.0 * np.diff(slopes) / (before + after), 0.0)
    # at the ends the bend of the next one
    bend = np.pad(bend, 1, mode="edge")
    length = np.pad(np.where(widest <= MISSED_STEPS * usual, (before + after) / 2.0, usual), 1, mode="edge")
    return np.asarray(means - length**2 / 24.0 * bend)
