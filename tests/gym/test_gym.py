"""The environments: Gymnasium's own check, same seed and same bytes, the device's limits, tasks that are done."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, cast

import gymnasium
import msgspec
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

import hoopd.gym as hoops
from hoopd.core.controllers import Lqg
from hoopd.core.modes import Mode
from hoopd.files.controller import controller_of, parse_controller
from hoopd.files.model import EffectEntry, Parameter, model_text
from hoopd.gym.hidden_physics import HiddenPhysics
from hoopd.gym.hoop_env import HoopEnv
from hoopd.gym.plant_env import PlantEnv
from hoopd.gym.rig_env import RigEnv
from hoopd.gym.tasks import CATCH_BONUS, FAILURE_COST, FLIGHT_S, TASKS, Moment, task_of
from hoopd.plants.hoop.effects.contact_modes import AIR, INNER
from hoopd.plants.hoop.effects.lift_off import LIFT_OFF
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.trajectory import PlannedTrajectory, plan_trajectory
from hoopd.plants.model_file import load_model

Array = NDArray[np.float32]
SHIPPED = Path(__file__).resolve().parents[2] / "config"
LAW = controller_of(parse_controller((SHIPPED / "controllers/lqg.yaml").read_text(), "lqg.yaml"))


def held(observation: Array) -> Array:
    """The shipped law's torque for an observation."""
    assert isinstance(LAW, Lqg)
    gains, (hoop, sine, cosine, speed, *_) = LAW.gains, observation.tolist()
    torque = -gains.k_dtheta * hoop - gains.k_psi * np.arctan2(sine, cosine) - gains.k_dpsi * speed
    return np.clip(np.array([torque], np.float32), -0.7, 0.7)


def played(env: HoopEnv, agent: Callable[[Array], Array], **start: float) -> tuple[float, dict[str, object]]:
    """Reward of a try, and the last tick's info."""
    seen, _ = env.reset(seed=1, options=dict(start) or None)
    total, over = 0.0, False
    while not over:
        seen, reward, ended, cut, info = env.step(agent(seen))
        total, over = total + float(reward), ended or cut
    return total, info


@pytest.mark.parametrize(
    ("task", "over"), [(name, over) for name in TASKS for over in ("plant", "rig") if over == "plant" or name != "up"]
)
def test_gymnasium_finds_nothing_wrong(task: str, over: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        warnings.filterwarnings("ignore", message=".*(normalized|render).*")
        check_env(gymnasium.make(f"hoopd/{task.capitalize()}-v0", over=over).unwrapped)


@pytest.mark.parametrize("over", ["plant", "rig"])
def test_the_same_seed_gives_the_same_observations_and_another_one_others(over: str) -> None:
    def seen(seed: int) -> Array:
        env = hoops.make("bottom", over, spread=0.1)
        rows = [env.reset(seed=seed)[0]]
        rows += [env.step(np.array([0.05 * np.sin(0.2 * k)], np.float32))[0] for k in range(40)]
        env.close()
        return np.array(rows)

    assert np.array_equal(seen(3), seen(3))
    assert not np.array_equal(seen(3), seen(4))


@pytest.mark.parametrize("over", ["plant", "rig"])
def test_the_shipped_law_brings_the_ball_to_the_bottom(over: str) -> None:
    env = hoops.make("bottom", over)
    reward, info = played(env, held, ball_rad=0.6)
    idle, _ = played(env, lambda seen: np.zeros(1, np.float32), ball_rad=0.6)
    env.close()
    assert info["success"] and info["ended"] == "done"
    assert reward > idle + 5.0


def test_the_torque_is_the_devices_and_a_hoop_that_turns_too_fast_ends_it() -> None:
    plant, rig = PlantEnv("bottom"), RigEnv("bottom")
    assert plant.action_space == rig.action_space == gymnasium.spaces.Box(-np.float32(0.7), np.float32(0.7), (1,))
    far = lambda seen: np.array([50.0], np.float32)  # noqa: E731
    _, info = played(plant, far, ball_rad=0.0)
    assert "the hoop turned" in str(info["ended"]) or "left the hoop" in str(info["ended"])
    rig.reset(seed=0)
    for _ in range(3):
        *_, info = rig.step(far(np.zeros(6, np.float32)))
    assert info["torque_nm"] == 0.7
    over = False
    while not over:
        _, _, over, _, info = rig.step(far(np.zeros(6, np.float32)))
    assert "left the hoop" in info["ended"] or "hoop_overspeed" in info["ended"]
    rig.close()


def test_a_hoop_that_turns_too_fast_costs_as_a_failure_does() -> None:
    env, ticks = PlantEnv("throw"), 0
    env.reset(seed=1, options={"ball_rad": 0.05})
    over = False
    while not over:
        _, reward, over, _, info = env.step(np.array([0.7], np.float32))
        ticks += 1
    cost = task_of("throw").failure_cost(0.02 * ticks)
    assert "the hoop turned" in info["ended"] and -cost - 0.5 < reward <= -cost
    env.close()


@pytest.mark.parametrize("task", TASKS)
def test_no_failure_is_worth_more_than_doing_nothing(task: str) -> None:
    env = PlantEnv(task)
    idle, _ = played(env, lambda seen: np.zeros(1, np.float32), ball_rad=0.05)
    wrecked, info = played(env, lambda seen: np.full(1, 0.7, np.float32), ball_rad=0.05)
    env.close()
    assert not info["success"] and wrecked < idle - 0.9 * FAILURE_COST


@pytest.mark.parametrize("radius_m", [0.0445, 0.063, 0.074])
def test_a_ball_on_the_top_of_any_inner_hoop_is_up(radius_m: float) -> None:
    """Not one that is as near to the axis in the air."""
    distance = (radius_m + 0.0104) / (0.0957 - 0.0104)

    def succeeded(mode: str) -> bool:
        judge = task_of("up").judge(0.02)
        return any(judge.see(Moment(0.02 * k, 0.0, np.pi, 0.0, distance, 0.0, mode)).success for k in range(150))

    assert succeeded(INNER) and not succeeded(AIR)


def test_a_reward_is_of_the_torque_that_was_given() -> None:
    def reward(torque_nm: float) -> float:
        env = PlantEnv("bottom")
        env.reset(seed=1, options={"ball_rad": 0.0})
        return env.step(np.array([torque_nm], np.float32))[1]

    assert reward(100.0) == pytest.approx(reward(0.7)) and reward(0.7) < reward(0.1)


def test_the_model_s_own_landing_is_the_plant_s(tmp_path: Path) -> None:
    own = EffectEntry(LIFT_OFF, {"restitution": Parameter(0.4, "-"), "grip": Parameter(0.3, "-")})
    model = tmp_path / "bouncy.yaml"
    model.write_text(model_text(msgspec.structs.replace(load_model(SHIPPED / "models/hoop.yaml"), effects=[own])))

    def landing(**physics: Any) -> dict[str, float]:
        found = HiddenPhysics(**physics).drawn(np.random.default_rng(0))
        return dict(next(one.parameters for one in found.entries if one.name == LIFT_OFF))

    assert landing(model=model) == {"restitution": 0.4, "grip": 0.3}
    assert landing(model=model, effects={LIFT_OFF: {"restitution": 0.1}})["restitution"] == 0.1
    assert landing()["restitution"] == 0.0


def test_a_fault_of_the_rig_ends_the_try_and_costs_as_a_failure_does() -> None:
    env = RigEnv("bottom", sets=("sim.faults=[{kind: camera_stall, at_s: 1.0}]",))
    total, info = played(env, lambda seen: np.zeros(1, np.float32), ball_rad=0.1)
    assert "camera_lost" in str(info["ended"]) and env.rig.tick.mode is not Mode.RUNNING
    cost = task_of("bottom").failure_cost(cast("float", info["t"]))
    assert -cost - 0.5 < total <= -cost + 1e-6
    env.close()


def test_hidden_physics_act_and_nobody_is_told() -> None:
    def end(effects: dict[str, dict[str, float]]) -> float:
        env = PlantEnv("bottom", effects=effects)
        env.reset(seed=0, options={"ball_rad": 0.5})
        for _ in range(60):
            seen, *_ = env.step(np.array([0.03], np.float32))
        return float(seen[0])

    assert end({"hoop.coulomb_friction": {"Fc": 0.02}}) < 0.6 * end({})
    with pytest.raises(ValueError, match=r"unknown effect 'hoop\.nothing'"):
        PlantEnv(effects={"hoop.nothing": {}}).reset(seed=0)
    with pytest.raises(ValueError, match=r"spread must be 0 to 0\.5, not 2"):
        PlantEnv(spread=2.0)


def test_parameters_are_drawn_anew_in_every_try() -> None:
    env = PlantEnv("bottom", spread=0.2)
    ends = []
    for _ in range(2):
        env.reset(seed=None if ends else 5, options={"ball_rad": 0.5})
        for _ in range(30):
            seen, *_ = env.step(np.array([0.05], np.float32))
        ends.append(seen[0])
    assert ends[0] != ends[1]


def test_what_cannot_be_meant_is_one_line() -> None:
    with pytest.raises(ValueError, match="unknown task 'juggle'; known: bottom, loop, throw, up"):
        hoops.make("juggle")
    with pytest.raises(ValueError, match="over must be plant or rig"):
        hoops.make("bottom", "device")
    with pytest.raises(ValueError, match="ball_rad alone"):
        PlantEnv().reset(options={"speed": 1.0})
    for value in (None, "x", [1]):
        with pytest.raises(ValueError, match="ball_rad alone"):
            PlantEnv().reset(options={"ball_rad": value})
    with pytest.raises(ValueError, match=r"spread must be 0 to 0\.5, not 'a'"):
        PlantEnv(spread=cast("Any", "a"))
    with pytest.raises(gymnasium.error.ResetNeeded):
        PlantEnv().step(np.zeros(1, np.float32))
    with pytest.raises(ValueError, match="has no inner hoop"):
        PlantEnv("up", model="models/hoop.yaml")
    with pytest.raises(ValueError, match=r"effects: .*nope"):
        PlantEnv(effects={"nope": {}})


@pytest.mark.parametrize(
    "options",
    [
        {"effects": {"hoop.coulomb_friction": None}},
        {"effects": {"hoop.coulomb_friction": {"Fc": "0.01"}}},
        {"effects": {3: {}}},
        {"effects": [1]},
        {"effects": []},
        {"model": 3},
    ],
)
@pytest.mark.parametrize("over", ["plant", "rig"])
def test_physics_that_are_none_are_one_line(over: str, options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"^(effects|model): a "):
        hoops.make("bottom", over, **options)


@pytest.mark.parametrize("options", [[1], "x", 3])
def test_options_of_a_reset_are_a_mapping(options: object) -> None:
    with pytest.raises(ValueError, match="ball_rad alone"):
        PlantEnv().reset(options=cast("Any", options))


@pytest.mark.parametrize("action", [[0.1, 0.2], [], 0.1, [float("nan")], "0.1", ["0.1"], [0.1 + 1j], [None]])
def test_an_action_is_one_torque(action: object) -> None:
    env = PlantEnv()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="one torque in N m"):
        env.step(cast("Any", action))


@pytest.mark.parametrize("over", ["plant", "rig"])
def test_nothing_is_won_after_the_end(over: str) -> None:
    env = hoops.make("bottom", over).unwrapped
    env.reset(seed=0, options={"ball_rad": 0.0})
    try:
        over_at = next(k for k in range(500) if env.step(np.zeros(1, np.float32))[2])
        assert over_at > 10
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(np.zeros(1, np.float32))
        env.reset(seed=0)
    finally:
        env.close()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(1, np.float32))


@cache
def plan(kind: str) -> PlannedTrajectory:
    model = load_model(SHIPPED / "models/hoop.yaml")
    return plan_trajectory(model, ManeuverQuestion(kind, MotionLimits(0.45, 40.0, 0.5, 0.6)))


@pytest.mark.parametrize(("kind", "over"), [("loop", "plant"), ("loop", "rig"), ("throw", "plant"), ("throw", "rig")])
def test_what_our_planner_planned_does_the_task(kind: str, over: str) -> None:
    """Played with its own feedback: of the state, and over the rig of what an agent is shown there."""
    planned, env = plan(kind), hoops.make(kind, over)
    seen, _ = env.reset(seed=2, options={"ball_rad": 0.0})
    hoop = 0.0
    for gains, state, torque in zip(planned.gains, planned.motion.states, planned.motion.inputs, strict=False):
        angle = np.arctan2(seen[1], seen[2])
        angle += 2 * np.pi * round((state[2] - angle) / (2 * np.pi))
        off = np.array([hoop, seen[0], angle, seen[3]]) - state
        seen, _, over_now, _, info = env.step(np.array([torque - gains @ off], np.float32))
        assert not over_now, info
    assert seen[4] == 1.0
    while not over_now:
        seen, _, over_now, cut, info = env.step(held(seen))
        assert not cut, info
    env.close()
    assert info["success"], info


def test_up_is_done_by_our_plan_and_by_nothing_that_stays_below() -> None:
    model = load_model(SHIPPED / "models/inner_hoop.yaml")
    planned = plan_trajectory(model, ManeuverQuestion("up", MotionLimits(0.45, 40.0, 0.5, 0.6)))
    env = hoops.make("up")
    seen, _ = env.reset(seed=2, options={"ball_rad": 0.0})
    rows, info = zip(planned.gains, planned.motion.states, planned.motion.inputs, strict=False), {}
    for gains, state, torque in rows:
        angle = np.arctan2(seen[1], seen[2])
        angle += 2 * np.pi * round((state[2] - angle) / (2 * np.pi))
        off = np.array([0.0, seen[0], angle, seen[3]]) - state
        seen, reward, over, _, info = env.step(np.array([torque - gains @ off], np.float32))
        if over:
            break
    assert info["success"] and seen[5] < 0.7 and reward > 9.0
    _, idle = played(env, lambda seen: np.zeros(1, np.float32), ball_rad=0.0)
    assert not idle["success"]
    with pytest.raises(ValueError, match="up is over the plant alone"):
        hoops.make("up", "rig")


def test_a_throw_needs_a_flight_and_a_catch() -> None:
    task = task_of("throw")

    def judged(flight_s: float) -> tuple[float, bool]:
        """The largest reward of a tick, and whether it succeeded."""
        judge, t, rewards, success = task.judge(0.02), 0.0, [], False
        for distance, seconds in ((1.0, 0.1), (0.9, flight_s), (1.0, 1.0)):
            for _ in range(round(seconds / 0.02)):
                t += 0.02
                verdict = judge.see(Moment(t, 0.0, 0.0, 0.0, distance, 0.0))
                rewards.append(verdict.reward if not verdict.over else 0.0)
                success = success or verdict.success
        return max(rewards), success

    assert judged(FLIGHT_S + 0.04) == (CATCH_BONUS, True)
    assert judged(0.04) == (0.0, False)


def test_a_loop_task_ends_when_the_ball_flies() -> None:
    judge = task_of("loop").judge(0.02)
    verdict = judge.see(Moment(0.02, 0.0, 2.0, 0.0, 0.95, 0.0))
    assert verdict.over and not verdict.success and verdict.why == "the ball left the hoop"


def test_the_guide_s_example_runs() -> None:
    page = (SHIPPED.parent / "docs/guides/gym.md").read_text()
    space: dict[str, object] = {}
    exec(page.split("```python\n")[1].split("```")[0], space)
    assert space["info"]["success"] is True  # type: ignore[index]
