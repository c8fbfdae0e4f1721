"""Rubbish for the offline commands: one line on standard error, exit code 2, nothing half-written, no input lost."""

from __future__ import annotations

import contextlib
import io
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from hoopd.commands import cli
from hoopd.commands.output import write_json
from hoopd.files.reading import InputError
from hoopd.files.whole_files import replace_file

MODELS = Path(__file__).resolve().parents[2] / "config/models"
HOOP, THESIS = str(MODELS / "hoop.yaml"), str(MODELS / "thesis.yaml")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a recording of two seconds, where the commands run."""
    t = 0.02 * np.arange(100)
    rows = np.column_stack([t, 0.1 * np.sin(5 * t), np.sin(3 * t), 3 * np.cos(3 * t), 0.4 * np.cos(8 * t)])
    written(tmp_path / "a.csv", rows)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def written(path: Path, rows: np.ndarray) -> None:
    lines = (",".join(map(repr, row)) for row in rows.tolist())
    path.write_text("t,u,theta,dtheta,psi\n" + "\n".join(lines) + "\n")


def changed(name: str, old: str, new: str) -> str:
    text = Path(name).read_text()
    assert old in text
    Path("model.yaml").write_text(text.replace(old, new, 1))
    return "model.yaml"


def hoopd(*words: str) -> tuple[int, str]:
    """Exit code and standard error."""
    error = io.StringIO()
    argv, sys.argv = sys.argv, ["hoopd", *words]
    try:
        with contextlib.redirect_stderr(error), contextlib.redirect_stdout(io.StringIO()):
            cli.main()
        code = 0
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.argv = argv
    return code, error.getvalue()


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


SIMULATE = ("simulate", "--model", HOOP, "--input", "a.csv")
LINEARIZE = ("linearize", "--model", HOOP)
DESIGN = ("design", "lead", "--model", HOOP)
CASES: dict[str, tuple[tuple[str, ...], str]] = {
    "json over the recording": ((*SIMULATE, "--json", "a.csv"), "is an input"),
    "run over the recording": ((*SIMULATE, "--out", "a.csv"), "is an input"),
    "slice of the same": (("simulate", "--model", HOOP, "--input", "a.csv@0:1", "--out", "a.csv"), "is an input"),
    "fit over its holdout": (("fit", "x.csv", "--holdout", "a.csv", "--out", "a.csv"), "is an input"),
    "two results in one file": ((*SIMULATE, "--out", "b.csv", "--json", "b.csv"), "already where --out goes"),
    "json into a folder": ((*LINEARIZE, "--json", "."), "is a directory"),
    "json without a folder": ((*LINEARIZE, "--json", "no/x.json"), "no such folder"),
    "long name": ((*SIMULATE, "--figure", "a" * 300 + ".png"), "file name too long"),
    "zero byte": ((*SIMULATE, "--out", "\0.csv"), "--out"),
    "start beyond all": ((*SIMULATE, "--x0", "psi=1e300"), "psi: must be at most"),
    "angle beyond all": ((*LINEARIZE, "--psi", "1e308"), "--psi: must be at most 100"),
    "disturbance NaN": ((*DESIGN, "--disturbance", "nan"), "--disturbance: must be"),
    "disturbance inf": ((*DESIGN, "--disturbance", "inf"), "--disturbance: must be"),
    "gain of nothing": ((*DESIGN, "--gain", "0"), "--gain: must be"),
    "gain beyond all": ((*DESIGN, "--gain", "1e308"), "--gain: must be"),
    "ratio of nothing": ((*DESIGN, "--ratio", "1e-308"), "--ratio: must be"),
    "frequency of nothing": (("design", "pi", "--model", HOOP, "--omega", "1e-308"), "--omega: must be"),
    "tick of nothing": (("design", "lqg", "--model", HOOP, "--sample-time", "1e-308"), "--sample-time: must be"),
    "prior absurd": (("fit", "a.csv", "--prior", "J22=1e300:1e-300"), "fit: no finite result"),
    "fixed absurd": (("fit", "a.csv", "--fix", "L1=1e300"), "fit: no finite result"),
}


@pytest.mark.parametrize("name", CASES)
def test_refused_in_one_line(name: str, folder: Path) -> None:
    before = contents(folder)
    code, error = hoopd(*CASES[name][0])
    assert (code, error.count("\n")) == (2, 1), error
    assert CASES[name][1] in error
    assert contents(folder) == before


MODELS_REFUSED = {
    "heavy ball": (HOOP, "60.8 g", "1e308", "device.ball_mass_kg"),
    "ball as large as the hoop": (HOOP, "0.0104", "0.09569999999", "device.ball_radius_m"),
    "gravity": (HOOP, "9.81", "1e30", "device.gravity_m_s2"),
    "inertia": (HOOP, "1.518e-3", "1e300", "parameters.Ih"),
    "rolling friction": (THESIS, "-0.33509889971201284", "1e308", "parameters.J22"),
    "stiffness": (THESIS, "-73.63359905056758", "-1e308", "parameters.K2"),
}


@pytest.mark.parametrize("name", MODELS_REFUSED)
def test_impossible_model(name: str, folder: Path) -> None:
    source, old, new, key = MODELS_REFUSED[name]
    code, error = hoopd("linearize", "--model", changed(source, old, new))
    assert (code, error.count("\n")) == (2, 1), error
    assert key in error


@pytest.mark.parametrize("column", ["u", "theta", "dtheta", "psi"])
def test_number_of_no_sensor(column: str, folder: Path) -> None:
    rows = np.loadtxt("a.csv", delimiter=",", skiprows=1)
    rows[50, ["t", "u", "theta", "dtheta", "psi"].index(column)] = 1e300
    written(folder / "b.csv", rows)
    code, error = hoopd("simulate", "--model", HOOP, "--input", "b.csv")
    assert (code, error.count("\n")) == (2, 1), error
    assert f"column {column}: is no value of a sensor" in error


def test_a_device_stays_a_device_and_a_link_a_link(tmp_path: Path) -> None:
    write_json(Path("/dev/null"), {"a": 1.0})
    assert Path("/dev/null").is_char_device()
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    write_json(tmp_path / "link.json", {"a": 1.0})
    assert (tmp_path / "link.json").is_symlink()
    assert json.loads((tmp_path / "real.json").read_text()) == {"a": 1.0}


def test_a_full_disk_and_a_pipe_without_reader(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, reason in (("/dev/full", "no space left"), (tmp_path / "pipe", "no such device")):
        with pytest.raises(InputError, match=reason):
            replace_file(Path(path), b"x")


@pytest.mark.parametrize("words", [("fit", "slow.csv"), ("simulate", "--input", "slow.csv"), ("diagnose", "slow.csv")])
def test_rows_far_rarer_than_the_plant_is_fast_are_refused_before_the_work(
    words: tuple[str, ...], folder: Path
) -> None:
    t = 1e3 * np.arange(300)
    rows = [",".join(map(repr, row)) for row in np.column_stack([t, np.sin(t), np.cos(t)]).tolist()]
    Path("slow.csv").write_text("\n".join(["t,F,x", *rows]))
    code, said = hoopd(*words, "--plant", "axis")
    assert code == 2 and len(said.splitlines()) == 1
    assert "300 rows 1000 s apart of a plant that is sampled every 0.001 s" in said


def test_more_steps_than_memory_holds_are_one_line(folder: Path) -> None:
    t = 1e-3 * np.arange(300)
    rows = [",".join(map(repr, row)) for row in np.column_stack([t, np.sin(t), np.cos(t)]).tolist()]
    Path("axis.csv").write_text("\n".join(["t,F,x", *rows]))
    code, said = hoopd("simulate", "--input", "axis.csv", "--plant", "axis", "--step", "1e-9")
    assert code == 2 and "2.99e+08 steps, more than memory holds" in said and len(said.splitlines()) == 1


def test_a_folder_in_place_of_a_file_is_one_line_before_anything_is_written(folder: Path) -> None:
    angle = np.linspace(-0.9, 0.9, 300)
    rows = np.column_stack([240.0 - 182.0 * np.sin(angle), 240.0 + 182.0 * np.cos(angle)]).tolist()
    Path("run.csv").write_text("\n".join(["x_px,y_px", *(f"{x:.3f},{y:.3f}" for x, y in rows)]))
    before = contents(folder)
    for words in (("plant", "new", "."), ("calibrate", "--positions", "run.csv", "--json", ".")):
        code, said = hoopd(*words)
        assert code == 2 and len(said.splitlines()) == 1 and "mistake of this program" not in said
    assert contents(folder) == before
