"""`hoopd convert`: from file to file, whole or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from hoopd.commands import convert
from hoopd.commands.cli import app
from hoopd.commands.options.convert import ConvertOptions
from hoopd.files.reading import InputError
from hoopd.recording import load, save
from hoopd.recording.recording import from_columns
from tests.shared import shared_path


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A CSV of two seconds with a missing psi."""
    t = 0.02 * np.arange(101)
    psi = np.where(t == t[3], np.nan, np.cos(t))
    save(from_columns({"t": t, "u": 0.1 * np.sin(t), "theta": t, "dtheta": 0 * t + 1, "psi": psi}), tmp_path / "a.csv")
    return tmp_path / "a.csv"


def run(source: Path, target: Path, **asked: Any) -> dict[str, Any]:
    """What the command writes."""
    return convert.run(ConvertOptions(source=source, target=target, **asked))


def test_result(source: Path, tmp_path: Path) -> None:
    result = run(source, tmp_path / "b.mat", start=0.5, end=1.5)
    assert result["rows"] == len(load(tmp_path / "b.mat")) == 51
    assert (result["seconds"], result["step_s"]) == (pytest.approx(1.0), 0.02)
    assert result["signals"] == ["u", "theta", "dtheta", "psi"]
    assert run(source, tmp_path / "b.mat")["missing"] == {"u": 0, "theta": 0, "dtheta": 0, "psi": 1}
    assert run(source, tmp_path / "b.h5", step=0.1)["rows"] == 21


def test_refusals_leave_everything_as_it_was(source: Path, tmp_path: Path) -> None:
    (tmp_path / "link.csv").symlink_to(source)
    os.link(source, tmp_path / "hard.csv")
    (tmp_path / "b.mat").write_bytes(b"old")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for target, options, says in (
        (source, {}, "is the source itself"),
        (tmp_path / "link.csv", {}, "is the source itself"),
        (tmp_path / "hard.csv", {}, "is the source itself"),
        (tmp_path / "b.txt", {}, "unknown extension .txt"),
        (tmp_path / "b.mat", {"start": 7.0}, "no row between 7 and"),
        (tmp_path / "b.mat", {"step": 0.0}, "the step must be a positive time"),
        (tmp_path / "b.mat", {"columns": "u,theta"}, "2 names for 4 columns"),
        (tmp_path / "no" / "b.mat", {}, "no such file or directory"),
    ):
        with pytest.raises(InputError, match=says):
            run(source, target, **options)  # type: ignore[arg-type]
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_disk_that_fails_leaves_the_old_file(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "b.mat").write_bytes(b"old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="no space left on device"):
        run(source, tmp_path / "b.mat")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "b.mat"]
    assert (tmp_path / "b.mat").read_bytes() == b"old"


def test_command(source: Path, tmp_path: Path) -> None:
    target, report = tmp_path / "b.mcap", tmp_path / "r.json"
    done = CliRunner().invoke(app, ["convert", str(source), str(target), "--to", "1", "--json", str(report)])
    assert done.exit_code == 0, done.output
    assert json.loads(report.read_text())["rows"] == len(load(target)) == 51


def test_real_chirp_with_its_current(tmp_path: Path) -> None:
    path = shared_path("recordings/meas_hoop02_chirp.mat")
    assert any("motor current" in note for note in run(path, tmp_path / "a.mcap")["notes"])
    result = run(path, tmp_path / "a.mcap", columns="u,theta,dtheta,current")
    assert result["signals"] == ["u", "theta", "dtheta", "current"]
    assert not any("motor current" in note for note in result["notes"])


def test_another_plant_s_columns_by_name(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Time,Force,Position\n0,1,10\n1,2,20\n2,3,25\n")
    arguments = ["convert", str(tmp_path / "a.csv"), str(tmp_path / "b.mcap"), "--plant", "axis", "--hold", "linear"]
    done = CliRunner().invoke(app, [*arguments, "--columns", "t=Time:ms,F=Force:kN,x=Position:mm"])
    assert done.exit_code == 0, done.output
    made = load(tmp_path / "b.mcap")
    assert (made.t.tolist(), made.F.tolist()) == ([0, 0.001, 0.002], [1e3, 2e3, 3e3])
    assert made.x.tolist() == [0.01, 0.02, 0.025] and made.inputs["F"].hold == "linear"
    done = CliRunner().invoke(app, [*arguments, "--columns", "t=Time:ms,F=-Force:kN,x=-Position:mm"])
    assert load(tmp_path / "b.mcap").F.tolist() == [-1e3, -2e3, -3e3] and done.exit_code == 0
    assert run(tmp_path / "b.mcap", tmp_path / "c.h5", step=0.0005)["signals"] == ["F", "x"]
    for columns, says in (("F=Force:V,x=Position", "wrong unit 'V'"), ("theta=Force", "unknown name 'theta'")):
        assert says in _refusal(CliRunner().invoke(app, [*arguments, "--columns", columns]).exception)
    refused = CliRunner().invoke(app, [*arguments[:-3], "axle", *arguments[-2:]])
    assert "--plant: axle: neither a registered plant nor a file" in _refusal(refused.exception)


def _refusal(error: BaseException | None) -> str:
    """The line that the program ends with, and exit code 2."""
    assert isinstance(error, InputError) and "\n" not in str(error)
    return str(error)
