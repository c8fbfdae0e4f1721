"""`hoopd identify` of any columns: data of several forms in, a model that is simulated and designed with out."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from inprocess import call
from msgspec.structs import replace
from scipy.signal import lfilter
from shared import shared_path

from hoopd.files.identified import identified_text, load_identified, parse_identified
from hoopd.files.plant_controller import load_plant_controller

N, DT = 600, 0.5
QUICK = ("--method", "oe", "--orders", "2,2")


def table() -> np.ndarray:
    """Time in minutes, a valve about 40, a level about 2 that answers to it, and a second one that does not."""
    u, e = np.random.default_rng(0).standard_normal((2, N))
    level = lfilter([0.0, 0.1, 0.05], [1.0, -1.5, 0.7], u) + 0.02 * e
    return np.column_stack([DT * np.arange(N) / 60.0, 40.0 + 5.0 * u, 2.0 + level, np.sin(0.1 * np.arange(N))])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place, rows = tmp_path_factory.mktemp("columns"), table()
    header = "Time [min],Valve [%],Level [m],Other"
    np.savetxt(place / "run.csv", rows, delimiter=",", header=header, comments="")
    np.savetxt(place / "bare.csv", rows[:, 1:], delimiter=",")
    np.savetxt(place / "bare.dat", rows[:, 1:])
    scipy.io.savemat(place / "run.mat", {"Valve": rows[:, 1], "Level": rows[:, 2], "time": rows[:, 0] * 60.0})
    with h5py.File(place / "run.h5", "w") as file:
        group = file.create_group("Exp1")
        group["Timestamps"], group["Valve"], group["Level"] = rows[:, 0] * 60.0, rows[:, 1], rows[:, 2]
    gap = np.delete(rows, range(300, 310), axis=0)
    np.savetxt(place / "gap.csv", gap, delimiter=",", header=header, comments="")
    uneven = rows + np.array([0.2, 0.0, 0.0, 0.0]) * np.random.default_rng(1).uniform(0.0, DT / 60.0, (N, 1))
    np.savetxt(place / "uneven.csv", uneven, delimiter=",", header=header, comments="")
    return place


def told(folder: Path, *words: str) -> dict[str, object]:
    code, _, errors = call(("identify", *words, "--json", str(folder / "out.json")))
    assert code == 0, (words, errors)
    found: dict[str, object] = json.loads((folder / "out.json").read_text())
    return found


@pytest.mark.parametrize(
    "words",
    [
        ("run.csv", "--input", "Valve", "--output", "Level"),
        ("bare.csv", "--input", "Valve=1:%", "--output", "Level=2:m", "--sample-time", "0.5"),
        ("bare.dat", "--input", "Valve=1:%", "--output", "Level=2:m", "--sample-time", "0.5"),
        ("run.mat", "--input", "Valve:%", "--output", "Level:m"),
        ("run.h5", "--input", "Valve:%", "--output", "Level:m", "--time", "Timestamps"),
    ],
    ids=lambda words: words[0],
)
def test_columns_of_any_file_give_the_same_model(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(folder)
    found = told(folder, *words, *QUICK, "--out", "model.yaml")
    assert found["fit_percent"]["simulation"]["Level"] > 90.0  # type: ignore[index]
    assert found["estimates"]["f1"]["value"] == pytest.approx(-1.5, abs=0.03)  # type: ignore[index]
    file = load_identified(folder / "model.yaml")
    assert file.sample_time_s == pytest.approx(DT) and file.inputs == ["Valve"] and file.outputs == ["Level"]
    assert file.units == {"Valve": "%", "Level": "m"}
    assert file.operating_point["Valve"] == pytest.approx(40.0, abs=1.0)
    assert parse_identified(identified_text(file), "again") == file


def test_the_best_structure_is_found_told_drawn_simulated_and_designed_with(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    found = told(
        folder, "run.csv", "--input", "Valve", "--output", "Level", "--out", "auto.yaml", "--figure", "auto.png"
    )
    assert found["method"] == "auto" and str(found["structure"]).startswith(("oe 2,2", "bj"))
    assert str(found["recommendation"]).startswith(f"Take {found['structure']}: on data held back")
    assert len(found["candidates"]) >= 8  # type: ignore[arg-type]
    for ending in ("", "_residuals", "_bode", "_roots"):
        assert (folder / f"auto{ending}.png").stat().st_size > 10_000
    code, _, errors = call(("simulate", "--model", "auto.yaml", "--input", "run.csv", "--out", "said.csv",
                            "--figure", "said.png", "--json", "said.json"))  # fmt: skip
    assert code == 0, errors
    said = np.loadtxt(folder / "said.csv", delimiter=",", skiprows=1)
    assert np.std(said[:, 2] - table()[:, 2]) < 0.03  # the noise, about the level of 2 m
    assert json.loads((folder / "said.json").read_text())["fit_percent"]["simulation"]["Level"] > 90.0
    code, _, errors = call(
        ("design", "identified", "--identified", "auto.yaml", "--out", "law.yaml", "--json", "law.json")
    )
    assert code == 0, errors
    designed = json.loads((folder / "law.json").read_text())
    law, poles = load_plant_controller(folder / "law.yaml"), designed["poles"]
    assert law.channels == {"Level": "m"} and law.operating_point["Level"] == pytest.approx(2.0, abs=0.05)
    assert max(abs(complex(one["re"], one["im"])) for one in poles) < 1.0
    worst = designed["worst_case"]
    assert worst["models"] >= 101 and worst["stable_share"] == 1.0
    assert 1.0 < worst["gain_margin"] < designed["gain_margin"]
    assert worst["largest_sensitivity"] > designed["largest_sensitivity"]


def test_the_figure_shows_what_was_measured_with_its_mean(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A temperature of 23 to 105 degrees was one of -30 to 34."""
    monkeypatch.chdir(folder)
    drawn = []
    monkeypatch.setattr("hoopd.plots.style.save", lambda figure, path: drawn.append(figure))
    told(folder, "run.csv", "--input", "Valve", "--output", "Level", *QUICK, "--figure", "mean.png")
    measured, said = (line.get_ydata() for line in drawn[0].axes[0].get_lines())
    level = table()[:, 2]
    assert measured == pytest.approx(level[-len(measured) :]) and np.mean(said) == pytest.approx(2.0, abs=0.2)


def test_what_the_data_leave_open_is_in_the_file_and_a_law_that_loses_some_of_it_is_told(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    told(folder, "run.csv", "--input", "Valve", "--output", "Level", *QUICK, "--out", "model.yaml")
    file = load_identified(folder / "model.yaml")
    assert len(file.moves()) == len(file.estimates)
    unsure = replace(file, spread=[[400.0 * one for one in row] for row in file.spread])
    (folder / "unsure.yaml").write_text(identified_text(unsure))
    code, _, errors = call(("design", "identified", "--identified", "unsure.yaml", "--json", "law.json"))
    found = json.loads((folder / "law.json").read_text())
    assert code == 0 and found["worst_case"]["stable_share"] < 1.0, errors
    assert found["notes"][0].startswith("of 101 models that the data leave open (95 %) the law keeps ")
    (folder / "sure.yaml").write_text(identified_text(replace(file, spread=[])))
    assert call(("design", "identified", "--identified", "sure.yaml", "--json", "law.json"))[0] == 0
    assert "worst_case" not in json.loads((folder / "law.json").read_text())
    (folder / "short.yaml").write_text(identified_text(replace(file, spread=[[1.0]])))
    code, _, errors = call(("design", "identified", "--identified", "short.yaml"))
    assert code == 2 and "short.yaml: spread: must have 1 rows of " in errors


def test_rows_that_are_missing_cut_and_uneven_ones_are_brought_to_a_step(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    asked = ("--input", "Valve", "--output", "Level", *QUICK)
    cut = told(folder, "gap.csv", *asked)
    assert any("rows are missing: 590 of 590 rows used, in 2 parts" in one for one in cut["warnings"])  # type: ignore[union-attr]
    assert told(folder, "uneven.csv", *asked, "--sample-time", "0.5")["fit_percent"]["simulation"]["Level"] > 60.0  # type: ignore[index]


@pytest.mark.parametrize("method", ["arx", "oe", "armax", "bj"])
def test_inputs_that_act_late_are_told(folder: Path, monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    monkeypatch.chdir(folder)
    orders = ("--orders", "2,2" if method in ("arx", "oe") else "2,2,1")
    asked = ("run.csv", "--input", "Valve", "--output", "Level", "--method", method, *orders)
    at_once, late = (
        {name.split()[0] for name in told(folder, *asked, *more)["estimates"]}  # type: ignore[attr-defined]
        for more in ((), ("--input-delay", "3"))
    )
    assert {"b1", "b2"} <= at_once and {"b4", "b5"} <= late and "b1" not in late


def test_a_step_has_its_digits_however_short_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = table()[:200]
    for name, start, step in (("sound", 0.0, 1.0 / 44100.0), ("slow", 0.0, 0.02), ("late", 1e5, 0.02)):
        rows[:, 0] = start + np.cumsum(np.full(200, step))
        np.savetxt(f"{name}.csv", rows, delimiter=",", header="t,u,y,Other", comments="")
    signals = ("--input", "u", "--output", "y", *QUICK)
    told(tmp_path, "sound.csv", *signals, "--out", "sound.yaml")
    assert load_identified(Path("sound.yaml")).sample_time_s == pytest.approx(1.0 / 44100.0, rel=1e-7)
    # times that were added up, and times of a clock that has run for a day: the same step but for rounding
    told(tmp_path, "slow.csv", "late.csv", *signals, "--out", "slow.yaml")
    assert load_identified(Path("slow.yaml")).sample_time_s == 0.02
    code, _, errors = call(("identify", "sound.csv", "slow.csv", *signals))
    assert code == 2 and "files of different steps" in errors


BAD = [
    (("run.csv", "--input", "Valve"), "--output"),
    (("run.csv", "--input", "Valve", "--output", "Levle"), "no such column"),
    (("run.csv", "--input", "Valve", "--output", "Valve"), "is an input, too"),
    (("run.csv", "--input", "Valve,Valve", "--output", "Level"), "stands twice"),
    (("run.csv", "--input", "=", "--output", "Level"), "expected COLUMN"),
    (("bare.csv", "--input", "1", "--output", "2"), "--time COLUMN[:UNIT], or --sample-time"),
    (("bare.csv", "--input", "1", "--output", "7", "--sample-time", "0.5"), "no such column"),
    (("bare.csv", "--input", "1", "--output", "2", "--sample-time", "0"), "--sample-time"),
    (("uneven.csv", "--input", "Valve", "--output", "Level"), "--sample-time S brings them"),
    (("run.csv", "--input", "Valve", "--output", "Level", "--method", "magic"), "--method"),
    (("run.csv", "--input", "Valve", "--output", "Level", "--delay", "0.1"), "--delay"),
    (("run.csv", "--time", "Time"), "--time"),
    (("run.csv",), "columns of any other file are named by --input COLUMN"),
    (
        ("run.csv", "--input", "Valve", "--output", "Level", "--method", "arx", "--orders", "2,2,3"),
        "the samples by which inputs act late are --input-delay",
    ),
    (
        ("run.csv", "--input", "Valve", "--output", "Level", "--method", "pem", "--input-delay", "2"),
        "--input-delay: from 0 on, with arx, armax, oe, bj",
    ),
    (("none.dat", "--input", "1", "--output", "2"), "none.dat"),
    (("run.csv", "--input", "Other", "--output", "Level", "--time", "Level"), "wrong unit 'm'"),
]


@pytest.mark.parametrize(("words", "said"), BAD, ids=[" ".join(words) for words, _ in BAD])
def test_bad_input_is_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: str
) -> None:
    monkeypatch.chdir(folder)
    code, _, errors = call(("identify", *words))
    assert code == 2 and said in errors and len(errors.strip().splitlines()) == 1, errors


def test_an_identified_model_refuses_what_has_no_meaning_for_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    told(folder, "run.csv", "--input", "Valve", "--output", "Level", *QUICK, "--out", "model.yaml")
    for words, said in (
        (("simulate", "--model", "model.yaml", "--input", "run.csv", "--x0", "a=1"), "--x0"),
        (("simulate", "--model", "model.yaml", "--input", "run.csv", "--columns", "a=b"), "--columns"),
        (("design", "identified", "--identified", "model.yaml", "--omega", "3"), "--omega"),
        (("design", "identified", "--identified", "model.yaml", "--weights", "x=3"), "--weights"),
    ):
        code, _, errors = call(words)
        assert code == 2 and said in errors and len(errors.strip().splitlines()) == 1, errors


SETS = {
    "dryer.dat": (("--input", "1", "--output", "2", "--sample-time", "0.08"), 80.0),
    "exchanger.dat": (("--input", "2", "--output", "3", "--time", "1"), 30.0),
}


PARTS = {"exchanger.dat": "@1:1600"}  # of the time


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.proof if one in ("dryer.dat", "exchanger.dat") else []) for one in SETS],
)
def test_real_data_give_a_stable_model(folder: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    path = shared_path(f"plants/daisy/{name}")
    monkeypatch.chdir(folder)
    words, least = SETS[name]
    found = told(folder, f"{path}{PARTS.get(name, '')}", *words)
    (output,) = found["outputs"]  # type: ignore[misc]
    assert found["fit_percent"]["simulation"][output] > least  # type: ignore[index]
    assert max(abs(complex(one["re"], one["im"])) for one in found["poles"]) < 1.0  # type: ignore[union-attr]


BLOCK = """
schema: hoopd.plant/1
name: block
states: {T: {unit: K, usual: 1}}
inputs: {P: {unit: W, limit: 5}}
parameters: {C: {value: 20, unit: J/K}, k: {value: 1, unit: W/K}}
equations: {T: C*T' = P - k*T}
sample_time_s: 1
"""


def test_missing_rows_of_a_plant_s_recording_are_no_even_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "block.yaml").write_text(BLOCK)
    random, n = np.random.default_rng(3), 900
    u = np.repeat(random.choice([0.0, 1.0, 2.0], 90), 10)
    y = lfilter([0.0, 1.0 - np.exp(-0.05)], [1.0, -np.exp(-0.05)], u) + 0.002 * random.standard_normal(n)
    rows, k = np.column_stack([np.arange(n), u, y]), np.arange(n)
    uneven = rows + np.outer(random.uniform(0.0, 0.3, n), [1.0, 0.0, 0.0])
    for name, table in (("gap", rows[k % 250 < 200]), ("holes", rows[k % 60 < 48]), ("uneven", uneven)):
        np.savetxt(f"{name}.csv", table, delimiter=",", header="t,P,T", comments="")
    words = ("--plant", "block.yaml", "--orders", "1,1")
    found = told(tmp_path, "gap.csv", *words)
    assert "gap.csv: rows are missing: 750 of 750 rows used, in 4 parts" in found["warnings"]  # type: ignore[operator]
    for name, reason in (("holes", "no 50 rows follow each other"), ("uneven", "hoopd convert --step brings them")):
        code, _, errors = call(("identify", f"{name}.csv", *words))
        assert code == 2 and reason in errors and errors.count("\n") == 1


def test_ticks_that_are_only_late_lose_no_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    random, t = np.random.default_rng(2), 0.02 * np.arange(600)
    u = 0.1 * random.choice([-1.0, 1.0], 600)
    dtheta = lfilter([0.0, 0.3], [1.0, -0.98], u) + 0.01 * random.standard_normal(600)
    t[40::45] += 0.011
    table = np.column_stack([t, u, 0.02 * np.cumsum(dtheta), dtheta, np.zeros(600)])
    np.savetxt("late.csv", table, delimiter=",", header="t,u,theta,dtheta,psi", comments="")
    found = told(tmp_path, "late.csv", "--output", "dtheta", "--orders", "1,1")
    assert not [one for one in found["warnings"] if "rows" in one]  # type: ignore[attr-defined]


def test_one_row_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("one.csv").write_text("t,P,T\n0,1,2\n")
    Path("block.yaml").write_text(BLOCK)
    for words in (("--plant", "block.yaml"), ("--input", "P", "--output", "T")):
        code, _, errors = call(("identify", "one.csv", *words, "--orders", "1,1"))
        assert code == 2 and errors.count("\n") == 1
