"""Plans of the ball's way round, held by an integrator and equations of their own."""

from __future__ import annotations

from functools import cache
from math import pi, tau
from typing import Any

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from samples import sampled

from hoopd.core.tracker import LONGEST_PLAN_TICKS
from hoopd.files.model import EffectEntry, InnerHoop, ModelFile, Parameter
from hoopd.files.shipped import defaults_folder
from hoopd.files.trajectory import parse_trajectory, trajectory_text
from hoopd.plants.hoop.maneuver import trajectory
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.planning import InfeasibleError
from hoopd.plants.hoop.maneuver.trajectory import PlannedTrajectory, plan_trajectory, trajectory_file
from hoopd.plants.model_file import load_model
from tests.plants.maneuver.independent import contact, grip, played

Array = NDArray[np.float64]
HOOP = load_model(defaults_folder() / "models" / "hoop.yaml")
LIMITS = MotionLimits(0.45, 40.0, 0.5, 0.6)


@cache
def loop(turn: int = 1) -> PlannedTrajectory:
    return plan_trajectory(HOOP, ManeuverQuestion("loop", LIMITS, turn=turn))


def with_effect(name: str, **values: tuple[float, str]) -> ModelFile:
    parameters = {key: Parameter(value=value, unit=unit) for key, (value, unit) in values.items()}
    return msgspec.structs.replace(HOOP, effects=[EffectEntry(name=name, parameters=parameters)])


def test_the_planned_torques_take_the_ball_once_round_by_another_integrator() -> None:
    motion, values = loop().motion, HOOP.values()
    x = played(motion.inputs, motion.tick_s, values)
    assert np.abs(x - motion.states).max() < 1e-4
    assert x[-1, 2] == pytest.approx(tau, abs=1e-4) and np.abs(x[-1, [1, 3]]).max() < 2e-3


def test_every_limit_is_kept_along_the_way_with_its_margin() -> None:
    motion, values = loop().motion, HOOP.values()
    x = motion.states
    assert np.abs(motion.inputs).max() <= LIMITS.torque_nm and np.abs(x[:, 1]).max() <= LIMITS.hoop_speed_rad_s
    # between the edges, too: collocation asks at three points of each tick
    fine = played(np.repeat(motion.inputs, 8), motion.tick_s / 8, values)
    assert contact(fine, values).min() > LIMITS.contact - 5e-3
    needed = [grip(one, torque, values) for one, torque in zip(fine[1:], np.repeat(motion.inputs, 8), strict=True)]
    assert max(needed) < LIMITS.grip + 0.02
    assert motion.inputs[0] == motion.inputs[-1] == 0.0


def test_what_the_report_says_is_what_the_plan_is() -> None:
    planned, values = loop(), HOOP.values()
    report = trajectory_file(planned, "models/hoop.yaml", "ab", "loop").report
    assert report["least_contact"] == pytest.approx(contact(planned.motion.states, values).min(), abs=1e-3)
    assert report["largest_torque_nm"] == pytest.approx(np.abs(planned.motion.inputs).max(), abs=1e-4)
    assert report["sampled_models_arrived"] == report["sampled_models"] == 40
    assert report["seconds"] < 1.6 and report["open_loop_end_rad"] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.proof
def test_the_other_way_round_is_the_mirror_image() -> None:
    one, other = loop(1).motion, loop(-1).motion
    assert other.inputs == pytest.approx(-one.inputs, abs=2e-4)
    assert other.states[-1, 2] == pytest.approx(-tau)


def test_feedback_keeps_a_hoop_that_is_off_on_its_way_where_torques_alone_do_not() -> None:
    motion, gains, values = loop().motion, loop().gains, {**HOOP.values(), "Ih": 1.15 * HOOP.values()["Ih"]}
    alone = played(motion.inputs, motion.tick_s, values)
    x = np.zeros(4)
    for k, torque in enumerate(motion.inputs):
        # a step of the other integrator from wherever it is
        x = one_step(x, float(torque - gains[k] @ (x - motion.states[k])), motion.tick_s, values)
    assert abs(x[2] - tau) < 0.1 < abs(alone[-1, 2] - tau)


def one_step(x: Array, torque: float, tick_s: float, values: dict[str, float]) -> Array:
    from scipy.integrate import solve_ivp

    from tests.plants.maneuver.independent import accelerations

    def rate(t: float, y: Array) -> list[float]:
        theta2, psi2 = accelerations(y, torque, values)
        return [y[1], theta2, y[3], psi2]

    return np.asarray(solve_ivp(rate, (0.0, tick_s), x, rtol=1e-9, atol=1e-11).y[:, -1])


def test_friction_that_was_found_is_in_the_plan() -> None:
    """Planned with it, the torques take the ball round on a hoop that has it; planned without it they do not."""
    level = 0.02

    def dry(x: Array) -> Array:
        return np.array([-level * np.tanh(x[1] / 0.05), 0.0])

    model = with_effect("hoop.coulomb_friction", Fc=(level, "N m"))
    motion = plan_trajectory(model, ManeuverQuestion("loop", LIMITS)).motion
    with_it = played(motion.inputs, motion.tick_s, HOOP.values(), dry)
    without = played(loop().motion.inputs, motion.tick_s, HOOP.values(), dry)
    assert abs(with_it[-1, 2] - tau) < 0.15 and abs(without[-1, 2] - tau) > 0.5


INFEASIBLE: dict[str, tuple[MotionLimits, dict[str, Any], str]] = {
    "too little torque": (MotionLimits(0.1, 40.0, 0.5), {}, "contact force"),
    "too little time": (MotionLimits(0.45, 200.0, 0.5), {"seconds": 0.6}, "torque"),
    "too slow a hoop": (MotionLimits(0.45, 10.0, 0.5), {"seconds": 1.4}, "hoop speed"),
    "too slippery": (MotionLimits(0.45, 40.0, 0.0, 0.05), {"seconds": 1.4}, "grip"),
}


@pytest.mark.parametrize("name", sampled(INFEASIBLE, ["too slow a hoop", "too slippery"]))
def test_what_cannot_be_planned_says_what_stands_in_the_way(name: str) -> None:
    limits, changes, group = INFEASIBLE[name]
    with pytest.raises(InfeasibleError, match=f"would exceed {group}") as caught:
        plan_trajectory(HOOP, ManeuverQuestion("loop", limits, **changes))
    assert caught.value.group == group and caught.value.excess > 0.0


def test_a_plan_that_cannot_be_tightened_is_the_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    """More than its weight at rest presses no ball on: what was found first is left."""
    far = loop().nominal._replace(end_rad=1.0)
    found = loop()._replace(sampled=[far])
    assert not far.arrived
    monkeypatch.setattr(trajectory, "_planned", lambda *_: found)
    assert plan_trajectory(HOOP, ManeuverQuestion("loop", MotionLimits(0.45, 40.0, 0.86, 0.6))) is found


def test_no_plan_has_more_ticks_than_are_played(monkeypatch: pytest.MonkeyPatch) -> None:
    motion = loop().motion
    long = motion._replace(inputs=np.zeros(LONGEST_PLAN_TICKS + 1))
    monkeypatch.setattr(trajectory, "_fed_back", lambda *_: (long, loop().gains, None, None))
    with pytest.raises(ValueError, match=r"the loop takes 501 ticks of 0.02 s, and a plan has 500 at most"):
        plan_trajectory(HOOP, ManeuverQuestion("loop", LIMITS))


def test_a_swing_reaches_its_angle_at_rest_and_comes_back() -> None:
    motion = plan_trajectory(HOOP, ManeuverQuestion("swing", LIMITS, angle_rad=0.8, turn=-1)).motion
    middle = motion.states[len(motion.inputs) // 2]
    assert middle[2] == pytest.approx(-0.8) and middle[3] == pytest.approx(0.0, abs=1e-9)
    assert motion.states[-1, 2] == 0.0 and motion.states[:, 2].min() > -0.81


@pytest.mark.parametrize(
    "asked",
    [{"kind": "jump"}, {"turn": 0}, {"kind": "swing", "angle_rad": pi}, {"seconds": 0.1}, {"seconds": 60.0}],
)
def test_a_question_without_an_answer_is_refused(asked: dict[str, Any]) -> None:
    with pytest.raises(ValueError):
        ManeuverQuestion(**{"kind": "loop", "limits": LIMITS, **asked})
    with pytest.raises(ValueError):
        MotionLimits(0.45, 40.0, 1.0)


def test_its_file_holds_the_whole_plan() -> None:
    file = trajectory_file(loop(), "models/hoop.yaml", "ab", "loop")
    assert parse_trajectory(trajectory_text(file), "loop.yaml") == file
    assert np.array(file.plan.states) == pytest.approx(loop().motion.states, rel=1e-8, abs=1e-12)
    assert file.plan.suspends == ["ball_runaway"] and len(file.plan.torques_nm) <= LONGEST_PLAN_TICKS


@pytest.mark.proof
def test_a_sampled_model_that_loses_the_ball_asks_for_more_contact() -> None:
    wide = {name: (0.75 * value, 1.25 * value) for name, value in HOOP.values().items() if name in ("Ro", "Ih", "Ib")}
    parameters = {
        name: Parameter(value=HOOP.values()[name], unit={"Ro": "m"}.get(name, "kg m^2"), ci95=interval)
        for name, interval in wide.items()
    }
    model = msgspec.structs.replace(HOOP, parameters={**HOOP.parameters, **parameters})
    planned = plan_trajectory(model, ManeuverQuestion("loop", MotionLimits(0.45, 40.0, 0.1, 0.6)))
    assert planned.question.limits.contact > 0.1


@cache
def throw(turn: int = 1) -> PlannedTrajectory:
    return plan_trajectory(HOOP, ManeuverQuestion("throw", LIMITS, turn=turn))


def test_a_throw_leaves_the_hoop_flies_a_parabola_and_is_back_at_rest() -> None:
    """The run-up by the other integrator; then the parabola; then the other integrator again."""
    planned, p = throw(), HOOP.values()
    motion, (off, on) = planned.motion, planned.flight_ticks or (0, 0)
    track = p["Ro"] - p["Rb"]
    run_up = played(motion.inputs[:off], motion.tick_s, p)
    assert np.abs(run_up - motion.states[: off + 1]).max() < 1e-4
    force = contact(run_up, p)
    assert force[:-1].min() > 0.0 and force[-1] == pytest.approx(0.0, abs=1e-3)
    psi, rate = run_up[-1, 2:]
    place, speed = track * np.array([np.sin(psi), -np.cos(psi)]), track * rate * np.array([np.cos(psi), np.sin(psi)])
    for k, s in enumerate(motion.tick_s * np.arange(on - off + 1)):
        x, y = place + speed * s - np.array([0.0, p["g"] * s * s / 2])
        assert np.hypot(x, y) <= track * (1 + 1e-4)
        assert np.cos(motion.states[off + k, 2]) == pytest.approx(-y / np.hypot(x, y), abs=1e-3)
    assert np.hypot(x, y) == pytest.approx(track, rel=1e-3) and (on - off) * motion.tick_s == pytest.approx(0.18)
    # the hoop meets it as fast as it rolls: nothing slides where it lands
    spin = p["Ro"] * run_up[-1, 1] - track * run_up[-1, 3]
    landed = motion.states[on]
    assert p["Ro"] * landed[1] - track * landed[3] == pytest.approx(spin, abs=1e-3)
    rest = one_by_one(landed, motion.inputs[on:], motion.tick_s, p)
    assert rest[2] == pytest.approx(tau, abs=1e-3) and np.abs(rest[[1, 3]]).max() < 2e-2


def one_by_one(x: Array, torques: Array, tick_s: float, values: dict[str, float]) -> Array:
    for torque in torques:
        x = one_step(x, float(torque), tick_s, values)
    return x


def test_a_throw_s_report_and_file_tell_of_its_flight() -> None:
    planned = throw()
    file = trajectory_file(planned, "models/hoop.yaml", "ab", "throw")
    assert parse_trajectory(trajectory_text(file), "throw.yaml") == file
    assert file.plan.flight is not None and file.plan.flight.ticks == 9 and file.plan.suspends == ["ball_runaway"]
    assert file.plan.flight.suspends == ["ball_lost", "ball_implausible"]
    assert file.report["flight_s"] == 0.18 and file.report["tracked"]["flown_s"] == pytest.approx(0.18, abs=1e-3)
    assert file.report["sampled_models_arrived"] >= 36 and file.report["open_loop_end_rad"] == pytest.approx(
        0.0, abs=1e-4
    )
    # in the air the hoop alone is fed back
    air = planned.gains[slice(*planned.flight_ticks)]
    assert not air[:, [0, 2, 3]].any() and air[:, 1].min() > 0.0


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"flight_s": 0.15}, "whole ticks"),
        ({"flight_s": 0.5}, "a flight takes 0.045 to 0.231 s"),
        ({"seconds": 2.0}, "cannot be told of a throw"),
    ],
)
def test_a_throw_that_no_ball_has_is_refused(asked: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        plan_trajectory(HOOP, ManeuverQuestion("throw", LIMITS, **asked))


def test_a_throw_with_too_little_torque_says_which_part() -> None:
    with pytest.raises(InfeasibleError, match=r"no run-up of a throw in .* s: it would exceed torque"):
        plan_trajectory(HOOP, ManeuverQuestion("throw", MotionLimits(0.01, 40.0, 0.5)))


def test_a_flight_keeps_the_torque_s_limit_too() -> None:
    """A run-up with little torque leaves a hoop that is slow: in the air it would take 0.47 N m to meet the ball."""
    inner = msgspec.structs.replace(HOOP, device=msgspec.structs.replace(HOOP.device, inner=InnerHoop(0.0445)))
    with pytest.raises(InfeasibleError, match="no up: in the flight it would exceed torque by 2") as caught:
        plan_trajectory(inner, ManeuverQuestion("up", MotionLimits(0.15, 40.0, 0.5, 0.6)))
    assert caught.value.group == "torque" and caught.value.excess > 1.0


def test_no_plan_needs_more_grip_than_the_model_s_contact_has() -> None:
    """Planned as a ball that rolls, it would stay at the bottom and slip."""
    with pytest.raises(InfeasibleError, match=r"no loop in .* s: it would exceed grip"):
        plan_trajectory(with_effect("ball.slip", mu=(0.0167, "-")), ManeuverQuestion("loop", LIMITS))
    kept = plan_trajectory(with_effect("ball.slip", mu=(0.45, "-")), ManeuverQuestion("loop", LIMITS))
    assert kept.question.limits.grip == 0.45 and np.max(kept.grip) <= 0.45 + 1e-3
