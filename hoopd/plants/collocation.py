"""Direct collocation: a motion of any plant from one state to another, its input held over every tick.

Within a tick the state is a polynomial that meets the plant's equation at Gauss-Legendre points. A limit is a group of
inequalities in shares of what it limits; every group has one slack that costs much: it is zero in a plan, and where
there is none it tells what stands in the way.

Rules of this file: nothing here knows a plant, a file or a device.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Of order six: a ball's angle that moves by 0.4 rad in a tick of 20 ms is right within 1e-5 rad.
DEGREE = 3
# A search that takes longer goes nowhere: a loop takes one or two seconds.
ITERATIONS, LONGEST_S = 300, 12.0
# What a slack of one costs beside an effort of about one: an infeasible plan gives up little, and in few groups.
SLACK_COST = 1e3
# A group that is kept within this share is kept.
KEPT_WITHIN = 1e-4
_SOLVED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")


class PathLimit(NamedTuple):
    """Inequalities that hold at every instant.

    Attributes
    ----------
    name : str
        What it limits.
    excess : casadi.Function
        (x, u) to (m,): how far beyond the limit, as a share of it; not above zero where it is kept.
    """

    name: str
    excess: ca.Function


class MotionEnds(NamedTuple):
    """Where a motion begins and ends, without input unless it goes on, and what it passes through: NaN where a state is
    free."""

    start: Array
    end: Array
    through: Mapping[float, Array] = MappingProxyType({})  # by share of the time
    goes_on: bool = False  # another motion follows, with an input of its own


class CollocatedMotion(NamedTuple):
    """A motion that solves the plant's equation, tick by tick.

    Attributes
    ----------
    tick_s : float
        Length of a tick in s.
    states : ndarray, shape (n + 1, nx)
        At the ticks' edges.
    inputs : ndarray, shape (n,)
        Held from each edge to the next.
    excess : mapping of str to float
        The largest of each group; above zero: by so much it was given up.
    status : str
        What the solver said.
    iterations : int
        How many it took.
    """

    tick_s: float
    states: Array
    inputs: Array
    excess: Mapping[str, float]
    status: str
    iterations: int

    @property
    def converged(self) -> bool:
        """The search came to its end: what it gives up, no motion near it keeps."""
        return self.status in _SOLVED

    @property
    def solved(self) -> bool:
        """Every group is kept."""
        return self.converged and all(value <= KEPT_WITHIN for value in self.excess.values())

    @property
    def seconds(self) -> float:
        """From beginning to end."""
        return self.tick_s * len(self.inputs)


class CollocationProblem:
    """Motions of a plant dx/dt = f(x, u) under limits, of least effort.

    The effort is the integral of (u / usual input)^2, with a little of the input's changes from tick to tick.

    Parameters
    ----------
    rate : casadi.Function
        (x, u) to dx/dt.
    limits : sequence of PathLimit
        What holds at every instant.
    usual_input : float
        An input of this size costs one a second.
    """

    def __init__(self, rate: ca.Function, limits: Sequence[PathLimit], usual_input: float) -> None:
        self._rate, self._limits, self._usual = rate, tuple(limits), usual_input
        self._nx = rate.size1_in(0)
        self._points = np.array(ca.collocation_points(DEGREE, "legendre"))
        self._slopes, self._last, _ = ca.collocation_coeff(self._points.tolist())

    def solve(
        self,
        ends: MotionEnds,
        guess: Array,
        tick_s: float,
        *,
        time_cost: float | None = None,
    ) -> CollocatedMotion:
        """The motion of least effort.

        Parameters
        ----------
        ends : MotionEnds
            Where it begins and ends.
        guess : ndarray, shape (n + 1, nx) or (n + 1, nx + 1)
            States at the edges of n ticks, and the inputs where they are known.
        tick_s : float
            Length of a tick; with `time_cost` where to begin.
        time_cost : float, optional
            Cost of a second: the length of the ticks is found, too (a half to twice `tick_s`).

        Returns
        -------
        CollocatedMotion
            `solved` says whether it keeps every limit.
        """
        n = len(guess) - 1
        free = _Variables(self._nx, n, len(self._limits))
        constraints, lower, upper = self._constraints(free, n)
        effort = free.tick * ca.sumsqr(free.u) / self._usual**2
        changes = tick_s * ca.sumsqr(free.u[1:] - free.u[:-1]) / self._usual**2
        cost = effort + changes + SLACK_COST * ca.sum1(free.slack)
        if time_cost is not None:
            cost += time_cost * n * free.tick
        problem = {"x": free.all, "f": cost, "g": constraints}
        solver = ca.nlpsol("motion", "ipopt", problem, _OPTIONS)
        found = solver(
            x0=free.packed(*self._beginning(guess, tick_s)),
            lbx=free.packed(*self._bounds(ends, n, tick_s, -1.0, time_cost is not None)),
            ubx=free.packed(*self._bounds(ends, n, tick_s, 1.0, time_cost is not None)),
            lbg=lower,
            ubg=upper,
        )
        stats = solver.stats()
        tick, x, u, _, slack = free.unpacked(found["x"].full().ravel())
        excess = {limit.name: float(slack[i]) for i, limit in enumerate(self._limits)}
        return CollocatedMotion(float(tick[0]), x.T, u, excess, stats["return_status"], stats["iter_count"])

    # ------------------------------------------------------------------------------------------ parts

    def _constraints(self, free: _Variables, n: int) -> tuple[Any, Array, Array]:
        """Defects of the equation, joints of the ticks, and the limits."""
        inside = ca.repmat(free.u.T, DEGREE, 1).reshape((1, n * DEGREE))
        rates = self._rate.map(n * DEGREE)(free.inner, inside)
        equal = []
        for k in range(n):
            columns = slice(k * DEGREE, (k + 1) * DEGREE)
            every = ca.horzcat(free.x[:, k], free.inner[:, columns])
            equal += [
                ca.vec(every @ self._slopes - free.tick * rates[:, columns]),
                free.x[:, k + 1] - every @ self._last,
            ]
        kept = []
        for i, limit in enumerate(self._limits):
            for states, inputs, count in ((free.inner, inside, n * DEGREE), (free.x[:, :-1], free.u.T, n)):
                kept.append(ca.vec(limit.excess.map(count)(states, inputs)) - free.slack[i])
        g, h = ca.vertcat(*equal), ca.vertcat(*kept)
        lower = np.concatenate([np.zeros(g.numel()), np.full(h.numel(), -np.inf)])
        return ca.vertcat(g, h), lower, np.zeros(g.numel() + h.numel())

    def _beginning(self, guess: Array, tick_s: float) -> tuple[Any, ...]:
        n = len(guess) - 1
        x = guess[:, : self._nx].T
        u = guess[:-1, self._nx] if guess.shape[1] > self._nx else np.zeros(n)
        return [tick_s], x, u, _inner(guess[:, : self._nx], self._points), np.zeros(len(self._limits))

    def _bounds(self, ends: MotionEnds, n: int, tick_s: float, side: float, free_time: bool) -> tuple[Any, ...]:
        x = np.full((self._nx, n + 1), side * np.inf)
        at = {0.0: ends.start, 1.0: ends.end, **ends.through}
        for share, state in at.items():
            known = np.isfinite(state)
            x[known, round(share * n)] = state[known]
        stretch = (2.0 if side > 0.0 else 0.5) if free_time else 1.0
        inner = np.full((self._nx, n * DEGREE), side * np.inf)
        # what comes before and after has no input, and a step would be bridged
        without = (0,) if ends.goes_on else (0, n - 1)
        u = np.where(np.isin(np.arange(n), without), 0.0, side * np.inf)
        return [stretch * tick_s], x, u, inner, np.full(len(self._limits), np.inf if side > 0.0 else 0.0)


_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": ITERATIONS,
    "ipopt.max_cpu_time": LONGEST_S,
    "print_time": False,
    "error_on_fail": False,
}


class _Variables:
    """What is searched: the tick's length, states at edges and inside, inputs, slacks."""

    def __init__(self, nx: int, n: int, groups: int) -> None:
        self.tick, self.x, self.u = ca.MX.sym("tick"), ca.MX.sym("x", nx, n + 1), ca.MX.sym("u", n)
        self.inner, self.slack = ca.MX.sym("inner", nx, n * DEGREE), ca.MX.sym("slack", groups)
        self._parts = (self.tick, self.x, self.u, self.inner, self.slack)

    @property
    def all(self) -> Any:
        return ca.vertcat(*map(ca.vec, self._parts))

    def packed(self, *values: Any) -> Array:
        """Numbers of every part in one column."""
        return np.concatenate([np.asarray(one, float).ravel(order="F") for one in values])

    def unpacked(self, column: Array) -> list[Array]:
        """The parts of a column."""
        ends = np.cumsum([part.numel() for part in self._parts])[:-1]
        pieces = np.split(column, ends)
        shaped = [one.reshape(part.shape, order="F") for one, part in zip(pieces, self._parts, strict=True)]
        return [one if i in (1, 3) else one.ravel() for i, one in enumerate(shaped)]


def _inner(states: Array, points: Array) -> Array:
    """States between the edges on straight lines, (nx, n DEGREE)."""
    between = [states[:-1] + (states[1:] - states[:-1]) * point for point in points]
    return np.stack(between, axis=1).reshape(-1, states.shape[1]).T
