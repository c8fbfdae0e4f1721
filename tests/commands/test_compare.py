"""`hoopd compare` on the rig: who is better is told, who is bad goes back, and the recording replays to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml
from inprocess import call

from hoopd.daemon.replay import replay
from hoopd.files.shipped import defaults_folder
from hoopd.recording.mcap import read_run

LQG = defaults_folder() / "controllers" / "lqg.yaml"


def changed(folder: Path, name: str, **gains: float) -> Path:
    content = yaml.safe_load(LQG.read_text())
    content["gains"] |= gains
    (folder / name).write_text(yaml.safe_dump(content))
    return folder / name


def compared(folder: Path, candidate: Path, *words: str, blocks: int = 8) -> tuple[int, dict[str, Any]]:
    told = folder / "told.json"
    (folder / "rec").mkdir()
    line = ["compare", str(LQG), str(candidate), "--sim", "--camera", "direct", "--blocks", str(blocks), *words]
    code, _, errors = call([*line, "--record", str(folder / "rec"), "--json", str(told), "--set", "log.level=error"])
    assert told.exists(), errors
    return code, msgspec.json.decode(told.read_bytes())


def test_a_weaker_law_is_called_worse_and_the_run_replays(tmp_path: Path) -> None:
    weak, figure = changed(tmp_path, "weak.yaml", k_psi=0.09, k_dpsi=0.03), tmp_path / "a.svg"
    code, told = compared(tmp_path, weak, "--figure", str(figure), blocks=10)
    assert (code, told["verdict"]) == (0, "worse"), told["reason"]
    low, high = told["ball_rms_rad"]["interval_percent"]
    assert 3.0 < low < high < 15.0
    assert told["faults"] == {} and figure.read_text().startswith("<?xml")
    (recording,) = told["recording"]
    assert replay(Path(recording))["equal"]
    run = read_run(Path(recording))
    names = [one.name for row in run.inputs for one in row.commands]
    assert names.count("trial") == names.count("revert") == len(told["pairs"])


def test_the_same_law_is_not_told_from_itself(tmp_path: Path) -> None:
    code, told = compared(tmp_path, changed(tmp_path, "same.yaml"), blocks=6)
    assert (code, told["verdict"]) == (0, "not told apart") and len(told["pairs"]) == 3


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(20))
def test_the_same_law_is_not_told_from_itself_with_any_of_20_seeds(seed: int, tmp_path: Path) -> None:
    """More than four of twenty would come to pass once in four hundred such tests, were it five percent of them."""
    _, told = compared(tmp_path, changed(tmp_path, "same.yaml"), "--seed", str(seed), blocks=20)
    assert told["verdict"] == "not told apart" or abs(told["ball_rms_rad"]["change_percent"]) < 0.5


def test_a_law_that_loses_the_ball_goes_back_in_the_tick_and_the_answer_is_no(tmp_path: Path) -> None:
    code, told = compared(tmp_path, changed(tmp_path, "bad.yaml", k_psi=-0.05, k_dpsi=-0.02))
    assert (code, told["verdict"]) == (1, "went back") and "cost" in told["reason"]
    run = read_run(Path(told["recording"][0]))
    running = [tick for tick in run.ticks if tick.mode == "RUNNING"]
    assert max(abs(tick.x_hat[2]) for tick in running) < 0.6
    assert abs(running[-1].t - max(event.t for event in run.events if event.event == "trial_returned")) < 0.1


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--blocks", "7"], "blocks must be an even number"),
        (["--amplitude", "0.7"], "amplitude_rad must be from 0 to 0.5"),
        (["--figure", "a.bmp"], "unknown extension"),
        (["--json", "/nowhere/a.json"], "no such"),
    ],
)
def test_what_cannot_be_compared_is_one_line(words: list[str], says: str) -> None:
    code, _, errors = call(["compare", str(LQG), str(LQG), "--sim", *words])
    assert code == 2 and says in errors and len(errors.splitlines()) == 1


def test_without_a_daemon_there_is_nothing_to_compare_in(tmp_path: Path) -> None:
    socket = f"commands.socket={tmp_path / 'none.sock'}"
    line = ["compare", str(LQG), str(LQG), "--set", socket, "--set", "telemetry.endpoint=tcp/127.0.0.1:1"]
    code, _, errors = call(line)
    assert code == 2 and len(errors.splitlines()) == 1
