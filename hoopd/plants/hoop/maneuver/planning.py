"""Plans of the ball's motion beyond the bottom, by direct collocation on the filter's model.

Without a time of its own a plan is searched twice: for the time that suits it, then for whole ticks of that time. What
cannot be planned gives limits up: the one that is given up most is told.

Rules of this file: from a question to a motion, or to the limit that stands in its way; nothing is read or written.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.collocation import KEPT_WITHIN, CollocatedMotion, CollocationProblem
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import path_limits
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel

Array = NDArray[np.float64]

# Where the search for a plan's time begins: a loop on the shipped model takes 1.3 s.
FIRST_SECONDS = 1.5
# A second costs as much as half of this torque for a second: the slowest motion is the one of least effort.
USUAL_TORQUE_NM, TIME_COST = 0.25, 0.5


class InfeasibleError(ValueError):
    """No motion keeps every limit; `group` is given up most, by `excess` (a share of the limit)."""

    def __init__(self, group: str, excess: float, reason: str) -> None:
        self.group, self.excess = group, excess
        super().__init__(reason)


def plan_motion(model: PlanningModel, question: ManeuverQuestion) -> CollocatedMotion:
    """The motion of least effort that answers a question.

    Parameters
    ----------
    model : PlanningModel
        Hoop and ball.
    question : ManeuverQuestion
        Which motion, under which limits.

    Returns
    -------
    CollocatedMotion
        States (theta, dtheta, psi, dpsi) at the edges of whole ticks, in rad and rad/s, and torques in N m.

    Raises
    ------
    InfeasibleError
        No motion keeps every limit.
    """
    groups = path_limits(model.structure, model.declared, question.limits, model.parameters, model.rate)
    problem = CollocationProblem(model.rate, groups, USUAL_TORQUE_NM)
    seconds, guess = question.seconds, None
    if seconds is None:
        first = question.guess(whole_ticks(question, FIRST_SECONDS))
        near = problem.solve(question.ends, first, question.tick_s, time_cost=TIME_COST)
        seconds = near.seconds
        guess = stretched(near, whole_ticks(question, seconds), question.tick_s)
    ticks = whole_ticks(question, seconds)
    found = problem.solve(question.ends, question.guess(ticks) if guess is None else guess, question.tick_s)
    if not found.solved:
        raise infeasible(found, f"no {question.kind}")
    return found


def whole_ticks(question: ManeuverQuestion, seconds: float) -> int:
    """Whole ticks; of a swing an even number, so that its middle is an edge."""
    return 2 * ceil(seconds / (2 * question.tick_s) - 1e-9)


def stretched(motion: CollocatedMotion, ticks: int, tick_s: float) -> Array:
    """A motion over so many ticks, as a guess."""
    shares, wanted = np.linspace(0.0, 1.0, len(motion.states)), np.linspace(0.0, 1.0, ticks + 1)
    table = np.column_stack([motion.states, np.append(motion.inputs, motion.inputs[-1])])
    faster = motion.seconds / (ticks * tick_s)
    return np.column_stack([np.interp(wanted, shares, column) for column in table.T]) * [1.0, faster, 1.0, faster, 1.0]


def first_solved(motions: Iterable[CollocatedMotion], what: str, *, tells_last: bool = False) -> CollocatedMotion:
    """The first of motions, searched one after another, that keeps every limit; InfeasibleError where none does, by the
    first (or the last) whose search came to its end: it tells which limit stands in the way."""
    tried: list[CollocatedMotion] = []
    for found in motions:
        if found.solved:
            return found
        tried.append(found)
    told = tried[::-1] if tells_last else tried
    raise infeasible(next((one for one in told if one.converged), told[0]), what)


def infeasible(found: CollocatedMotion, what: str) -> InfeasibleError:
    """The limits that a search gave up, of which the first is given up most; of one that did not come to its end what
    it exceeds meanwhile says nothing."""
    given = {name: value for name, value in found.excess.items() if value > KEPT_WITHIN}
    what = f"{what} in {found.seconds:g} s"
    if not given or not found.converged:
        return InfeasibleError("search", 0.0, f"{what} was found ({found.status})")
    most = sorted(given, key=lambda name: -given[name])
    listed = ", ".join(f"{name} by {_size(name, given[name])}" for name in most)
    return InfeasibleError(most[0], given[most[0]], f"{what}: it would exceed {listed}")


def _size(name: str, excess: float) -> str:
    """Contact and grip are told in weights of the ball, the others as shares of their limits."""
    return f"{excess:.2g} of the ball's weight" if name in ("contact force", "grip") else f"{100.0 * excess:.0f} %"
