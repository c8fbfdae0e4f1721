"""From a model and a question to a trajectory: a plan, its feedback, and how far both may be trusted.

Where a sampled model loses the ball the plan is made again with more force on the contact.

Rules of this file: composition; no mathematics of its own, nothing is read or written.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from math import isfinite
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from hoopd.core.tracker import LONGEST_PLAN_TICKS, Tolerances
from hoopd.files.model import ModelFile
from hoopd.files.planned_motion import FlightEntry, PlannedMotionEntry, TolerancesEntry
from hoopd.files.trajectory import KeptLimits, TrajectoryFile, rounded, short
from hoopd.plants.collocation import CollocatedMotion
from hoopd.plants.hoop.loop.writeback import limits_of
from hoopd.plants.hoop.maneuver.balance import TOP_WEIGHTS
from hoopd.plants.hoop.maneuver.dead_zone import behind_dead_zone, dead_zone_nm, demanded_torques, limits_behind
from hoopd.plants.hoop.maneuver.inner_model import InnerModel
from hoopd.plants.hoop.maneuver.maneuver_question import LOOP, SWING, THROW, UP, ManeuverQuestion
from hoopd.plants.hoop.maneuver.planning import InfeasibleError, plan_motion
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel
from hoopd.plants.hoop.maneuver.robustness import PlayedPlan, PlayResult, by_parameter, played, sampled
from hoopd.plants.hoop.maneuver.throw_planning import plan_throw
from hoopd.plants.hoop.maneuver.tracked_run import PlanTracker
from hoopd.plants.hoop.maneuver.tracking import TrackingWeights, hoop_gain, tracking_gains
from hoopd.plants.hoop.maneuver.up_planning import CATCH_CONTACT, plan_up
from hoopd.plants.model_file import effects_of

Array = NDArray[np.float64]

# More force on the contact, where a sampled model loses the ball, and how often that is tried.
MORE_CONTACT, TIGHTENINGS = 0.15, 2
# The contact that slips, by its name in a model.
SLIP = "ball.slip"
# Rest at the bottom, as far as a law that holds the ball brings it with dry friction, cogs and a camera's noise.
START = Tolerances(dtheta_rad_s=1.5, psi_rad=0.08, dpsi_rad_s=0.6)
# Beyond, the plan is no longer followed: several times what parameters that are a tenth off leave of a ball's way. The
# hoop may be as far off as the fault `hoop_overspeed` (60 rad/s) lets it: what it does is what the ball needs.
ENVELOPE = Tolerances(dtheta_rad_s=35.0, psi_rad=0.9, dpsi_rad_s=9.0)
# What a model leaves of an acceleration, and for how long alike.
UNMODELLED_SHARE, UNMODELLED_S = 0.1, 0.4
# The filter follows a flight, but knows no bounce: a rad/s in a tick. Rows that a ball raises which is off its track,
# and which does not move as one that rolls.
FLIGHT_UNMODELLED, FLIGHT_SUSPENDS = 60.0, ("ball_lost", "ball_implausible")
USUAL_WEIGHTS = TrackingWeights()


class PlannedTrajectory(NamedTuple):
    """A plan and what it is worth."""

    motion: CollocatedMotion
    gains: Array  # (n, 4)
    contact: Array  # (n,) weights of the ball, at the edges
    grip: Array  # (n,) friction coefficient that the contact needs there
    question: ManeuverQuestion  # with the margins that were kept
    nominal: PlayResult  # on the very model
    by_parameter: dict[str, PlayResult]
    sampled: list[PlayResult]
    open_loop_end: Array  # (4,) of the plan's torques alone, minus the plan's end
    flight_ticks: tuple[int, int] | None = None  # of a throw: the first in the air, the first after it


def plan_trajectory(
    model: ModelFile, question: ManeuverQuestion, weights: TrackingWeights = USUAL_WEIGHTS
) -> PlannedTrajectory:
    """The trajectory that answers a question on a model.

    Parameters
    ----------
    model : ModelFile
        Hoop and ball, with the effects that were found.
    question : ManeuverQuestion
        Which motion, under which limits.
    weights : TrackingWeights
        Of the feedback.

    Returns
    -------
    PlannedTrajectory
        The first that every sampled model follows, else the one with the most contact that can be planned.

    Raises
    ------
    InfeasibleError
        No motion keeps the limits.
    ValueError
        No such motion, or one of more ticks than a plan may have.
    """
    found = effects_of(model)
    limits = question.limits
    limits = replace(limits, torque_nm=_torque(model, limits.torque_nm), grip=_grip(model, limits.grip))
    if question.kind == UP:
        limits = replace(limits, contact=CATCH_CONTACT)
    question = replace(question, limits=limits)
    planning, tracker = PlanningModel(behind_dead_zone(found)), PlanTracker(found)
    best = _planned(model, planning, tracker, question, weights)
    for _ in range(TIGHTENINGS):
        if all(one.arrived for one in best.sampled) or question.kind != LOOP:
            break
        try:
            tighter = replace(question.limits, contact=question.limits.contact + MORE_CONTACT)
            question = replace(question, limits=tighter)
            best = max((best, _planned(model, planning, tracker, question, weights)), key=_worth)
        except (InfeasibleError, ValueError):
            break
    return best


def _grip(model: ModelFile, wanted: float) -> float:
    """No more than the contact is surely known to have: where it slips, no plan is one."""
    known = [one.parameters["mu"] for one in model.effects if one.name == SLIP and "mu" in one.parameters]
    return min([wanted, *(one.ci95[0] if one.ci95 is not None else one.value for one in known)])


def _torque(model: ModelFile, wanted_nm: float) -> float:
    """No more than the drive is known to give."""
    return min(wanted_nm, model.device.torque_limit_nm, *limits_of(effects_of(model)))


def _worth(one: PlannedTrajectory) -> tuple[int, float]:
    return sum(played.arrived for played in one.sampled), min(played.contact for played in one.sampled)


def _planned(
    model: ModelFile,
    planning: PlanningModel,
    tracker: PlanTracker,
    question: ManeuverQuestion,
    weights: TrackingWeights,
) -> PlannedTrajectory:
    dead_nm = dead_zone_nm(effects_of(model))
    behind = replace(question, limits=limits_behind(question.limits, dead_nm))
    left, gains, flight, inner = _fed_back(planning, behind, weights)
    motion = left._replace(inputs=demanded_torques(left.inputs, dead_nm))
    if len(motion.inputs) > LONGEST_PLAN_TICKS:
        reason = f"{len(motion.inputs)} ticks of {question.tick_s:g} s, and a plan has {LONGEST_PLAN_TICKS} at most"
        raise ValueError(f"the {question.kind} takes {reason}")
    limit_nm, thrown = model.device.torque_limit_nm, flight is not None
    plan = PlayedPlan(motion.states, motion.inputs, gains, motion.tick_s, limit_nm, thrown)
    contact, friction = _pressed(planning, left, flight, inner)
    play = tracker.run if flight is None else tracker.thrown
    alone = play(*plan._replace(gains=np.zeros_like(gains))[:-1])
    return PlannedTrajectory(
        motion,
        gains,
        contact,
        np.abs(friction) / np.where(contact > 0.0, contact, np.nan),
        question,
        played(tracker, plan, {}),
        by_parameter(tracker, plan, model),
        sampled(tracker, plan, model),
        alone.states[-1] - motion.states[-1],
        flight,
    )


def _pressed(
    planning: PlanningModel, motion: CollocatedMotion, flight: tuple[int, int] | None, inner: InnerModel | None
) -> tuple[Array, Array]:
    """Force and friction of the contact along a motion, weights of the ball; none in the air."""

    def along(model: PlanningModel | InnerModel) -> tuple[Array, Array]:
        force, friction = (one.full().ravel() for one in model.pressed(motion.states[:-1].T, motion.inputs[None]))
        return force, friction

    contact, friction = along(planning)
    if flight is None:
        return contact, friction
    after = along(planning if inner is None else inner)
    edges = np.arange(len(contact))
    before, behind = edges < flight[0], edges >= flight[1]
    contact, friction = (
        np.where(before, outer, np.where(behind, other, np.nan))
        for outer, other in zip((contact, friction), after, strict=True)
    )
    return contact, friction


def _fed_back(
    planning: PlanningModel, question: ManeuverQuestion, weights: TrackingWeights
) -> tuple[CollocatedMotion, Array, tuple[int, int] | None, InnerModel | None]:
    """A motion with its gains, the ticks in which it is a flight (there the hoop alone is fed back), and the model of
    what comes after where that is the inner hoop."""
    step = planning.step(question.tick_s)
    if question.kind == UP:
        return _fed_back_up(planning, question, weights)
    if question.kind != THROW:
        motion = plan_motion(planning, question)
        return motion, tracking_gains(planning.step(motion.tick_s), motion.states, motion.inputs, weights), None, None
    throw = plan_throw(planning, question)
    off, on = throw.ticks[0], throw.ticks[0] + throw.ticks[1]
    states, inputs = throw.motion.states, throw.motion.inputs
    gains = np.zeros((len(inputs), 4))
    gains[:off] = tracking_gains(step, states[: off + 1], inputs[:off], weights)
    gains[off:on, 1] = hoop_gain(planning.hoop_inertia, question.tick_s, weights)
    gains[on:] = tracking_gains(step, states[on:], inputs[on:], weights)
    return throw.motion, gains, (off, on), None


def _fed_back_up(
    planning: PlanningModel, question: ManeuverQuestion, weights: TrackingWeights
) -> tuple[CollocatedMotion, Array, tuple[int, int], InnerModel]:
    """The motion to the top, and so many ticks of rest there."""
    up, hold = plan_up(planning, question), round(question.hold_s / question.tick_s)
    off, on = up.ticks[0], up.ticks[0] + up.ticks[1]
    top = up.motion.states[-1]
    motion = up.motion._replace(
        states=np.vstack([up.motion.states, np.tile(top, (hold, 1))]),
        inputs=np.concatenate([up.motion.inputs, np.zeros(hold)]),
    )
    gains, inner_step = np.zeros((len(motion.inputs), 4)), up.inner.step(question.tick_s)
    gains[:off] = tracking_gains(planning.step(question.tick_s), motion.states[: off + 1], motion.inputs[:off], weights)
    gains[off:on, 1] = hoop_gain(planning.hoop_inertia, question.tick_s, weights)
    gains[on:] = tracking_gains(inner_step, motion.states[on:], motion.inputs[on:], TOP_WEIGHTS, top)
    return motion, gains, (off, on), up.inner


def trajectory_file(planned: PlannedTrajectory, model: str, model_sha256: str, name: str) -> TrajectoryFile:
    """The file of a planned trajectory.

    Parameters
    ----------
    planned : PlannedTrajectory
        What was planned.
    model, model_sha256 : str
        The model file as the trajectory names it, and the hash of its bytes.
    name : str
        What recordings call it.
    """
    motion, question = planned.motion, planned.question
    suspends = ["ball_runaway"] if question.kind != SWING else []
    plan = PlannedMotionEntry(
        torques_nm=rounded(motion.inputs.tolist()),
        states=rounded(motion.states.tolist()),
        feedback=rounded(planned.gains.tolist()),
        start=TolerancesEntry(**asdict(START)),
        envelope=TolerancesEntry(**asdict(ENVELOPE)),
        unmodelled=short(_unmodelled(motion)),
        suspends=suspends,
        flight=None if planned.flight_ticks is None else _flight_entry(planned.flight_ticks),
        let_down=question.kind == UP,
    )
    limits = question.limits
    kept = KeptLimits(
        torque_nm=limits.torque_nm,
        hoop_speed_rad_s=limits.hoop_speed_rad_s,
        contact=limits.contact,
        grip=limits.grip if isfinite(limits.grip) else None,
    )
    return TrajectoryFile(
        schema="hoopd.trajectory/1",
        name=name,
        maneuver=cast("Literal['loop', 'swing', 'throw', 'up']", question.kind),
        model=model,
        model_sha256=model_sha256,
        sample_time_s=motion.tick_s,
        turn=question.turn,
        limits=kept,
        plan=plan,
        report=report_of(planned),
    )


def _flight_entry(ticks: tuple[int, int]) -> FlightEntry:
    return FlightEntry(
        first_tick=ticks[0], ticks=ticks[1] - ticks[0], unmodelled=FLIGHT_UNMODELLED, suspends=list(FLIGHT_SUSPENDS)
    )


def _unmodelled(motion: CollocatedMotion) -> float:
    """A tenth of the motion's accelerations, alike for a while, as white noise: (share a)^2 T."""
    acceleration = np.diff(motion.states[:, 3]) / motion.tick_s
    return float((UNMODELLED_SHARE**2 * np.mean(acceleration**2)) * UNMODELLED_S)


def report_of(planned: PlannedTrajectory) -> dict[str, Any]:
    """What a plan needs, and how far it may be trusted, as plain data."""
    motion = planned.motion
    arrived = sum(one.arrived for one in planned.sampled)
    return {
        "seconds": short(motion.seconds),
        "ticks": len(motion.inputs),
        "largest_torque_nm": short(np.abs(motion.inputs).max()),
        "largest_hoop_speed_rad_s": short(np.abs(motion.states[:, 1]).max()),
        "largest_ball_speed_rad_s": short(np.abs(motion.states[:, 3]).max()),
        "least_contact": short(np.nanmin(planned.contact)),
        "needed_grip": short(np.nanmax(planned.grip)),
        **_told_flight(planned),
        "open_loop_end_rad": short(planned.open_loop_end[2]),
        "tracked": _row(planned.nominal),
        "sensitivity": {name: _row(one) for name, one in planned.by_parameter.items()},
        "sampled_models": len(planned.sampled),
        "sampled_models_arrived": arrived,
        "sampled_least_contact": short(min(one.contact for one in planned.sampled)),
    }


def _told_flight(planned: PlannedTrajectory) -> dict[str, float]:
    """How long it flies; up, how long it stays there."""
    if planned.flight_ticks is None:
        return {}
    if planned.question.kind == UP:
        seconds = planned.motion.tick_s * (planned.flight_ticks[1] - planned.flight_ticks[0])
        return {"flight_s": short(seconds), "hold_s": short(planned.question.hold_s)}
    return {"flight_s": short(planned.question.flight_s)}


def _row(one: PlayResult) -> dict[str, float]:
    return {
        **({} if one.flown_s is None else {"flown_s": short(one.flown_s)}),
        "least_contact": short(one.contact),
        "end_rad": short(one.end_rad),
        "largest_torque_nm": short(one.torque_nm),
        "largest_hoop_speed_rad_s": short(one.hoop_speed_rad_s),
    }
