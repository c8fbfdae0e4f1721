"""From a recording to an identified model to a law that the daemon runs: the commands of docs/guides/identify.md, run.

The rig's truth is config/models/hoop.yaml; no law of this file has seen it, only what came over board and camera.
"""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest
from harness.rigrun import run_rig
from inprocess import call

from hoopd.files.identified import identified_text, load_identified, parse_identified

ROOT = Path(__file__).resolve().parents[2]
RECORD = "hoopd experiment prbs --sim --speed max --camera direct --out rec.mcap"
METHODS = {"arx": (), "subspace": ("--order", "6")}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording, two identified models and a law on each."""
    place = tmp_path_factory.mktemp("identify")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        done(*RECORD.split()[1:])
        for method, more in METHODS.items():
            done("identify", "rec.mcap", "--method", method, *more, "--out", f"{method}.yaml", "--figure",
                 f"{method}.png", "--json", f"{method}.json")  # fmt: skip
            done("design", "identified", "--identified", f"{method}.yaml", "--model", "models/hoop.yaml", "--out",
                 f"law_{method}.yaml")  # fmt: skip
        done("convert", "rec.mcap", "rec.csv")
        done("convert", "rec.mcap", "slow.csv", "--step", "0.04")
    spoiled(place, "still.csv", "dtheta", "1.0", range(600, 2000))
    spoiled(place, "unseen.csv", "psi", "", range(600, 2000))
    spoiled(place, "torn.csv", "u", "", range(0, 2000, 40))
    spoiled(place, "cut.csv", "u", "", range(300, 320))
    return place


def spoiled(place: Path, name: str, column: str, value: str, rows: range) -> None:
    """rec.csv with other values in some rows."""
    with (place / "rec.csv").open(newline="") as file:
        head, *lines = csv.reader(file)
    for i in rows:
        if i < len(lines):
            lines[i][head.index(column)] = value
    with (place / name).open("w", newline="") as file:
        csv.writer(file).writerows([head, *lines])


def done(*words: str) -> None:
    code, _, errors = call(words)
    assert code == 0, (words, errors)


@pytest.mark.parametrize("method", METHODS)
def test_the_model_foresees_what_it_was_not_fitted_to(folder: Path, method: str) -> None:
    told = json.loads((folder / f"{method}.json").read_text())
    assert told["held_out"] == "the last third of every recording"
    one, ten = told["fit_percent"]["1"], told["fit_percent"]["10"]
    assert min(one.values()) > 98.0 and ten["dtheta"] > 98.0 and ten["psi"] > 92.0
    assert (folder / f"{method}.png").stat().st_size > 10_000
    for ending in ("residuals", "bode", "roots"):
        assert (folder / f"{method}_{ending}.png").stat().st_size > 10_000


def test_torque_that_is_not_known_cuts_the_record_and_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    done("identify", "cut.csv", "--out", "cut.yaml", "--json", "cut.json")
    (said,) = [one for one in json.loads((folder / "cut.json").read_text())["warnings"] if "torque of" in one]
    assert (
        "the torque of 20 rows" in said and "in 2 parts" in said and said in load_identified(folder / "cut.yaml").notes
    )


@pytest.mark.parametrize("method", METHODS)
def test_the_daemon_holds_the_ball_with_a_law_on_it(folder: Path, tmp_path: Path, method: str) -> None:
    run = run_rig(tmp_path, f"control.file={folder / f'law_{method}.yaml'}", "sim.psi_rad=0.4", duration_s=8.0)
    assert run.settled_s(run.psi, 0.05) <= 1.5 and run.settled_s(run.dtheta, 1.0) <= 5.0
    assert run.torque.max_abs() <= 0.7 * (1 + 1e-6)


def test_the_page_shows_these_commands() -> None:
    page = (ROOT / "docs" / "guides" / "identify.md").read_text(encoding="utf-8")
    block = re.search(r"```\n(hoopd experiment.*?)```", page, re.DOTALL)
    assert block is not None
    shown = [line.split("#")[0].strip() for line in block[1].splitlines()]
    assert shown[0] == RECORD
    assert shown[1:3] == [
        "hoopd identify rec.mcap --method subspace --out model.yaml --figure model.png",
        "hoopd design identified --identified model.yaml --model models/hoop.yaml --out law.yaml",
    ]


def test_a_file_is_what_was_written(folder: Path) -> None:
    file = load_identified(folder / "arx.yaml")
    assert parse_identified(identified_text(file), "again") == file
    assert file.outputs == ["dtheta", "psi"] and file.recordings == ["rec.mcap"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("identify", "rec.mcap", "--method", "magic"), "--method"),
        (("identify", "rec.mcap", "--orders", "4"), "--orders"),
        (("identify", "rec.mcap", "--orders", "a,b"), "--orders"),
        (("identify", "rec.mcap", "--outputs", "psi,psi"), "--outputs"),
        (("identify", "rec.mcap", "--out", "rec.mcap"), "rec.mcap"),
        (("identify", "none.mcap",), "none.mcap"),
        (("identify", "rec.mcap", "--delay", "-1"), "--delay"),
        (("identify", "rec.mcap", "--delay", "nan"), "--delay"),
        (("identify", "rec.mcap", "--delay", "5"), "--delay"),
        (("identify", "rec.mcap", "--holdout", "slow.csv"), "0.04 s apart"),
        (("identify", "rec.mcap", "--holdout", "rec.mcap@3:3.2"), "50 at least"),
        (("identify", "still.csv", "--out", "never.yaml"), "dtheta: is constant"),
        (("identify", "unseen.csv", "--out", "never.yaml"), "psi: 0 readings"),
        (("identify", "torn.csv"), "50 rows follow each other"),
        (("identify", "rec.mcap@0:2",), "--holdout"),
        (("identify", "rec.mcap@0:0.5", "--holdout", "rec.mcap@0:0.5"), "rec.mcap"),
        (("design", "identified", "--model", "models/hoop.yaml"), "--identified"),
        (("design", "lqg", "--identified", "arx.yaml", "--model", "models/hoop.yaml"), "--identified"),
        (("design", "identified", "--identified", "rec.yaml", "--model", "models/hoop.yaml"), "rec.yaml"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(folder)
    code, _, errors = call(words)
    assert code == 2 and said in errors and len(errors.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (("sample_time_s: 0.02", "sample_time_s: -1"), "sample_time_s"),
        (("outputs:\n- dtheta\n- psi", "outputs:\n- psi\n- psi"), "outputs"),
        (("k:\n", "k:\n- [1.0]\n"), "k"),
        (("schema: hoopd.identified/1", "schema: hoopd.model/1"), "schema"),
    ],
)
def test_a_spoiled_file_is_one_line(folder: Path, tmp_path: Path, change: tuple[str, str], key: str) -> None:
    text = (folder / "arx.yaml").read_text()
    assert change[0] in text
    (tmp_path / "bad.yaml").write_text(text.replace(*change))
    code, _, errors = call(
        ("design", "identified", "--identified", str(tmp_path / "bad.yaml"), "--model", "models/hoop.yaml")
    )
    assert code == 2 and key in errors and len(errors.strip().splitlines()) == 1
