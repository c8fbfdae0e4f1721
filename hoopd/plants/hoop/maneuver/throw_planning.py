"""A throw: a run-up by which the ball leaves the hoop, a flight, and a way back to the bottom from where it lands.

The flight is geometry. The run-up ends as the flight begins; in the air the torque makes the hoop meet the ball as fast
as it rolls, so that the touch pulls at neither; from the landing on another search brings both to rest.

Rules of this file: three parts one after another, each with the limits of the question; what cannot be planned says
which part, and which limit stands in its way.
"""

from __future__ import annotations

from dataclasses import replace
from math import nan, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.collocation import KEPT_WITHIN, CollocatedMotion, CollocationProblem, MotionEnds
from hoopd.plants.hoop.contact import contact_of
from hoopd.plants.hoop.effects.contact_modes import ROLLING, ContactCourse, ContactModes
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import path_limits
from hoopd.plants.hoop.maneuver.planned_flight import PlannedFlight, flight_of, seen_from_the_axis
from hoopd.plants.hoop.maneuver.planning import (
    TIME_COST,
    USUAL_TORQUE_NM,
    InfeasibleError,
    first_solved,
    stretched,
    whole_ticks,
)
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel, flying_model

Array = NDArray[np.float64]

# Where the searches for both parts' times begin.
RUN_UP_S, CATCH_S = 0.8, 0.8
# Of a run-up no contact can be kept: it ends where the force does, and there nothing holds this friction (in weights of
# the ball).
NO_MARGIN, LACKING = 0.0, 0.02
# Ticks beyond the time that suits a part, one after another until there is a motion.
MORE_TICKS = (0, 2, 6, 14)
SECANTS, SAME_RAD_S = 4, 1e-6
# After the touch: a ball of restitution 0.8 bounces for half a second.
MOST_BOUNCING_TICKS = 30
# Steps of a tick in the air.
AIR_STEPS = 10


class ThrowParts(NamedTuple):
    """A throw, tick by tick.

    Attributes
    ----------
    motion : CollocatedMotion
        All of it; while the ball flies psi is the direction in which it is seen.
    flight : PlannedFlight
        Of one turning sense.
    ticks : tuple of int
        Of the run-up, the flight, the way back.
    """

    motion: CollocatedMotion
    flight: PlannedFlight
    ticks: tuple[int, int, int]


def plan_throw(model: PlanningModel, question: ManeuverQuestion) -> ThrowParts:
    """The throw that answers a question; InfeasibleError where a part cannot be planned."""
    p = {name: float(value) for name, value in model.parameters.items()}
    flight = flight_of(question.flight_s, p["Ro"] - p["Rb"], p["g"])
    off = np.array([nan, nan, question.turn * flight.off_rad, question.turn * flight.off_rad_s])
    run_up = run_up_to(off, model, question)
    air = _with_bounces(model, question, run_up.states[-1], _air(model, question, run_up.states[-1], flight))
    rest = np.array([nan, 0.0, question.turn * tau, 0.0])
    back = outer_part(model, question, MotionEnds(air.landed, rest), CATCH_S, "way back of a throw")
    ticks = (len(run_up.inputs), len(air.torques), len(back.inputs))
    motion = run_up._replace(
        states=np.vstack([run_up.states[:-1], air.states[:-1], back.states]),
        inputs=np.concatenate([run_up.inputs, air.torques, back.inputs]),
        excess={name: max(value, back.excess[name]) for name, value in run_up.excess.items()},
        iterations=run_up.iterations + back.iterations,
    )
    return ThrowParts(motion, flight, ticks)


def run_up_to(off: Array, model: PlanningModel, question: ManeuverQuestion) -> CollocatedMotion:
    """From rest to where the contact's force ends (4,): as its grip ends with it, the ball has to roll by itself there,
    and the torque goes on."""
    limits = replace(question.limits, contact=NO_MARGIN, lacking=LACKING)
    ends = MotionEnds(np.zeros(4), off, goes_on=True)
    return outer_part(model, replace(question, limits=limits), ends, RUN_UP_S, "run-up of a throw")


def outer_part(
    model: PlanningModel, question: ManeuverQuestion, ends: MotionEnds, first_s: float, name: str
) -> CollocatedMotion:
    """The motion of least effort between two ends, for the time that suits it, then for whole ticks of that, or a few
    more where that time leaves none."""
    groups = path_limits(model.structure, model.declared, question.limits, model.parameters, model.rate)
    problem = CollocationProblem(model.rate, groups, USUAL_TORQUE_NM)
    near = problem.solve(ends, straight(ends, whole_ticks(question, first_s), question.tick_s), question.tick_s,
                         time_cost=TIME_COST)  # fmt: skip
    suits = whole_ticks(question, near.seconds)
    guesses = (stretched(near, suits + more, question.tick_s) for more in MORE_TICKS)
    return first_solved((problem.solve(ends, guess, question.tick_s) for guess in guesses), f"no {name}")


def straight(ends: MotionEnds, ticks: int, tick_s: float) -> Array:
    """A guess: from one end to the other, as the ball's ends have it."""
    share, seconds = np.linspace(0.0, 1.0, ticks + 1), ticks * tick_s
    states = np.zeros((ticks + 1, 4))
    start, end = np.nan_to_num(ends.start), np.nan_to_num(ends.end)
    # the cubic with both angles and both rates
    way, s = end[2] - start[2], share
    by_rate = (start[3] * (s - 2 * s**2 + s**3) + end[3] * (s**3 - s**2)) * seconds
    states[:, 2] = start[2] + way * (3 * s**2 - 2 * s**3) + by_rate
    states[:, 3] = np.gradient(states[:, 2], seconds / ticks)
    states[:, 1] = start[1] + (end[1] - start[1]) * s
    return states


class _Air(NamedTuple):
    """Torques and states of the flight, and the rolling ball's state after it."""

    torques: Array
    states: Array  # (n + 1, 4)
    landed: Array  # (4,)


def _air(model: PlanningModel, question: ManeuverQuestion, off: Array, flight: PlannedFlight) -> _Air:
    """The torque by which the ball rolls at once where it lands, found on the hoop alone."""
    n = round(question.flight_s / question.tick_s)
    p = {name: float(value) for name, value in model.parameters.items()}
    track, turn = p["Ro"] - p["Rb"], question.turn
    seen = seen_from_the_axis(flight, np.linspace(0.0, flight.seconds, n + 1), track, p["g"])
    # rolling: by_theta theta' + by_psi psi' is the spin, which the air keeps
    c = contact_of(model.structure)(model.declared.point(off, p))
    change = -float(c.by_psi) * turn * (flight.on_rad_s - flight.off_rad_s) / float(c.by_theta)
    torque, hoop = hoop_alone(model, off, change, n, question.tick_s)
    check_flight_torque(torque, question)
    states = np.column_stack([hoop, turn * seen[:, 0], turn * seen[:, 1]])
    landed = np.array([hoop[-1, 0], hoop[-1, 1], turn * flight.on_rad, turn * flight.on_rad_s])
    return _Air(np.full(n, torque), states, landed)


def _with_bounces(model: PlanningModel, question: ManeuverQuestion, off: Array, air: _Air) -> _Air:
    """The same until the ball rolls, where the model has a restitution: the hoop is left alone while it bounces."""
    if not model.lift_off.get("restitution"):
        return air
    found, flown = flying_model(model), len(air.torques)
    modes = ContactModes(found.plant, found.effects())
    course = ContactCourse(modes, found.values, modes.rolling.beginning(off))
    torques, states = [*air.torques, *[0.0] * MOST_BOUNCING_TICKS], [course.seen()[:4]]
    for k, torque in enumerate(torques):
        course.advance(torque, question.tick_s, k * question.tick_s)
        states.append(course.seen()[:4])
        if k + 1 >= flown and course.rolls:
            return _Air(np.array(torques[: k + 1]), np.array(states), states[-1])
    raise InfeasibleError(
        "flight", 0.0, f"no throw: {MOST_BOUNCING_TICKS} ticks after its touch the ball still bounces"
    )


def check_flight_torque(torque: float, question: ManeuverQuestion) -> None:
    """InfeasibleError where the hoop would need more than the limit to meet the ball as fast as it rolls."""
    excess = abs(torque) / question.limits.torque_nm - 1.0
    if excess > KEPT_WITHIN:
        reason = f"no {question.kind}: in the flight it would exceed torque by {100.0 * excess:.0f} %"
        raise InfeasibleError("torque", excess, reason)


def hoop_alone(model: PlanningModel, off: Array, change: float, ticks: int, tick_s: float) -> tuple[float, Array]:
    """A held torque that changes the hoop's speed by so much, and theta, theta' on the way: secants on the flight."""
    found = flying_model(model)
    modes = ContactModes(found.plant, found.effects())
    start = modes.hybrid.of(ROLLING)[0].reset(modes.rolling.beginning(off), modes.hybrid.vector(found.values))
    p, none = modes.air.vector(found.values), np.zeros(modes.air.nw)

    def run(torque: float) -> Array:
        z, rows = start, [off[:2]]
        for k in range(ticks * AIR_STEPS):
            z = modes.air.step_function(z, torque, none, tick_s / AIR_STEPS, k * tick_s / AIR_STEPS, p)
            rows.append(z.full().ravel()[:2])
        return np.array(rows[::AIR_STEPS])

    torques = [0.0, USUAL_TORQUE_NM]
    missed = [run(one)[-1, 1] - off[1] - change for one in torques]
    for _ in range(SECANTS):
        if abs(missed[-1]) < SAME_RAD_S:
            break
        step = missed[-1] * (torques[-1] - torques[-2]) / (missed[-1] - missed[-2])
        torques.append(torques[-1] - step)
        missed.append(run(torques[-1])[-1, 1] - off[1] - change)
    return torques[-1], run(torques[-1])
