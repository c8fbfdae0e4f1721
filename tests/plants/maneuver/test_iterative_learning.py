"""What attempts teach, on a loop in the plant's own equations: no filter, no camera, no daemon."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hoopd.files.shipped import defaults_folder
from hoopd.plants.found_effects import FoundEffect
from hoopd.plants.hoop.maneuver.iterative_learning import LearnedMotion, mean_of_attempts, tracking_cost, unexplained
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel
from hoopd.plants.hoop.maneuver.tracked_run import PlanTracker
from hoopd.plants.hoop.maneuver.trajectory import USUAL_WEIGHTS, PlannedTrajectory, plan_trajectory
from hoopd.plants.model_file import effects_of, load_model

Array = NDArray[np.float64]

HOOP = load_model(defaults_folder() / "models" / "hoop.yaml")
FOUND = effects_of(HOOP)
LIMIT_NM, TICK_S = 0.1, HOOP.sample_time_s
OTHER = {"Ih": 1.1 * FOUND.base["Ih"], "bh": 1.3 * FOUND.base["bh"]}


@cache
def planned() -> PlannedTrajectory:
    return plan_trajectory(HOOP, ManeuverQuestion("loop", MotionLimits(0.45, 40.0, 0.5, 0.6)))


def motion() -> LearnedMotion:
    plan = planned()
    step = PlanningModel(FOUND).step(TICK_S)
    return LearnedMotion.about(step, plan.motion.states, plan.motion.inputs, plan.gains, USUAL_WEIGHTS)


def attempt(correction: Array, friction_nm: float = 0.015) -> tuple[Array, Array]:
    """States and torques on a hoop with other numbers and a dry friction that nobody knows."""
    plan = planned()
    hidden = FoundEffect("hoop.coulomb_friction", {"Fc": friction_nm})
    true = replace(FOUND, entries=(*FOUND.entries, hidden))
    played = PlanTracker(true).run(plan.motion.states, plan.motion.inputs + correction, plan.gains, TICK_S, 0.7, OTHER)
    return played.states, played.inputs


def off(states: Array) -> float:
    return tracking_cost(states[1:] - planned().motion.states[1:], USUAL_WEIGHTS)


def test_a_second_attempt_is_three_times_nearer_to_the_plan_and_a_third_no_farther() -> None:
    step, learns = PlanningModel(FOUND).step(TICK_S), motion()
    correction, costs = np.zeros(len(planned().motion.inputs)), []
    mean = np.zeros((len(correction), 4))
    for k in range(3):
        states, torques = attempt(correction)
        costs.append(off(states))
        mean = mean_of_attempts(mean, k, unexplained(step, states, torques, TICK_S))
        correction = learns.correction(mean, -LIMIT_NM, LIMIT_NM)
        assert np.abs(correction).max() <= LIMIT_NM * (1.0 + 1e-9)
    assert costs[1] < costs[0] / 3.0 and costs[2] < 1.1 * costs[1], costs


def test_where_the_model_is_right_next_to_nothing_is_learned() -> None:
    plan, step = planned(), PlanningModel(FOUND).step(TICK_S)
    left = unexplained(step, plan.motion.states, plan.motion.inputs, TICK_S)
    assert np.abs(motion().correction(left, -LIMIT_NM, LIMIT_NM)).max() < 0.002


def test_how_far_off_a_correction_leads_is_what_the_plant_does() -> None:
    """The linear forecast beside the plant itself, pushed by a small torque in a third of the ticks."""
    n = len(planned().motion.inputs)
    push = np.where(np.arange(n) % 30 < 10, 0.004, 0.0)
    moved = PlanTracker(FOUND).run(
        planned().motion.states, planned().motion.inputs + push, planned().gains, TICK_S, 0.7
    )
    alone = PlanTracker(FOUND).run(planned().motion.states, planned().motion.inputs, planned().gains, TICK_S, 0.7)
    foretold = motion().off_plan(push, np.zeros((n, 4)))
    actual = (moved.states - alone.states)[1:]
    off, far = (np.abs(one)[:, 1:].max(axis=0) for one in (foretold - actual, actual))
    assert (off < 0.1 * far).all(), (off, far)


def test_feedback_on_a_wrong_estimate_is_told_as_the_torque_that_it_is() -> None:
    """A filter that tells the ball ahead by 0.02 rad all the way: feedback holds it back, and a correction must not."""
    plan, learns = planned(), motion()
    n = len(plan.motion.inputs)
    error = np.zeros((n, 4))
    error[:, 2] = 0.02
    torque = -np.sum(plan.gains * error, axis=1)
    off_by_torque = learns.off_plan(torque, np.zeros((n, 4)))
    off_by_estimate = learns.off_plan(np.zeros(n), learns.by_estimate(error, TICK_S))
    # as far as it is slow enough to be believed
    assert np.abs(off_by_torque - off_by_estimate)[:, 2].max() < 0.2 * np.abs(off_by_torque)[:, 2].max()
    correction = learns.correction(learns.by_estimate(error, TICK_S), -LIMIT_NM, LIMIT_NM)
    assert tracking_cost(learns.off_plan(correction + torque, np.zeros((n, 4))), USUAL_WEIGHTS) < 0.3 * tracking_cost(
        off_by_torque, USUAL_WEIGHTS
    )
