"""The filter through a throw on the rig: mode and its probability, place, innovations in flight and after the catch."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.core.records import Estimate
from hoopd.daemon.app import Options
from hoopd.daemon.build import Texts, build_tick
from hoopd.daemon.maneuver import AskedManeuver, run
from hoopd.daemon.recording_target import Where
from hoopd.daemon.replay import recorded_config, replay
from hoopd.files.shipped import defaults_folder
from hoopd.files.trajectory import TrajectoryFile
from hoopd.plants.hoop.maneuver.maneuver_question import ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.trajectory import plan_trajectory, trajectory_file
from hoopd.plants.model_file import load_model
from hoopd.recording.mcap import RecordedRun, read_run
from hoopd.sim import truth

Array = NDArray[np.float64]
HOOP = load_model(defaults_folder() / "models" / "hoop.yaml")
# A change of mode within a tick is one or the other.
NEAR_S = 0.02
# Pictures are so old when they are used, and a catch is over after so long.
OLD_S, AFTER_S = 0.05, 0.3


@cache
def throw() -> TrajectoryFile:
    planned = plan_trajectory(HOOP, ManeuverQuestion("throw", MotionLimits(0.45, 40.0, 0.5, 0.6)))
    return trajectory_file(planned, "models/hoop.yaml", "ab", "throw")


class Thrown(NamedTuple):
    """A throw with what the filter thought of it, tick by tick while the ball might fly."""

    recorded: RecordedRun
    t: Array
    estimates: list[Estimate]
    true: Array  # (n, 5) theta, dtheta, psi, dpsi, distance
    changes: Array  # s, of the true mode

    @property
    def flies(self) -> NDArray[np.bool_]:
        return np.asarray(self.true[:, 4] < 1.0)

    def away(self) -> NDArray[np.bool_]:
        """Ticks away from every take-off and landing."""
        return np.asarray(np.abs(self.t[:, None] - self.changes).min(axis=1) > NEAR_S)


def thrown(folder: Path, restitution: float, seed: int = 0, *, direct: bool = True) -> Thrown:
    numbers = f"{{restitution: {restitution}, grip: 0.3}}"
    hidden = f"sim.effects=[{{name: ball.lift_off, parameters: {numbers}}}]"
    sets = (f"sim.directory={folder}", "log.level=error", hidden)
    rig = Options(sim=True, speed="max", direct=direct, sets=sets, seed=seed)
    result = run(AskedManeuver(throw(), "throw.yaml"), rig, Where(file=folder / "run.mcap"))
    assert result["succeeded"] == 1, result
    assert replay(folder / "run.mcap")["equal"]
    return looked_into(folder)


def looked_into(folder: Path) -> Thrown:
    """The recording once more through its tick, and the estimates that this makes."""
    recorded, true = read_run(folder / "run.mcap"), truth.read(folder / "truth.csv")
    header = recorded.header
    texts = Texts(header.config, header.model, header.controller, header.law)
    tick = build_tick(recorded_config("run.mcap", header.config), texts)
    estimator: Any = tick.succession.acting.filter.estimator
    update, found = estimator.update, []

    def watched(t: float, *args: Any, **kwargs: Any) -> Estimate:
        estimate: Estimate = update(t, *args, **kwargs)
        if estimate.ball is not None:
            found.append((t, estimate))
        return estimate

    estimator.update = watched
    for inputs in recorded.inputs:
        tick.step(inputs)
    t = np.array([at for at, _ in found])
    columns = np.column_stack([true.theta, true.dtheta, true.psi, true.dpsi, true.distance])
    rows = np.abs(true.t[:, None] - t).argmin(axis=0)
    changes = true.t[np.flatnonzero(np.diff((true.distance < 1.0).astype(int)))] + 0.01
    return Thrown(recorded, t, [estimate for _, estimate in found], columns[rows], changes)


@pytest.mark.parametrize("restitution", [0.0, 0.4])
def test_mode_and_innovations_are_right_through_a_throw(tmp_path: Path, restitution: float) -> None:
    one = thrown(tmp_path, restitution)
    balls = [estimate.ball for estimate in one.estimates if estimate.ball is not None]
    assert one.flies.sum() >= 7 and len(balls) > 60
    right = np.array([(ball.mode == "air") == flies for ball, flies in zip(balls, one.flies, strict=True)])
    assert right[one.away()].mean() > 0.95
    # surer than a coin of what it says, nearly always sure
    probabilities = np.array([ball.probability for ball in balls])
    assert probabilities.min() >= 0.4 and np.median(probabilities) > 0.99
    # innovations over what is expected of them: in the air and after the catch of pictures, hoop and distance
    landed_s, old_s = one.t[one.flies][-1], one.t - OLD_S
    began_s = one.t[one.flies][0]
    surprises = np.array(
        [(*estimate.surprise, ball.surprise) for estimate, ball in zip(one.estimates, balls, strict=True)]
    )
    for during in ((old_s > began_s) & (old_s < landed_s), (old_s >= landed_s) & (old_s < landed_s + AFTER_S)):
        some = surprises[during]
        assert np.nanmax(np.abs(some)) < 4.0
        assert (np.sqrt(np.nanmean(some[:, :3] ** 2, axis=0)) < 1.6).all()
    assert np.isfinite(surprises[:, 3]).sum() >= 6
    # place, where it is known by pictures of the flight
    middle = (one.t > began_s + 0.06) & (one.t < landed_s)
    distances = np.array([ball.distance for ball in balls])
    assert np.abs(distances - one.true[:, 4])[middle].max() < 0.03
    psi = np.array([estimate.x[2] for estimate in one.estimates])
    assert np.abs(psi - one.true[:, 2])[middle].max() < 0.08


def test_the_recording_tells_of_the_flight_and_pictures_show_it(tmp_path: Path) -> None:
    one = thrown(tmp_path, 0.2, direct=False)
    flying = [tick for tick in one.recorded.ticks if tick.ball_mode == "air"]
    assert 6 <= len(flying) <= 14 and all(tick.distance_hat <= 1.001 for tick in flying)
    assert {tick.ball_mode for tick in one.recorded.ticks} == {"", "rolling", "air"}
    seen = [tick.distance for tick in one.recorded.ticks if np.isfinite(tick.distance)]
    assert min(seen) == pytest.approx(one.true[:, 4].min(), abs=0.05)
    # off its track the ball's angle is none of a ball on the hoop
    assert all(np.isnan(tick.psi) for tick in one.recorded.ticks if tick.distance < 0.85)


def test_a_ball_that_may_not_fly_is_the_rolling_one_to_the_last_bit(tmp_path: Path) -> None:
    """The plan of a throw that does not tell its filter: pictures off the track are none, as before."""
    import msgspec

    from hoopd.core.estimator import DelayedEkf

    one = thrown(tmp_path, 0.0)
    header = one.recorded.header
    texts = Texts(header.config, header.model, header.controller, header.law)
    config = recorded_config("run.mcap", header.config)
    hybrid, plain = build_tick(config, texts), build_tick(config, texts)
    rolling: Any = plain.succession.acting.filter.estimator
    replaced = DelayedEkf(rolling._step, rolling.settings)
    rolling.update = replaced.update
    for told in one.recorded.inputs[:300]:
        inputs = told._replace(commands=tuple(c for c in told.commands if c.name != "experiment"))
        a, b = hybrid.step(inputs).record, plain.step(inputs).record
        assert msgspec.json.encode(a) == msgspec.json.encode(b)
