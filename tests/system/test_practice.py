"""Practice throws: the restitution that they show, and the throw that is planned with it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from hoopd.commands import maneuver
from hoopd.commands.maneuver import planned_with, run
from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.daemon.maneuver import recorded_throws
from hoopd.files.model import EffectEntry, ModelFile, Parameter
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.effects.lift_off import LIFT_OFF
from hoopd.plants.hoop.maneuver.restitution import identify_restitution
from hoopd.plants.model_file import effects_of, load_model
from hoopd.recording.mcap import read_run

MODEL = defaults_folder() / "models" / "hoop.yaml"


def asked(folder: Path, restitution: float, **changes: object) -> ManeuverOptions:
    hidden = f"sim.effects=[{{name: ball.lift_off, parameters: {{restitution: {restitution}, grip: 0.3}}}}]"
    told = {"practice": 1, "sim": True, "sets": (hidden, "log.level=error"), "speed": "max", "camera": "direct"}
    return ManeuverOptions(**{"kind": "throw", "out": folder / "run.mcap", **told, **changes})  # type: ignore[arg-type]


@pytest.mark.proof
def test_the_restitution_is_found_and_the_throw_is_planned_with_it(tmp_path: Path) -> None:
    result = run(asked(tmp_path, 0.3))
    practice = result["practice"]
    assert practice["restitution"] == pytest.approx(0.3, abs=0.03) and practice["pictures"] >= 4
    low, high = practice["ci95"]
    assert low - 0.005 <= 0.3 <= high + 0.005 and high - low < 0.15
    assert result["succeeded"] == 1 and result["exit"] == 0
    # from one and the same recording another answer where the pictures are others
    throws = recorded_throws(read_run(tmp_path / "run_practice.mcap"))
    (one,) = throws
    model = effects_of(load_model(MODEL))
    strange = one._replace(distance=one.distance - 0.1 * np.sin(40.0 * one.t))
    both, alone = (identify_restitution(model, told) for told in ([one, strange], [one]))
    assert both == alone and alone.throws == 1
    on_track = one._replace(distance=np.where((one.t > one.start_t + 0.2) & (one.distance > 0.93), 1.0, one.distance))
    assert identify_restitution(model, [on_track]).value < 0.1


def test_a_throw_that_nothing_explains_is_left_out_and_a_wide_interval_has_its_mean(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from hoopd.plants.hoop.maneuver import restitution as own

    flat = 4e-5 + 1e-2 * np.maximum(own.TRIED - 0.3, 0.0)  # up to 0.3 all is alike
    strange = 2e-3 - 1e-3 * (own.TRIED == 0.6)
    courses = {0.0: flat, 1.0: strange}

    class Simulated:
        def __init__(self, found: object) -> None: ...

        def fit(self, throw: own.RecordedThrow, e: float) -> own._Fit:
            return own._Fit(float(courses[throw.start_t][np.abs(own.TRIED - e).argmin()]), 20, 6)

    monkeypatch.setattr(own, "_Throws", Simulated)
    throws = [own.RecordedThrow(np.zeros(4), t, 0.02, np.zeros(5), *np.zeros((3, 0))) for t in (0.0, 1.0)]
    found = identify_restitution(effects_of(load_model(MODEL)), throws)
    assert (found.low, found.throws, found.pictures) == (0.0, 1, 6)
    assert 0.12 < found.value < 0.18 and 0.3 <= found.high < 0.35


def test_a_ball_that_bounces_is_given_the_time() -> None:
    options = TrajectoryOptions(kind="throw", model=MODEL, flight_s=0.2)
    model = load_model(MODEL)
    dead, lively = (planned_with(model, options, e).plan.flight for e in (0.0, 0.4))
    assert dead is not None and lively is not None and 2 <= lively.ticks - dead.ticks <= 8


def test_what_the_model_knows_of_its_landing_stays_in_the_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    own = EffectEntry(LIFT_OFF, {"restitution": Parameter(0.4, "-"), "grip": Parameter(0.3, "-")})
    model, seen = msgspec.structs.replace(load_model(MODEL), effects=[own]), list[dict[str, float]]()

    def plan_on(model: ModelFile, options: TrajectoryOptions) -> None:
        seen.append({name: one.value for name, one in model.effects[0].parameters.items()})
        raise InputError("planned", "", "on it")

    monkeypatch.setattr(maneuver, "plan_on", plan_on)
    with pytest.raises(InputError, match="on it"):
        planned_with(model, TrajectoryOptions(kind="throw", model=MODEL), 0.25)
    assert seen == [{"restitution": 0.25, "grip": 0.3}]


def test_practice_is_for_throws_that_are_planned_anew(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="goes with throw"):
        run(asked(tmp_path, 0.0, kind="loop"))
    with pytest.raises(InputError, match="without --trajectory"):
        run(asked(tmp_path, 0.0, trajectory=tmp_path / "throw.yaml"))


def test_without_a_picture_after_the_touch_nothing_is_said() -> None:
    from hoopd.plants.hoop.maneuver.restitution import RecordedThrow

    empty = RecordedThrow(np.array([0.0, 10.0, 2.4, 9.0]), 0.0, 0.02, np.zeros(5), *np.zeros((3, 0)))
    with pytest.raises(ValueError, match="no picture"):
        identify_restitution(effects_of(load_model(MODEL)), [empty])
