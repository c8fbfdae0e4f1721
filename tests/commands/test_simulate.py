"""`hoopd simulate`: the record, the files it writes, and one line for whatever cannot be used."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import shared_path

from hoopd.commands import cli, simulate
from hoopd.plants.hoop.fitting.solver_comparison import two_level_torque
from hoopd.plants.hoop.simulate import HoopModel
from hoopd.plants.model_file import load_model, plant_of
from hoopd.recording import load, load_all, save
from hoopd.recording.recording import Recording, from_columns
from hoopd.recording.slices import Span, read_recording, split_slice

MODELS = Path(__file__).resolve().parents[2] / "config" / "models"
DEVICE = MODELS / "hoop.yaml"
EFFECT = "effects: [{name: hoop.coulomb_friction, parameters: {Fc: {value: 0.01, unit: N m}}}]"


def command(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """Exit code of `hoopd simulate ARGUMENTS`."""
    monkeypatch.setattr(sys, "argv", ["hoopd", "simulate", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def recorded(rows: int = 300) -> Recording:
    """The device as the model has it, from psi 0.4."""
    plant, x, u = plant_of(load_model(DEVICE)), np.array([0.0, 0.0, 0.4, 0.0]), two_level_torque(rows, 2)
    states = []
    for k in range(rows):
        states.append(x)
        x = plant.advance(x, u[k], 0.02)
    theta, dtheta, psi, _ = np.array(states).T
    return from_columns({"t": 0.02 * np.arange(rows), "u": u, "theta": theta, "dtheta": dtheta, "psi": psi}, "made.csv")


@pytest.fixture
def made(tmp_path: Path) -> Path:
    path = tmp_path / "made.csv"
    save(recorded(), path)
    return path


def result_of(monkeypatch: pytest.MonkeyPatch, folder: Path, *arguments: object) -> dict[str, Any]:
    """JSON of a run that ends well."""
    path = folder / "result.json"
    assert command(monkeypatch, *arguments, "--json", path) == 0
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def test_the_record_and_every_file(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, figure = tmp_path / "out.csv", tmp_path / "run.png"
    found = result_of(monkeypatch, tmp_path, "--model", DEVICE, "--input", made, "--out", out, "--figure", figure)
    np.testing.assert_allclose(load(out).psi, recorded().psi, atol=1e-4)
    assert figure.stat().st_size > 10_000
    assert found["start_from"] == "estimated" and found["moving"] == "both" and found["rows"] == 300
    assert found["start"]["psi"] == pytest.approx(0.4, abs=1e-5)
    for part in ("free_run", "windows_2s"):
        assert {name: round(one["nrmse_percent"]) for name, one in found[part].items()} == {
            "theta_rate": 100,
            "dtheta": 100,
            "psi": 100,
        }
    assert "free_run" in capsys.readouterr().out


@pytest.mark.parametrize("extension", [".mcap", ".mat", ".h5"])
def test_every_format_is_written(extension: str, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / f"out{extension}"
    assert command(monkeypatch, "--model", DEVICE, "--input", f"{made}@0:1", "--x0", "psi=0.4", "--out", out) == 0
    np.testing.assert_allclose(load(out).psi, recorded().psi[:51], atol=1e-4)


def test_same_input_same_bytes(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = []
    for name in ("a", "b"):
        out, figure = tmp_path / f"{name}.csv", tmp_path / f"{name}.svg"
        assert command(monkeypatch, "--model", DEVICE, "--input", made, "--out", out, "--figure", figure) == 0
        kept.append((out.read_bytes(), figure.read_bytes()))
    assert kept[0] == kept[1]


def test_ages_of_samples(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording that was exact is worse when its samples are taken for older ones."""
    exact, aged = (
        result_of(monkeypatch, tmp_path, "--model", DEVICE, "--input", made, *more)
        for more in ((), ("--age", "psi=0.03"))
    )
    assert aged["age_s"] == {"psi": 0.03} and "age_s" not in exact
    assert aged["free_run"]["psi"]["nrmse_percent"] < exact["free_run"]["psi"]["nrmse_percent"] - 5.0


def test_a_given_start_and_a_slice(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = result_of(monkeypatch, tmp_path, "--model", DEVICE, "--input", f"{made}@1:3", "--x0", "psi=0.1, dtheta=-2")
    assert found["start_from"] == "given" and found["rows"] == 101
    assert found["start"]["psi"] == 0.1 and found["start"]["dtheta"] == -2.0 and found["start"]["dpsi"] == 0.0
    assert found["free_run"]["psi"]["nrmse_percent"] < 50.0


def test_torque_alone_runs_both_from_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "torque.csv"
    path.write_text("t,u\n" + "".join(f"{0.02 * k:.2f},{0.1 * (k < 25)}\n" for k in range(50)))
    figure, out = tmp_path / "torque.pdf", tmp_path / "out.csv"
    found = result_of(monkeypatch, tmp_path, "--model", DEVICE, "--input", path, "--figure", figure, "--out", out)
    assert found["start_from"] == "rest" and found["moving"] == "both" and found["free_run"] == {}
    assert any("nothing to compare" in note for note in found["notes"])
    dtheta = load(out).dtheta
    assert 20.0 < dtheta[25] < 0.1 * 0.5 / 1.5e-3, "torque by time over the hoop's inertia, less what the ball takes"
    assert abs(dtheta[49]) < dtheta[25]


def test_a_model_with_effects_plays_them(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model, out = tmp_path / "model.yaml", tmp_path / "with.csv"
    model.write_text(DEVICE.read_text().replace("effects: []", EFFECT))
    assert EFFECT in model.read_text()
    start = ("--x0", "psi=0,dpsi=0,dtheta=0,theta=0")
    result_of(monkeypatch, tmp_path, "--model", model, "--input", made, *start, "--out", out)
    fits = {}
    for label, more in (("with", ()), ("without", ("--without-effects",))):
        found = result_of(monkeypatch, tmp_path, "--model", model, "--input", out, *start, *more)
        fits[label] = found["free_run"]["theta_rate"]["nrmse_percent"]
        assert any("hoop.coulomb_friction" in note for note in found["notes"]) == (label == "without")
    assert fits["with"] > 99.9 > fits["without"] + 1.0


def test_the_zero_of_the_recording_is_fitted_and_told(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wave = "effects: [{name: hoop.imbalance, parameters: {A: {value: 0.01, unit: N m}, phi: {value: 0.3, unit: rad}}}]"
    model, out = tmp_path / "model.yaml", tmp_path / "with.csv"
    model.write_text(DEVICE.read_text().replace("effects: []", wave))
    start = ("--x0", "psi=0,dpsi=0,dtheta=0,theta=0")
    assert "zero" not in result_of(monkeypatch, tmp_path, "--model", model, "--input", made, *start, "--out", out)
    model.write_text(model.read_text().replace("0.3", "1.5"))  # found where the encoder was switched on elsewhere
    found = result_of(monkeypatch, tmp_path, "--model", model, "--input", out)
    assert found["zero"]["theta"] == pytest.approx(0.3 - 1.5, abs=0.02)
    assert any("theta counts from another place" in note and "hoop.imbalance" in note for note in found["notes"])
    assert found["free_run"]["theta_rate"]["nrmse_percent"] > 99.0


def test_what_is_doubtful_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "slow.csv"
    whole = recorded()
    save(replace(whole, dtheta=0.5 * whole.dtheta), path)
    found = result_of(monkeypatch, tmp_path, "--model", DEVICE, "--input", path)
    assert any("dtheta" in note for note in found["notes"])


def test_rows_with_the_drive_off_are_said() -> None:
    """The rig holds the ball until it is armed: those rows are no free run."""
    modes = ["DISARMED"] * 60 + ["RUNNING"] * 240
    off = replace(recorded(), source="run.mcap", extra={"mode": np.array(modes)})
    assert simulate.off_words(off) == ["run.mcap: 60 rows were taken with the drive off and do not count"]
    assert simulate.off_words(recorded()) == []


def test_a_ball_on_the_inner_hoop_is_no_free_run_of_one_that_rolls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A third of the rows says where no outer hoop carries it: what stands there changes nothing."""
    modes, psi = np.array([""] * 300, dtype="<U7"), recorded().psi.copy()
    modes[100:200], psi[100:200] = "inner", np.pi
    whole = replace(recorded(), psi=psi, source="up.mcap", extra={"ball_mode": modes})
    told = simulate.off_words(whole)
    assert told == [
        "up.mcap: 108 rows were taken with the ball off the outer hoop (in the air, on the inner hoop, just back) and"
        " do not count"
    ]
    monkeypatch.setattr(simulate, "read_recording", lambda *_, **__: whole)
    found = result_of(monkeypatch, tmp_path, "--model", DEVICE, "--input", tmp_path / "up.mcap")
    assert found["stretches"] == 2 and found["free_run"]["psi"]["nrmse_percent"] > 99.0
    assert told[0] in found["notes"]


def test_a_pause_of_the_recording_is_two_stretches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows that are missing for longer than the model is told a torque end a run, however long they are missing."""
    whole, path = recorded(), tmp_path / "pause.csv"
    later = {name: getattr(whole, name) + 15.0 * (np.arange(300) >= 150) for name in ("t", "y_t", "psi_t")}
    save(replace(whole, **later), path)
    found = result_of(monkeypatch, tmp_path, "--model", DEVICE, "--input", path)
    assert found["stretches"] == 2
    assert found["free_run"]["psi"]["nrmse_percent"] > 99.0


def test_wrapped_angles_are_unwrapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball that goes round under a camera that says -pi to pi, on a hoop beyond the board's 512 turns."""
    turns, x0 = 1024 * 2 * np.pi, [turn_edge := 512 * 2 * np.pi - 1.0, 0.0, 0.0, 45.0]
    t, u = 0.02 * np.arange(101), 0.02 * two_level_torque(101, 3)
    file = load_model(DEVICE)
    x = HoopModel(file.structure, file.values()).run((), x0, t, u[:-1])
    assert x[:, 0].max() > turn_edge + 1.0 and x[:, 2].max() > 2 * np.pi
    theta, psi = ((a + p / 2) % p - p / 2 for a, p in ((x[:, 0], turns), (x[:, 2], 2 * np.pi)))
    path = tmp_path / "wrapped.csv"
    save(from_columns({"t": t, "u": u, "theta": theta, "dtheta": x[:, 1], "psi": psi}), path)
    found = result_of(monkeypatch, tmp_path, "--model", DEVICE, "--input", path)
    assert all(one["nrmse_percent"] > 99.0 for one in found["free_run"].values())
    assert [note.split(" (")[0] for note in found["notes"] if "wrapped" in note] == [
        "theta is wrapped",
        "psi is wrapped",
    ]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("--input", "nope.mat"), "nope.mat"),
        (("--input", "MADE@5"), "START:END"),
        (("--input", "MADE@3:1"), "ends before it begins"),
        (("--input", "MADE@nan:1"), "finite"),
        (("--input", "MADE@a:"), "expected a number"),
        (("--input", "MADE@90:99"), "no row between"),
        (("--input", "MADE@1:1.04"), "too few samples"),
        (("--input", "MADE", "--x0", "phi=1"), "unknown; known: theta, dtheta, psi, dpsi"),
        (("--input", "MADE", "--x0", "psi"), "NAME=VALUE"),
        (("--input", "MADE", "--x0", "psi=1,psi=2"), "stands twice"),
        (("--input", "MADE", "--x0", "psi=inf"), "finite"),
        (("--input", "MADE", "--x0", "psi=1", "--moving", "hoop"), "only the hoop moves"),
        (("--input", "MADE", "--x0", "dpsi=1e9"), "leaves every bound"),
        (("--input", "MADE", "--age", "phi=0.03"), "--age: phi: unknown; known: psi, y"),
        (("--input", "MADE", "--age", "psi=30"), "psi must be 0 to 1 s, not 30"),
        (("--input", "MADE", "--moving", "all"), "known: auto, both, hoop, ball"),
        (("--input", "MADE", "--step", "0"), "--step"),
        (("--input", "MADE", "--step", "nan"), "--step"),
        (("--input", "MADE", "--out", "FOLDER/run.txt"), "unknown extension"),
        (("--input", "MADE", "--out", "FOLDER/no/run.csv"), "no such folder"),
        (("--input", "MADE", "--figure", "FOLDER/run.gif"), "unknown extension"),
        (("--input", "MADE", "--json", "FOLDER/no/x.json"), "no such folder"),
    ],
)
def test_bad_input_is_one_line(
    arguments: tuple[str, ...],
    line: str,
    made: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    before = sorted(tmp_path.iterdir())
    words = [word.replace("MADE", str(made)).replace("FOLDER", str(tmp_path)) for word in arguments]
    assert command(monkeypatch, "--model", DEVICE, *words) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1 and line in said.err, said.err
    assert sorted(tmp_path.iterdir()) == before


def test_slices_of_paths(tmp_path: Path) -> None:
    assert split_slice("a.mat") == ("a.mat", None)
    assert split_slice("a@b/c.mat") == ("a@b/c.mat", None)
    assert split_slice("a.mat@2:14") == ("a.mat", Span(2.0, 14.0))
    assert split_slice("a.h5:Exp2@:1.5") == ("a.h5:Exp2", Span(None, 1.5))
    save(recorded(), tmp_path / "odd@1:2.csv")
    assert len(read_recording(str(tmp_path / "odd@1:2.csv"))) == 300, "a file of that very name goes first"


def test_an_experiment_of_an_hdf5_file(tmp_path: Path) -> None:
    path = tmp_path / "both.h5"
    save(recorded(), path)
    assert len(load_all(path)) == 1
    assert len(read_recording(f"{path}:Exp1@1:2")) == 51


def test_a_real_recording_is_cut_and_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = shared_path("recordings/meas_hoop01_prbs.mat")
    figure = tmp_path / "real.png"
    found = result_of(
        monkeypatch, tmp_path, "--model", MODELS / "thesis.yaml", "--input", f"{path}@21:", "--figure", figure
    )
    assert found["free_run"]["psi"]["set_aside"] == 90
    assert found["free_run"]["theta_rate"]["nrmse_percent"] > 74.0
    assert found["free_run"]["psi"]["nrmse_percent"] > 74.0


def test_what_remembers_begins_with_nothing_and_that_is_told(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes = "parameters: {A: {value: 0.001, unit: N m}, xs: {value: 0.3, unit: rad}}"
    model = tmp_path / "model.yaml"
    model.write_text(DEVICE.read_text().replace("effects: []", f"effects: [{{name: hoop.dahl_of_theta, {sizes}}}]"))
    arguments = ("--model", model, "--input", made, "--x0", "psi=0,dpsi=0,dtheta=0,theta=0")
    found = result_of(monkeypatch, tmp_path, *arguments)
    assert "what hoop.dahl_of_theta remembers begins with nothing in every run and window" in found["notes"]
    bare = result_of(monkeypatch, tmp_path, *arguments, "--without-effects")
    assert not any("remembers" in note for note in bare["notes"])
