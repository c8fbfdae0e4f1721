"""Experiments through the whole daemon in lock-step: what is recorded, and what a plan does by default."""

from __future__ import annotations

import contextlib
import io
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from inprocess import call
from samples import sampled
from system.experiments import LOCKSTEP, ROOT, ends_at_rest, perform

from hoopd.commands.options.experiment import ExperimentOptions
from hoopd.daemon import experiment
from hoopd.daemon.app import Options
from hoopd.daemon.recording_target import Where
from hoopd.daemon.replay import replay
from hoopd.files.reading import InputError, parse_yaml
from hoopd.plants.hoop.loop.experiment_plan import AMPLITUDES_NM, DURATION_S, DURATIONS_S, Plan
from hoopd.recording.mcap import read_run

SHORT: dict[str, Plan] = {
    "prbs": Plan("prbs", 6.0),
    "prbs, slow clock": Plan("prbs", 6.0, 0.03, clock_ticks=5),
    "chirp": Plan("chirp", 6.0),
    "multisine": Plan("multisine", 6.0),
    "steps": Plan("steps", 6.0),
    "decay": Plan("decay", 6.0, rest_s=2.0),
    "centring": Plan("prbs", 6.0, centring_nm_per_rad_s=0.002),
    "around a holding law": Plan("prbs", 6.0, around=Path("controllers/lqg.yaml")),
    "around an identified law": Plan("multisine", 6.0, 0.03, around=Path("controllers/arx.yaml")),
    "no ball": Plan("prbs", 6.0, ball=False),
}


@pytest.mark.parametrize("name", sampled(SHORT, ["prbs, slow clock", "decay", "around an identified law", "no ball"]))
def test_what_is_recorded_is_the_signal_and_replays_to_the_bit(name: str, tmp_path: Path) -> None:
    plan = SHORT[name]
    found = perform(tmp_path, plan)
    assert found.result["outcome"] == "done" and found.result["exit"] == 0 and found.result["faults"] == {}
    assert len(found.played) == 300 and ends_at_rest(found)
    assert replay(found.path)["equal"]
    file = parse_yaml(found.run.header.controller, "header")
    gains = file["gains"]
    assert file["limits"]["torque_nm"] == gains["torque_nm"] == plan.torque_limit_nm  # the law's own, and the limiter's
    u, table = np.array([row.u for row in found.played]), np.array(gains["table_nm"])
    if plan.around is None and not plan.centring_nm_per_rad_s:
        body = slice(50, -25)  # between the soft start and the soft end the torque is the table's
        assert np.array_equal(u[body], table[body])
    assert np.abs(u).max() <= plan.torque_limit_nm and np.abs(u[0]) < 0.2 * np.abs(u).max()
    assert not list(tmp_path.glob(".run.mcap.*"))


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    plans = [Plan("prbs", 2.0, seed=seed) for seed in (3, 3, 4)]
    files = []
    for index, plan in enumerate(plans):
        path = tmp_path / f"{index}.mcap"
        options = Options(sim=True, sets=("log.level=error",), seed=plan.seed, speed="max", direct=True)
        with contextlib.redirect_stderr(io.StringIO()):
            experiment.run(plan, options, Where(file=path))
        files.append(path.read_bytes())
    assert files[0] == files[1] and files[2] != files[0]


def test_without_a_ball_the_hoop_is_alone(tmp_path: Path) -> None:
    """u -> dtheta of the recording is the hoop's own inertia and friction, and the angle is missing."""
    found = perform(tmp_path, Plan("prbs", 10.0, ball=False))
    rows = found.played
    assert all(np.isnan(row.psi) for row in found.run.ticks)
    u, speed = np.array([row.u for row in rows]), np.array([row.dtheta for row in rows])
    # the board samples when it takes a new torque: dtheta[k + 2] - dtheta[k + 1] is what u[k] did
    design = np.stack([u[:-2], speed[1:-1]], axis=1)
    gain, loss = np.linalg.lstsq(design, np.diff(speed)[1:], rcond=None)[0]
    assert gain / 0.02 == pytest.approx(1.0 / 1.518e-3, rel=0.03)
    assert -0.8 < loss / 0.02 < -0.1  # bh / Ih = 0.46 per second


# ------------------------------------------------------------------------------------------------ defaults


@pytest.mark.parametrize("kind", sampled(experiment.KINDS, ["prbs", "decay"]))
def test_defaults_move_the_ball_and_stay_inside(kind: str, tmp_path: Path) -> None:
    """A seed of its own for each kind; tools/bench/experiments.py does twenty."""
    seed = list(experiment.KINDS).index(kind)
    stays_inside(tmp_path, kind, seed)


@pytest.mark.proof
@pytest.mark.parametrize("kind", experiment.KINDS)
def test_defaults_stay_inside_for_three_seeds(kind: str, tmp_path: Path) -> None:
    for seed in range(3):
        (tmp_path / str(seed)).mkdir()
        stays_inside(tmp_path / str(seed), kind, seed)


def stays_inside(folder: Path, kind: str, seed: int) -> None:
    result = perform(folder, Plan(kind, DURATIONS_S.get(kind, DURATION_S), seed=seed), seed=seed).result
    assert result["outcome"] == "done" and result["faults"] == {}
    assert 0.5 < result["largest_ball_angle_rad"] < 1.15 and result["largest_hoop_speed_rad_s"] < 40.0
    assert result["amplitude_nm"] in AMPLITUDES_NM
    assert result["largest_ball_angle_rad"] == pytest.approx(result["foreseen_ball_angle_rad"], abs=0.1)


def test_the_command_line_has_the_same_defaults() -> None:
    given = {one.name: one.default for one in fields(ExperimentOptions)}
    planned = {name: value for name, value in Plan._field_defaults.items() if name not in ("duration_s", "ball")}
    untold = {name for name in planned if given[name] is None}
    assert {name: given[name] for name in planned if name not in untold} == {
        name: value for name, value in planned.items() if name not in untold
    }
    texts = {one.name: one.metadata["help"] for one in fields(ExperimentOptions)}
    for name in untold - {"amplitude_nm", "around", "model"}:
        assert f"; {planned[name]:g}, with --plant" in texts[name]
    assert Plan._field_defaults["duration_s"] == DURATION_S


def test_an_amplitude_too_large_for_the_model_is_told(tmp_path: Path) -> None:
    result = perform(tmp_path, Plan("prbs", 10.0, 0.1, clock_ticks=6)).result
    assert any(note.startswith("little room") for note in result["notes"])


def test_another_model_foresees_and_says_how_large_a_signal_may_be(tmp_path: Path) -> None:
    """A ball with hardly any friction swings farther, and so does what is driven at its own frequency."""
    text = (ROOT / "config/models/hoop.yaml").read_text()
    (tmp_path / "free.yaml").write_text(re.sub(r"(bb: .*?value: )[-\d.e]+", r"\g<1>1.0e-7", text))
    plan = Plan("multisine", 4.0, low_hz=1.0, high_hz=2.0)
    plans = {"usual": plan, "other": plan._replace(model=tmp_path / "free.yaml"), "small": plan._replace(use_share=0.3)}
    for name in plans:
        (tmp_path / name).mkdir()
    usual, other, small = (perform(tmp_path / name, one).result for name, one in plans.items())
    assert other["foreseen_ball_angle_rad"] / other["amplitude_nm"] > (
        1.1 * usual["foreseen_ball_angle_rad"] / usual["amplitude_nm"]
    )
    assert small["amplitude_nm"] < usual["amplitude_nm"]
    assert small["foreseen_ball_angle_rad"] <= 0.3 * plan.angle_limit_rad
    assert small["foreseen_hoop_speed_rad_s"] <= 0.3 * plan.speed_limit_rad_s


def test_where_every_signal_would_end_early_the_weakest_is_played(tmp_path: Path) -> None:
    result = perform(tmp_path, Plan("prbs", 4.0, speed_limit_rad_s=0.5)).result
    assert result["amplitude_nm"] == min(AMPLITUDES_NM)
    assert any("it would end early" in note for note in result["notes"])


def test_a_law_that_swings_for_late_pictures_is_foreseen_to(tmp_path: Path) -> None:
    """The thesis's PID: calm with fresh pictures, a limit cycle with those of the device."""
    found = perform(tmp_path, Plan("prbs", 4.0, 0.03, around=Path("controllers/pid.yaml"))).result
    foreseen, seen = found["foreseen_ball_angle_rad"], found["largest_ball_angle_rad"]
    assert seen > 0.3 and 0.5 < foreseen / seen < 2.0


def test_a_figure_of_what_was_recorded(tmp_path: Path) -> None:
    perform(tmp_path, Plan("prbs", 2.0), figure=tmp_path / "run.png")
    assert (tmp_path / "run.png").read_bytes()[:4] == b"\x89PNG"


def test_a_figure_that_cannot_be_written_is_a_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise InputError(tmp_path / "run.png", "--figure", "no space left on device")

    monkeypatch.setattr("hoopd.plots.style.save", full)
    result = perform(tmp_path, Plan("prbs", 2.0), figure=tmp_path / "run.png").result
    assert result["exit"] == 0 and any("no space left" in note for note in result["notes"])


def test_a_holding_law_brings_its_model(tmp_path: Path) -> None:
    """The filter believes the model that the holding law was designed on, and a recording repeats that."""
    shipped = (ROOT / "config/controllers/lqg.yaml").read_text()
    (tmp_path / "mine.yaml").write_text(shipped.replace("models/hoop.yaml", "models/thesis.yaml"))
    found = perform(tmp_path, Plan("prbs", 2.0, 0.03, around=tmp_path / "mine.yaml"))
    assert found.result["next"].endswith(" --method prediction --out model.yaml")
    assert found.run.header.model == (ROOT / "config/models/thesis.yaml").read_text() and replay(found.path)["equal"]


def test_a_kick_by_hand_without_any_torque(tmp_path: Path) -> None:
    found = perform(tmp_path, Plan("decay", 6.0, 0.0, rest_s=2.0), "sim.psi_rad=0.6", "sim.held=false")
    assert found.result["outcome"] == "done" and found.result["largest_torque_nm"] == 0.0
    assert found.result["crest_factor"] is None and found.result["coverage_hz"] == [None, None]
    assert found.torque.max_abs(stop=found.result["ended_at_s"]) == 0.0


def test_the_page_shows_a_file_that_the_daemon_plays(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "guides" / "experiment.md").read_text()
    (tmp_path / "my.yaml").write_text(page.split("```yaml\n", 1)[1].split("```", 1)[0])
    sets = ("--set", f"control.file={tmp_path / 'my.yaml'}", "--set", "sim.psi_rad=0")
    code, _, errors = call((*LOCKSTEP[:-1], "3", "--record", str(tmp_path), *sets))
    assert code == 0, errors
    played = [row.u for row in read_run(tmp_path / "run-0001.mcap").ticks if row.mode == "RUNNING"]
    assert played == [0.05, 0.05, -0.05, -0.05]
