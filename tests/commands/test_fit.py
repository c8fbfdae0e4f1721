"""`hoopd fit`: from recordings on disk to a model that other commands take; unusable wishes are one line."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from shared import shared_path
from typer.testing import CliRunner

from hoopd.commands import fit
from hoopd.commands.cli import app
from hoopd.commands.fit_record import _device, _known, _worse
from hoopd.commands.fit_tables import _made_of, for_terminal
from hoopd.commands.options.fit import FitOptions
from hoopd.files.model import Parameter
from hoopd.files.reading import InputError
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.parameters import PARAMETER_UNITS
from hoopd.plants.hoop.simulate import HoopModel
from hoopd.plants.model_file import load_model
from hoopd.recording import save
from hoopd.recording.recording import from_columns

HOOP = load_model(defaults_folder() / "models/hoop.yaml")


def run(recordings: Sequence[str], holdout: Sequence[str] = (), **asked: Any) -> dict[str, Any]:
    """What the command finds."""
    return fit.run(FitOptions(recordings=tuple(recordings), holdout=tuple(holdout), **asked))


def recording(folder: Path, name: str = "run.csv", seed: int = 1, seconds: float = 6.0, ball: bool = True) -> str:
    """A simulated run on disk."""
    rng = np.random.default_rng(seed)
    t = np.round(np.arange(0.0, seconds, 0.02), 6)
    u = 0.1 * rng.choice([-1.0, 1.0], len(t))
    x = HoopModel("rolling", HOOP.values(), moving="both" if ball else "hoop").run([], [0, 0, 0, 0], t, u[:-1])
    psi = x[:, 2] + 0.002 * rng.normal(size=len(t)) if ball else np.full(len(t), np.nan)
    columns = {"t": t, "u": u, "theta": np.floor(x[:, 0] * 4096 / (2 * np.pi)) * 2 * np.pi / 4096, "psi": psi}
    path = folder / name
    save(from_columns({**columns, "dtheta": x[:, 1]}, source=name), path)
    return str(path)


def test_a_recording_becomes_a_model_file_that_repeats_a_run_it_never_saw(tmp_path: Path) -> None:
    out, figure = tmp_path / "mine.yaml", tmp_path / "fit.png"
    held = recording(tmp_path, "held.csv", seed=2)
    result = run([recording(tmp_path)], [held], out=out, figure=figure)
    assert figure.stat().st_size > 10_000
    model = load_model(out)
    assert model.structure == "entries"
    for name, row in result["parameters"].items():
        assert model.parameters[name].value == row["value"]
        assert row["ci95"][0] < row["value"] < row["ci95"][1]
    assert model.parameters["K2"].value == pytest.approx(-78.546, rel=0.002)
    scores = result["fit"]["holdout"][held]["psi"]
    assert scores["fitted"] > 99.0
    assert scores["nominal"] < scores["fitted"]
    assert scores["fitted_2s"] > 99.0
    json.dumps(result, allow_nan=False)
    shown = for_terminal(result)
    assert "- fit" not in str(shown)
    assert shown["next"] == f"hoopd design lqg --model {out} --out lqg.yaml"
    assert "next" not in result


def test_what_the_entries_miss_is_shown_where_something_is_missed() -> None:
    values = dict.fromkeys(PARAMETER_UNITS["rolling"], 1.0)
    small, large = {"J11": 0.09, "K2": -0.02}, {"J11": 0.09, "K2": -3.0}
    for published, rows in ((small, None), (large, {"K2": {"rolling": "-0.0 %", "published": "-3.0 %"}})):
        kinds = (("rolling", small), ("published", published))
        physical = {kind: {"parameters": values, "misfit_percent": misfit} for kind, misfit in kinds}
        assert _made_of(physical).get("what their entries miss") == rows


def late(folder: Path) -> str:
    """A run whose rows hold a board's readings of 20 ms before and a ball's angle of 30 ms before."""
    rng = np.random.default_rng(1)
    t = np.round(np.arange(0.0, 8.0, 0.01), 6)  # two nodes a tick
    u = np.repeat(0.1 * rng.choice([-1.0, 1.0], len(t) // 2), 2)
    x = HoopModel("rolling", HOOP.values(), moving="both").run([], [0, 0, 0, 0], t, u[:-1])
    psi = x[:, 2] + 0.002 * rng.normal(size=len(t))
    rows = np.arange(4, len(t), 2)
    columns = {"t": t[rows], "u": u[rows], "theta": x[rows - 2, 0], "dtheta": x[rows - 2, 1], "psi": psi[rows - 3]}
    path = folder / "late.csv"
    save(from_columns(columns), path)
    return str(path)


def test_ages_put_late_samples_where_they_belong(tmp_path: Path) -> None:
    rec = late(tmp_path)
    told, untold = run([rec], age="psi=0.03,y=0.02"), run([rec])
    assert told["age_s"] == {"psi": 0.03, "y": 0.02}
    assert told["parameters"]["K2"]["value"] == pytest.approx(-78.546, rel=0.002)
    assert told["residuals"]["psi"]["sigma"] < 0.003 < untold["residuals"]["psi"]["sigma"]
    assert any("say so with --age" in note for note in untold["notes"])
    assert not any("--age" in note for note in told["notes"])


def test_a_file_with_sample_times_takes_no_age(tmp_path: Path) -> None:
    t = 0.02 * np.arange(100)
    path = tmp_path / "own.csv"
    save(from_columns({"t": t, "u": t, "theta": t, "dtheta": t, "psi": t, "psi_t": t - 0.04}), path)
    for age, words in (("psi=0.03", "--age: psi: own.csv has sample times"), ("y=20", "--age: y must be 0 to 1 s")):
        with pytest.raises(InputError) as caught:
            run([str(path)], age=age)
        assert words in str(caught.value) and "\n" not in str(caught.value)


def test_the_same_recording_gives_the_same_file(tmp_path: Path) -> None:
    one, other = tmp_path / "a" / "m.yaml", tmp_path / "b" / "m.yaml"
    for path in (one, other):
        path.parent.mkdir()
        run([recording(tmp_path)], out=path)
    assert one.read_bytes() == other.read_bytes()


def test_a_fitted_device_is_known_as_well_as_its_intervals_say() -> None:
    entry = HOOP.parameters["Ib"]
    wide = Parameter(value=entry.value, unit=entry.unit, ci95=(0.5 * entry.value, 1.5 * entry.value))
    model = msgspec.structs.replace(HOOP, parameters={**HOOP.parameters, "Ib": wide})
    known = {one.name: one.relative_sd for one in _known(model, model.values())}
    assert known["Ib"] == pytest.approx(0.5 / 1.96, rel=1e-3)
    assert known["mb"] == 0.01  # weighed


def test_a_recording_is_not_fitted_twice_and_does_not_judge_itself(tmp_path: Path) -> None:
    one = recording(tmp_path)
    with pytest.raises(InputError, match="rows in common"):
        run([one, one])
    with pytest.raises(InputError, match="rows in common"):
        run([one], [f"{one}@2:5"])


def test_a_held_out_run_that_got_worse_is_said(tmp_path: Path) -> None:
    judged = {
        "holdout": {"x.csv": {"psi": {"nominal": 80.0, "fitted": 20.0}, "dtheta": {"nominal": 1.0, "fitted": 2.0}}}
    }
    (words,) = _worse(judged)
    assert words.startswith("x.csv: psi is repeated worse")
    assert _worse({"holdout": {"x.csv": {"psi": {"nominal": None, "fitted": 20.0}}}}) == []


def test_several_recordings_make_one_physical_fit(tmp_path: Path) -> None:
    wish = {"structure": "rolling", "fix": ("mb", "Ro=0.0957,Rb=0.0104"), "prior": ("Ih=0.0014:0.5",)}
    files = [recording(tmp_path, "one.csv", 1), recording(tmp_path, "hoop.csv", 2, ball=False)]
    result = run(files, **wish, out=tmp_path / "m.yaml")
    assert result["parameters"]["Ih"]["value"] == pytest.approx(0.001518, rel=0.01)
    assert result["parameters"]["mb"] == {"value": 0.0608, "unit": "kg", "ci95": None, "nominal": 0.0608}
    assert result["starts"] == 2


def test_the_command_prints_tables_and_writes_json(tmp_path: Path) -> None:
    out = tmp_path / "fit.json"
    done = CliRunner().invoke(app, ["fit", recording(tmp_path), "--window", "3", "--json", str(out)])
    assert done.exit_code == 0, done.output
    assert "parameters" in done.output
    assert "theta_rate" in done.output
    written = json.loads(out.read_bytes())
    assert written["starts"] == 2
    assert written["undetermined"]["words"] == [] or isinstance(written["undetermined"]["words"][0], str)
    assert np.array(written["correlation"]["matrix"]).shape == (8, 8)


def test_prediction_error_gives_noise_levels(tmp_path: Path) -> None:
    result = run([recording(tmp_path)], method="prediction")
    assert result["parameters"]["K2"]["value"] == pytest.approx(-78.546, rel=0.005)
    assert result["noise"]["r_psi"]["value"] == pytest.approx(0.002**2, rel=0.3)
    assert set(result["innovations"]) == {"theta", "psi"}
    assert "next" not in for_terminal(result)  # nothing was written that a next command could take


BAD_WISHES = [
    ({"structure": "rotating"}, "--structure: unknown 'rotating'"),
    ({"loss": "square"}, "--loss: unknown"),
    ({"method": "guess"}, "--method: unknown"),
    ({"free": ("K3",)}, "--free: unknown 'K3'"),
    ({"fix": ("K2=heavy",)}, "--fix: K2: expected a number"),
    ({"fix": ("Ib",)}, "--fix: unknown 'Ib'"),
    ({"prior": ("K2=-70",)}, "expected NAME=VALUE:SIGMA"),
    ({"prior": ("K2=-70:0",)}, "sigma must be positive"),
    ({"channels": ("current",)}, "--channels: unknown 'current'"),
    ({"free": ("J11", "mb")}, "--free: mb: these recordings bear on"),
    ({"prior": ("mb=0.06:0.1",)}, "--prior: mb: is not fitted"),
    ({"structure": "rolling", "fix": ("mb=-1",)}, "--fix: mb: must be positive"),
    ({"structure": "rolling", "fix": ("Rb=0.2",)}, "--fix: Rb: the ball's rolling radius"),
    ({"structure": "rolling", "prior": ("Ih=-1:0.1",)}, "--prior: Ih: must be positive"),
    ({"window_s": 0.01}, "--window: must be 0.2"),
    ({"fix": ("J11", "J12", "K1", "L1", "J21", "J22", "K2", "L2")}, "nothing is left to fit"),
    ({"method": "prediction", "channels": ("theta_rate",)}, "use theta"),
    ({"structure": "rolling", "model": defaults_folder() / "models/thesis.yaml"}, "nothing to start a fit of rolling"),
]


@pytest.mark.parametrize(("wish", "words"), BAD_WISHES, ids=[words for _, words in BAD_WISHES])
def test_a_wish_that_cannot_be_met_is_one_line(tmp_path: Path, wish: dict[str, Any], words: str) -> None:
    out = tmp_path / "m.yaml"
    with pytest.raises(InputError) as caught:
        run([recording(tmp_path)], **wish, out=out)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.mcap"], "nowhere.mcap"),
        (["{rec}", "--holdout", "nowhere.csv"], "nowhere.csv"),
        (["{rec}@5:2"], "ends before it begins"),
        (["{rec}", "--out", "no/such/folder/m.yaml"], "no such folder"),
        (["{rec}", "--figure", "fit.bmp"], "fit.bmp"),
        (["{rec}", "--json", "no/such/folder/m.json"], "no such folder"),
    ],
)
def test_unusable_arguments_are_one_line_and_exit_code_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    import sys

    from hoopd.commands.cli import main

    rec = recording(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["hoopd", "fit", *(one.format(rec=rec) for one in arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    error = capfd.readouterr().err
    assert ended.value.code == 2
    assert words in error
    assert error.count("\n") == 1


def test_the_device_is_what_it_started_from_never_what_was_fitted(tmp_path: Path) -> None:
    """A geometry that the fit itself moved must not come back as measured, and a user's own inertia is kept."""
    path = tmp_path / "mine.yaml"
    text = (defaults_folder() / "models/hoop.yaml").read_text()
    path.write_text(text.replace("3.679e-6", "4.1e-6"))
    base = load_model(path)
    assert base.values()["Ib"] == 4.1e-6
    assert _device(base, {"mb": 0.05}) == {**base.values(), "mb": 0.05}
    entries = load_model(defaults_folder() / "models/thesis.yaml")
    assert _device(entries, {"K2": -70.0}) == {
        **HOOP.values(),
        **{n: entries.values()[n] for n in ("mb", "Ro", "Rb", "g")},
    }


def test_the_second_step_says_what_the_thesis_s_table_is(tmp_path: Path) -> None:
    result = run([str(shared_path("recordings/meas_hoopAndBall2_01.mat")) + "@:19.8"], kinematics=True)
    words = " ".join(result["physical"]["words"])
    assert "Table 3.1" in words
    assert "do not reproduce" in words
    assert "cannot be separated" in " ".join(result["kinematics"]["words"])
    assert result["kinematics"]["supported"] is None
    assert set(result["physical"]["rolling"]["misfit_percent"]) == set(result["parameters"])
    assert any("dtheta" in note for note in result["notes"])  # the speed column of that device reads a fifth too low
