"""Plans on a drive with a dead zone, played by an integrator of its own; what a search that fails may say."""

from __future__ import annotations

from math import tau

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.files.model import EffectEntry, ModelFile, Parameter
from hoopd.files.shipped import defaults_folder
from hoopd.plants.collocation import CollocatedMotion
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.planning import InfeasibleError, infeasible
from hoopd.plants.hoop.maneuver.trajectory import plan_trajectory
from hoopd.plants.model_file import load_model
from tests.plants.maneuver.independent import played

Array = NDArray[np.float64]
HOOP = load_model(defaults_folder() / "models" / "hoop.yaml")
LIMITS = MotionLimits(0.6, 40.0, 0.5, 0.6)


def with_dead_zone(d: float) -> ModelFile:
    size = Parameter(value=d, unit="N m")
    return msgspec.structs.replace(HOOP, effects=[EffectEntry(name="actuator.deadzone", parameters={"d": size})])


def left_of(torques: Array, d: float) -> Array:
    return np.sign(torques) * np.maximum(np.abs(torques) - d, 0.0)


@pytest.mark.parametrize("d", [0.05, 0.15])
def test_a_throw_is_planned_behind_the_dead_zone(d: float) -> None:
    """At rest a search sees no slope within the zone."""
    plain = plan_trajectory(HOOP, ManeuverQuestion("throw", LIMITS)).motion
    planned = plan_trajectory(with_dead_zone(d), ManeuverQuestion("throw", LIMITS))
    motion, (off, _) = planned.motion, planned.flight_ticks or (0, 0)
    assert np.abs(motion.inputs).max() == pytest.approx(np.abs(plain.inputs).max() + d, abs=2e-3)
    assert planned.question.limits.torque_nm == LIMITS.torque_nm
    assert motion.inputs[0] == motion.inputs[-1] == 0.0
    run_up = played(left_of(motion.inputs[:off], d), motion.tick_s, HOOP.values())
    assert np.abs(run_up - motion.states[: off + 1]).max() < 1e-4
    assert planned.nominal.flown_s == pytest.approx(0.18, abs=1e-3) and planned.nominal.arrived
    assert sum(one.arrived for one in planned.sampled) >= 36


def test_a_loop_and_a_swing_take_the_ball_where_they_are_to_on_such_a_drive() -> None:
    d = 0.1
    for kind, end in (("loop", tau), ("swing", 0.0)):
        motion = plan_trajectory(with_dead_zone(d), ManeuverQuestion(kind, LIMITS)).motion
        x = played(left_of(motion.inputs, d), motion.tick_s, HOOP.values())
        assert x[-1, 2] == pytest.approx(end, abs=1e-3) and np.abs(x - motion.states).max() < 1e-3
        assert np.abs(motion.inputs).max() <= LIMITS.torque_nm + 1e-4


def test_a_dead_zone_as_wide_as_the_torque_leaves_no_plan() -> None:
    with pytest.raises(InfeasibleError, match=r"a dead zone of 0.6 N m leaves nothing of a torque of 0.6 N m"):
        plan_trajectory(with_dead_zone(0.6), ManeuverQuestion("swing", LIMITS))


def stopped(status: str) -> CollocatedMotion:
    excess = {"torque": 0.03, "grip": 0.3}
    return CollocatedMotion(0.02, np.zeros((25, 4)), np.zeros(24), excess, status, 300)


def test_a_search_without_an_end_blames_no_limit() -> None:
    ended = infeasible(stopped("Solve_Succeeded"), "no loop")
    assert (ended.group, str(ended)) == (
        "grip",
        "no loop in 0.48 s: it would exceed grip by 0.3 of the ball's weight, torque by 3 %",
    )
    for status in ("Maximum_Iterations_Exceeded", "Infeasible_Problem_Detected", "Maximum_CpuTime_Exceeded"):
        error = infeasible(stopped(status), "no loop")
        assert (error.group, str(error)) == ("search", f"no loop in 0.48 s was found ({status})")
