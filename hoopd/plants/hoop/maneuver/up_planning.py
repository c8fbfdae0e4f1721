"""Up: a throw from the outer hoop to the inner one, over its top to rest, held there.

The ball leaves the outer hoop where nothing presses it on and lands on the inner one short of the top, with just the
speed that carries it up there by itself; in the air the torque makes the hoop meet it as fast as it rolls. What the
landing leaves another search brings to rest on the top.

Rules of this file: parts one after another, each with the limits of the question; what cannot be planned says which.
"""

from __future__ import annotations

from math import atan2, ceil, cos, hypot, inf, nan, pi, sin, sqrt, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.files.planned_motion import LONGEST_FLIGHT_S
from hoopd.plants.collocation import CollocatedMotion, CollocationProblem, MotionEnds
from hoopd.plants.hoop.effects.contact_modes import INNER, ContactCourse
from hoopd.plants.hoop.effects.inner_hoop import RADIUS
from hoopd.plants.hoop.maneuver.inner_model import InnerModel
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.planning import USUAL_TORQUE_NM, InfeasibleError, first_solved
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel
from hoopd.plants.hoop.maneuver.throw_planning import check_flight_torque, hoop_alone, run_up_to, straight

Array = NDArray[np.float64]

# Where the ball leaves the outer hoop: between a steep fall back and a flight that passes the inner hoop by.
STEEPEST_RAD, FLATTEST_RAD = pi / 2 + 0.45, pi / 2 + 0.8
BISECTIONS = 40
# Steps of the search for the touch, and the longest flight to it.
TOUCH_STEP_S = 1e-4
# What the catch takes: ticks, tried one after another.
CATCH_TICKS = (20, 26, 34, 44)
# Contact that the catch keeps, in weights of the ball, whatever is asked: as it lands there is less than on the top,
# where it is one.
CATCH_CONTACT = 0.2


class Touch(NamedTuple):
    """A flight from the outer to the inner hoop, of one turning sense."""

    off_rad: float
    off_rad_s: float
    seconds: float
    on_rad: float
    on_rad_s: float  # along the inner track
    across_m_s: float  # into it, above zero


class UpParts(NamedTuple):
    """The motion to the top.

    Attributes
    ----------
    motion : CollocatedMotion
        All of it, to rest on the top.
    touch : Touch
        The flight.
    ticks : tuple of int
        Of the run-up, of the flight up to the edge after the touch, of the catch.
    inner : InnerModel
        Of the last part.
    """

    motion: CollocatedMotion
    touch: Touch
    ticks: tuple[int, int, int]
    inner: InnerModel


def touch_from(off_rad: float, outer_m: float, inner_m: float, gravity_m_s2: float) -> Touch:
    """The flight that begins at an angle of the outer track; ValueError where it passes the inner one by.

    Examples
    --------
    >>> touch = touch_from(2.2, 0.0853, 0.0549, 9.81)
    >>> round(touch.seconds, 3), round(touch.on_rad - pi, 2), round(touch.on_rad_s, 1)
    (0.115, -0.4, 2.9)
    """
    rate = sqrt(-gravity_m_s2 * cos(off_rad) / outer_m)
    across, up = outer_m * rate * cos(off_rad), outer_m * rate * sin(off_rad)
    t = np.arange(TOUCH_STEP_S, LONGEST_FLIGHT_S, TOUCH_STEP_S)
    x = outer_m * sin(off_rad) + across * t
    y = -outer_m * cos(off_rad) + up * t - gravity_m_s2 * t * t / 2
    inside = np.flatnonzero(np.hypot(x, y) <= inner_m)
    if not inside.size:
        raise ValueError(f"a ball that leaves at {off_rad:.2f} rad passes an inner track of {1e3 * inner_m:.0f} mm by")
    k = int(inside[0])
    fallen, distance = up - gravity_m_s2 * t[k], hypot(x[k], y[k])
    on_rad = atan2(x[k], -y[k]) % tau
    along = across * cos(on_rad) + fallen * sin(on_rad)
    into = -(across * x[k] + fallen * y[k]) / distance
    return Touch(off_rad, rate, float(t[k]), on_rad, float(along) / inner_m, float(into))


def touch_that_arrives(inner: InnerModel) -> Touch:
    """The flight after which the ball comes to rest on the top by itself; ValueError where there is none."""
    v = inner.found.values
    outer_m, inner_m, g = v["Ro"] - v["Rb"], inner.track_m, v["g"]
    # psi'' = k sin(psi - pi) there: m g r over the inertia of path and spin, the hoop at rest
    stiffness = v["mb"] * g * inner_m / (v["mb"] * inner_m**2 + inner.spin_inertia * (1.0 + v[RADIUS] / v["Rb"]) ** 2)

    def missing(touch: Touch) -> float:
        """Of half of its speed's square, above zero: too slow."""
        slow = touch.on_rad > pi and touch.on_rad_s > 0.0
        return -inf if slow else stiffness * (1.0 - cos(touch.on_rad - pi)) - touch.on_rad_s * abs(touch.on_rad_s) / 2

    low, high = STEEPEST_RAD, FLATTEST_RAD
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if missing(touch_from(middle, outer_m, inner_m, g)) > 0.0 else (low, middle)
    return touch_from(low, outer_m, inner_m, g)


def plan_up(model: PlanningModel, question: ManeuverQuestion) -> UpParts:
    """The throw to the top; InfeasibleError where a part cannot be planned, ValueError for a model without a top."""
    inner = InnerModel(model)
    touch, turn = touch_that_arrives(inner), question.turn
    off = np.array([nan, nan, turn * touch.off_rad, turn * touch.off_rad_s])
    run_up = run_up_to(off, model, question)
    air = _air(model, inner, question, run_up.states[-1], touch)
    catch = _catch(inner, question, air.states[-1])
    motion = run_up._replace(
        states=np.vstack([run_up.states[:-1], air.states[:-1], catch.states]),
        inputs=np.concatenate([run_up.inputs, air.torques, catch.inputs]),
        excess={name: max(value, catch.excess[name]) for name, value in run_up.excess.items()},
        iterations=run_up.iterations + catch.iterations,
    )
    return UpParts(motion, touch, (len(run_up.inputs), len(air.torques), len(catch.inputs)), inner)


class _Air(NamedTuple):
    """Torques and states up to the tick's edge after the touch."""

    torques: Array
    states: Array  # (n + 1, 4)


def _air(model: PlanningModel, inner: InnerModel, question: ManeuverQuestion, off: Array, touch: Touch) -> _Air:
    """The torque by which the ball rolls at once where it lands."""
    v, turn = inner.found.values, question.turn
    # outer: Rb w = Ro theta' - (Ro-Rb) psi';  inner: Rb w = (Ri+Rb) psi' - Ri theta'
    surface = v["Ro"] * off[1] - (v["Ro"] - v["Rb"]) * off[3]
    wanted = (inner.track_m * turn * touch.on_rad_s - surface) / v[RADIUS]
    torque, _ = hoop_alone(model, off, wanted - off[1], 1, touch.seconds)
    check_flight_torque(torque, question)
    n = ceil(touch.seconds / question.tick_s)
    course = ContactCourse(inner.modes, v, inner.modes.rolling.beginning(off))
    states = [course.seen()[:4]]
    for k in range(n):
        course.advance(torque, question.tick_s, k * question.tick_s)
        states.append(course.seen()[:4])
    if course.mode != INNER:
        raise InfeasibleError("flight", 0.0, f"no throw to the inner hoop: {n} ticks later the ball is {course.mode}")
    return _Air(np.full(n, torque), np.array(states))


def _catch(inner: InnerModel, question: ManeuverQuestion, landed: Array) -> CollocatedMotion:
    """From the landing to rest on the top, of least effort."""
    problem = CollocationProblem(inner.rate, inner.limits(question.limits), USUAL_TORQUE_NM)
    ends = MotionEnds(landed, np.array([nan, 0.0, question.turn * pi, 0.0]))
    guesses = (straight(ends, ticks, question.tick_s) for ticks in CATCH_TICKS)
    motions = (problem.solve(ends, guess, question.tick_s) for guess in guesses)
    return first_solved(motions, "no catch on the inner hoop", tells_last=True)  # the longest has the most room
