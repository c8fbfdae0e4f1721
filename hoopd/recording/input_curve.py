"""How an input goes on between its rows, and the means of it that are held from node to node.

An input that is not held is a staircase for whoever integrates: as many stairs between two rows as it takes to follow
the curve. A drive's demand is held. What was averaged or filtered before it was written down goes on smoothly: a
straight line through rows that are far apart lacks the part of it that changes fast, and a body driven by the line
seems lighter than it is.

Between its rows a smooth input is known only as far as the rows are near to each other. What a curve through rows h
seconds apart misses swings at half their rate, w = pi/h, and about it: what is slower shows. Of a swing at this rate
the rows show one phase, which alternates from row to row with the amplitude a = |u-1 - 2 u + u+1|/4, and not the other,
which is as large. So the root mean square of what is missed is s = a/sqrt(2), and not more, for a slow bend of the
curve is counted as well; its integral swings by s/w, and the integral of that by s/w^2.

Rules of this file: numbers only; scipy is not imported before there is a smooth input.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

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
        self._curve = _smooth(switch, u) if hold == "smooth" and len(u) > 2 else partial(np.interp, xp=switch, fp=u)

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
        # two points of Gauss: exact for a cubic
        middle, half = (t[:-1] + t[1:]) / 2.0, np.diff(t) / np.sqrt(12.0)
        return np.asarray((self._curve(middle - half) + self._curve(middle + half)) / 2.0)

    def unresolved(self, t: Array) -> Array:
        """(n-1, 2) between nodes t (n,): how far the integral of what the rows leave open swings, and the integral of
        that, in the input's unit times s and s^2.

        Of what is held, or goes straight as a generator makes it, nothing is left open.
        """
        if self._hold != "smooth" or len(self._u) < 3:
            return np.zeros((len(t) - 1, 2))
        h = np.diff(self._switch)
        squares = np.pad((np.diff(self._u, 2) / 4.0) ** 2 / 2.0, 1, mode="edge")
        s = np.sqrt((squares[:-1] + squares[1:]) / 2.0)
        interval = np.searchsorted(self._switch, t[:-1] + SAME_S, side="right") - 1
        # 1/w = h / pi
        return np.asarray(np.column_stack([s * h / np.pi, s * (h / np.pi) ** 2])[np.clip(interval, 0, len(h) - 1)])

    def _divided(self, count: int) -> Array:
        rows = np.arange(len(self._switch))
        return np.interp(np.arange((len(rows) - 1) * count + 1) / count, rows, self._switch)


def _smooth(switch: Array, u: Array) -> Callable[[Array], Array]:
    """A cubic spline through all rows; before the first and after the last their values."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(switch, u)
    return lambda t: np.asarray(spline(np.clip(t, switch[0], switch[-1])))
