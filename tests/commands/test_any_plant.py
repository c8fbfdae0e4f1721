"""The bench is for other laboratories' plants by the same commands: made data of a pendulum, tanks and an axis."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest

from hoopd import lab
from hoopd.commands import convert, design, diagnose, fit, identify, linearize, plant_experiment
from hoopd.commands.options.convert import ConvertOptions
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.commands.options.experiment import ExperimentOptions
from hoopd.commands.options.fit import FitOptions
from hoopd.commands.options.identify import IdentifyOptions
from hoopd.commands.options.linearize import LinearizeOptions
from hoopd.design.visibility import controllability, in_usual_sizes
from hoopd.files.identified import load_identified
from hoopd.files.reading import InputError
from hoopd.plants.free_run import FreeRun
from hoopd.plants.layout import layout_of
from hoopd.plants.plant_model import load_plant_model
from hoopd.plants.registry import plant_named
from hoopd.recording import load, save
from hoopd.recording.recording import from_signals
from tests.commands.test_plant import hoopd

Columns = dict[str, np.ndarray[Any, Any]]
# What the pendulum is in truth, and the step of its encoder (rad).
INERTIA, DAMPING, COUNT_RAD = 2.3e-4, 4.0e-5, 2.0 * np.pi / 2048


def written(path: Path, columns: Columns) -> Path:
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.10g")
    return path


def decay(path: Path, start_rad: float, seconds: float = 8.0) -> Path:
    """A pendulum that is let go, in degrees."""
    t = np.arange(0.0, seconds, 0.02)
    model = FreeRun(plant_named("pendulum"), values={"J": INERTIA, "c": DAMPING})
    alpha = model.run([], [start_rad, 0.0], t, np.zeros((len(t) - 1, 0))).readings[:, 0]
    return written(path, {"time": t, "angle": np.degrees(np.round(alpha / COUNT_RAD) * COUNT_RAD)})


# ---------------------------------------------------------------------------------------------- diagnose


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("pendulum")
    train, held = decay(folder / "train.csv", 0.6), decay(folder / "held.csv", -0.4, 5.0)
    diagnose.run(
        DiagnoseOptions(
            recordings=(str(train),),
            holdout=(str(held),),
            plant="pendulum",
            columns="alpha=angle:deg",
            json_path=folder / "out.json",
            report=folder / "out.html",
            write=folder / "found.yaml",
        )
    )
    return folder, json.loads((folder / "out.json").read_text())


def test_a_pendulum_of_other_numbers_is_told_by_its_parameters(judged: tuple[Path, dict[str, Any]]) -> None:
    folder, found = judged
    assert found["verdict"] == "parameters"
    inertia = found["base"]["parameters"]["J"]
    assert inertia["value"] == pytest.approx(INERTIA, rel=0.01)
    assert inertia["ci95"][0] < INERTIA < inertia["ci95"][1]
    assert found["data_quality"]["outliers"] == 0
    assert "<html" in (folder / "out.html").read_text()


def test_the_model_that_is_written_names_its_plant_and_is_judged_again(judged: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = judged
    model = load_plant_model(folder / "found.yaml")
    assert (model.plant.name, model.file.plant, model.is_hoop) == ("pendulum", "pendulum", False)
    assert model.values["J"] == pytest.approx(INERTIA, rel=0.01)
    again = diagnose.run(
        DiagnoseOptions(
            recordings=(str(folder / "train.csv"),),
            model=folder / "found.yaml",
            columns="alpha=angle:deg",
            free_run=False,
        )
    )
    assert again.verdict == "consistent"


def test_a_model_of_another_plant_is_refused_in_one_line(judged: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = judged
    with pytest.raises(InputError, match=r"plant: a model of 'pendulum', where one of the hoop is needed"):
        from hoopd.plants.model_file import load_model

        load_model(folder / "found.yaml")
    text = (folder / "found.yaml").read_text()
    (folder / "wrong.yaml").write_text(text.replace("  J:", "  Jx:"))
    with pytest.raises(InputError, match=r"wrong.yaml: parameters.Jx: pendulum has no such parameter"):
        load_plant_model(folder / "wrong.yaml")


def test_two_seconds_of_a_fast_axis_are_enough(tmp_path: Path) -> None:
    random, t = np.random.default_rng(1), np.arange(0.0, 2.0, 0.001)
    force = np.repeat(random.choice([-80.0, 80.0], len(t) // 20 + 1), 20)[: len(t)]
    run = FreeRun(plant_named("axis"), values={"M": 90.0, "Fv": 150.0, "offset": 4.0})
    x = run.run([], [0.0, 0.0], t, force[:-1]).readings[:, 0]
    path = written(tmp_path / "axis.csv", {"t": t, "F": force, "x": np.round(x / 5e-8) * 5e-8 * 1e3})
    found = diagnose.run(DiagnoseOptions(recordings=(str(path),), plant="axis", columns="F=F:N,x=x:mm", free_run=False))
    mass = found.base.parameters["M"]
    assert mass.value == pytest.approx(90.0, rel=0.01)
    assert found.verdict == "parameters"


def drop(path: Path, seconds: float, seed: int = 2) -> str:
    """A body that falls, seen 15 times a second to 5 cm."""
    t = np.arange(0.0, seconds, 1.0 / 15.0)
    h = 46.0 - 9.81 * t**2 / 2.0 + 0.05 * np.random.default_rng(seed).normal(size=len(t))
    return str(written(path, {"t": t, "h": h}))


def test_two_seconds_of_a_fall_are_enough_and_half_of_one_is_not(tmp_path: Path) -> None:
    path = drop(tmp_path / "fall.csv", 2.0)
    found = diagnose.run(DiagnoseOptions(recordings=(path,), plant="falling", free_run=False))
    assert found.verdict == "consistent"
    held = drop(tmp_path / "held.csv", 2.0, seed=3)
    found = diagnose.run(DiagnoseOptions(recordings=(path,), holdout=(held,), plant="falling", free_run=False))
    assert found.verdict == "consistent"
    with pytest.raises(InputError, match="h: fewer than 15 readings to judge a model by"):
        diagnose.run(DiagnoseOptions(recordings=(drop(tmp_path / "short.csv", 0.5),), plant="falling"))


def test_without_free_parameters_a_fit_is_of_the_start(tmp_path: Path) -> None:
    path = drop(tmp_path / "fall.csv", 2.0)
    found = fit.run(FitOptions(recordings=(path,), plant="falling"))
    assert found["notes"] == ["no parameter is free: the start alone was fitted"]
    assert found["fit"]["train"][path]["h"]["fitted"] > 99.0


def test_tanks_of_first_order_states_are_diagnosed(tmp_path: Path) -> None:
    random, t = np.random.default_rng(3), np.arange(0.0, 900.0, 1.0)
    pump = 5e-5 + np.repeat(random.choice([-2e-5, 2e-5], len(t) // 30 + 1), 30)[: len(t)]
    run = FreeRun(plant_named("tanks"), values={"a1": 2.6e-5, "a2": 2.4e-5})
    levels = run.run([], [0.2, 0.2], t, pump[:-1]).readings + 2e-4 * random.normal(size=(len(t), 2))
    path = written(tmp_path / "tanks.csv", {"t": t, "q": pump, "h1": levels[:, 0], "h2": levels[:, 1]})
    found = diagnose.run(DiagnoseOptions(recordings=(str(path),), plant="tanks", free_run=False))
    assert found.base.parameters["a1"].value == pytest.approx(2.6e-5, rel=0.02)
    assert found.base.parameters["a2"].value == pytest.approx(2.4e-5, rel=0.02)
    assert found.verdict == "parameters"


def test_a_signal_that_is_not_there_is_named(tmp_path: Path) -> None:
    path = decay(tmp_path / "one.csv", 0.3, 3.0)
    with pytest.raises(InputError, match=r"column angel.*did you mean 'angle'"):
        diagnose.run(DiagnoseOptions(recordings=(str(path),), plant="pendulum", columns="alpha=angel:deg"))


# ---------------------------------------------------------------------------------------------- linearize


def test_tanks_are_linear_about_the_levels_that_a_pump_holds() -> None:
    found = linearize.run(LinearizeOptions(plant="tanks", at="q=5e-5,h1=0.1,h2=0.1", outputs=("h2",)))
    # a sqrt(2 g h) = q, and a tank's pole is -a sqrt(g / 2h) / A
    level = (5e-5 / 2.5e-5) ** 2 / (2 * 9.81)
    assert found["operating_point"] == pytest.approx({"h1": level, "h2": level, "q": 5e-5})
    pole = -2.5e-5 * np.sqrt(9.81 / (2 * level)) / 0.015
    assert [one["re"] for one in found["poles"]] == pytest.approx([pole, pole], rel=1e-6)
    assert found["state_space"]["outputs"] == ["h2"]


def test_a_pendulum_without_a_drive_has_poles_and_no_margins() -> None:
    found = linearize.run(LinearizeOptions(plant="pendulum", at="alpha=3"))
    assert found["operating_point"]["alpha"] == pytest.approx(np.pi)
    assert max(one["re"] for one in found["poles"]) > 9.0
    assert "margins" not in found
    assert any("no input" in note for note in found["notes"])
    assert "alpha is not moved by nothing" not in found["notes"] and "torque" not in " ".join(found["notes"])


HEATER = """
schema: hoopd.plant/1
name: heater
states: {T: {unit: degC, usual: 50}}
inputs: {duty: {unit: "%", limit: 100}, sun: W}
parameters: {C: 100 J/K, h: 0.8 W/K, P: 0.8 W/%, Ta: 22.5 degC}
equations:
  T: C*T' = P*duty + sun - h*(T - Ta)
sample_time_s: 4
"""
VESSEL = """
schema: hoopd.plant/1
name: vessel
states: {h: {unit: m, usual: 0.2}}
inputs: {q: m3/s}
parameters: {A: 0.015 m2, a: 2.5e-5 m2, g: 9.81 m/s2}
equations:
  h: A*h' = q - a*sqrt(2*g*h)
sample_time_s: 1
"""


@pytest.mark.parametrize(
    ("plant", "at", "said"),
    [
        ("heater.yaml", "T=60", "with duty=0, sun=0, not named here, heater stays at T=22.5, not at T=60; duty=37.5 "),
        ("heater.yaml", "T=60,sun=10", "with duty=0, not named here, .* not at T=60; duty=25 would hold it: name it"),
        ("heater.yaml", "T=300,sun=0", ".*duty=277.5 would hold it, which is beyond its limit of 100 %"),
        ("tanks", "h1=0.2,h2=0.2", "with q=0, not named here, .*; q=4.952"),
        ("tanks", "h1=0.2,h2=0.1", "with q=0, not named here, .*; no q holds it there"),
        ("vessel.yaml", "q=0,h=0.2", "vessel has no finite derivatives"),
    ],
)
def test_a_point_that_nothing_holds_is_refused_and_what_would_hold_it_is_told(
    plant: str, at: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A law about 60 degrees was one about 22.5; levels that no pump holds were empty tanks."""
    monkeypatch.chdir(tmp_path)
    for name, text in (("heater", HEATER), ("vessel", VESSEL)):
        (tmp_path / f"{name}.yaml").write_text(text)
    with pytest.raises(InputError, match=f"--at: {said}"):
        linearize.run(LinearizeOptions(plant=plant, at=at))
    with pytest.raises(InputError, match=f"--at: {said}"):
        design.run(DesignOptions(law="lqg", plant=plant, at=at, out=tmp_path / "law.yaml"))
    assert not (tmp_path / "law.yaml").exists()


def test_a_state_beside_named_inputs_says_where_to_look_and_where_it_stays_is_told() -> None:
    found = linearize.run(LinearizeOptions(plant="tanks", at="q=5e-5,h1=0.1,h2=0.2039"))
    assert "h1 stays at 0.2039 with these inputs; the 0.1 of --at said where to look" in found["notes"]
    assert not any(note.startswith("h2 stays") for note in found["notes"])
    law = design.run(DesignOptions(law="lqg", plant="tanks", at="q=5e-5,h1=0.1,h2=0.2"))
    assert any(note.startswith("h1 stays at 0.2039") for note in law["notes"])


def test_what_never_rests_has_no_operating_point() -> None:
    with pytest.raises(InputError, match="--at: falling stays nowhere"):
        linearize.run(LinearizeOptions(plant="falling"))
    with pytest.raises(InputError, match="--top"):
        linearize.run(LinearizeOptions(plant="pendulum", top=True))


def test_what_is_seen_does_not_depend_on_units() -> None:
    """The voltage that is read is seen, though a current of 1 A would change it by 1e5 V in a second."""
    found = linearize.run(LinearizeOptions(plant="circuit"))
    assert found["observability"]["weak"] == [] and not any("hardly" in note for note in found["notes"])
    assert min(lab.linearize(plant="circuit").observability.singular_values) == pytest.approx(1.0, rel=1e-3)
    system, sizes = lab.linearize(plant="circuit").system, {"i": 0.05, "v": 5.0, "V": 5.0}
    by = np.array([1e3, 1e-3])  # currents in mA, voltages in kV
    other = control.ss(
        system.A * by[:, None] / by, system.B * by[:, None], system.C / by, 0, states=["i", "v"], inputs=["V"]
    )
    there = in_usual_sizes(other, {"i": 50.0, "v": 5e-3, "V": 5.0})
    assert controllability(there).singular_values == pytest.approx(
        controllability(in_usual_sizes(system, sizes)).singular_values
    )


@pytest.mark.parametrize(("extension", "told"), [(".csv", True), (".mat", True), (".mcap", False), (".h5", False)])
def test_a_file_that_cannot_say_how_inputs_go_on_says_so(tmp_path: Path, extension: str, told: bool) -> None:
    t = np.arange(5.0)
    save(from_signals(t, {"q": 1e-5 * t}, {"h1": 0.1 * t, "h2": 0.1 * t}), tmp_path / "a.csv")
    asked = ConvertOptions(source=tmp_path / "a.csv", target=tmp_path / f"b{extension}", plant="tanks", hold="linear")
    assert any("--hold linear" in note for note in convert.run(asked)["notes"]) == told
    found = load(asked.target, layout=layout_of(plant_named("tanks")))
    assert (found.inputs["q"].hold == "linear") != told


# ---------------------------------------------------------------------------------------------- experiment, identify


def test_a_signal_is_simulated_on_tanks_and_identified_by_its_names(tmp_path: Path) -> None:
    out = tmp_path / "tanks.csv"
    told = plant_experiment.run(
        ExperimentOptions(
            kind="prbs",
            plant="tanks",
            at="q=5e-5,h1=0.204,h2=0.204",
            amplitude_nm=5e-6,
            clock_ticks=20,
            duration_s=1500.0,
            out=out,
        )
    )
    assert (told["rows"], told["seconds"]) == (1500, 1499.0)
    recording = load(out, layout=layout_of(plant_named("tanks")))
    assert np.ptp(recording.column("q")) == pytest.approx(1e-5)
    assert recording.column("h1")[0] == pytest.approx(0.204)
    found = identify.run(
        IdentifyOptions(
            recordings=(str(out),), plant="tanks", orders=(2, 2), detrend=True, out=tmp_path / "identified.yaml"
        )
    )
    assert found["outputs"] == ["h1", "h2"]
    assert found["fit_percent"]["10"]["h2"] > 95.0
    file = load_identified(tmp_path / "identified.yaml")
    assert (file.inputs, file.outputs, file.sample_time_s) == (["q"], ["h1", "h2"], 1.0)


def test_a_plant_faster_than_the_hoop_is_asked_for_shorter_times(tmp_path: Path) -> None:
    """Times of the hoop bound the hoop alone; what only a device does is refused."""
    out = str(tmp_path / "steps.csv")
    words = ("experiment", "steps", "--plant", "circuit", "--out", out)
    assert hoopd(*words, "--duration", "0.1", "--hold", "0.004")[0] == 0
    recording = load(Path(out), layout=layout_of(plant_named("circuit")))
    held = np.diff(np.flatnonzero(np.diff(recording.column("V"))))
    assert len(recording) == 500 and set(held % 20) == {0}
    for more, said in (
        (("--hold", "1e-5"), "--hold: 1e-05 s are less than a sample of circuit, 0.0002 s"),
        (("--duration", "1e9"), "--duration: 1e+09 s are not 2 to"),
        (("--max-torque", "0.1"), "--max-torque: is of the device"),
        (("--soft-end", "0.1"), "--soft-end: is of the device"),
    ):
        code, _, error = hoopd(*words, *more)
        assert code == 2 and said in error
    for more in (("--duration", "0.1"), ("--hold", "0.001")):
        code, _, error = hoopd("experiment", "steps", "--sim", "--out", "run.mcap", *more)
        assert code == 2 and f"{more[0]}: must be" in error
    with pytest.raises(InputError, match="--low: must be a finite number"):
        lab.experiment("chirp", plant="axis", low=float("nan"))


def test_what_is_told_of_a_signal_is_played_as_told(tmp_path: Path) -> None:
    """The numbers that nobody tells are meant for samples of 20 ms, and grow with the plant's: an axis has 1 ms."""
    held = {}
    for name, told in (("told", 0.4), ("untold", None)):
        out = tmp_path / f"{name}.csv"
        plant_experiment.run(ExperimentOptions(kind="steps", plant="axis", duration_s=2.0, hold_s=told, out=out))
        force = load(out, layout=layout_of(plant_named("axis"))).column("F")
        turns = np.flatnonzero(np.diff(force)) + 1
        held[name] = float(np.median(np.diff(turns)))
    assert (held["told"], held["untold"]) == (400.0, 20.0)


def test_without_an_input_only_a_decay_can_be_simulated_and_nothing_identified(tmp_path: Path) -> None:
    asked = {"plant": "pendulum", "at": "alpha=0.5", "duration_s": 4.0, "out": tmp_path / "run.csv"}
    told = plant_experiment.run(ExperimentOptions(kind="decay", **asked))
    assert told["peaks"]["alpha"] == pytest.approx(0.5, abs=0.01)
    with pytest.raises(InputError, match="KIND: pendulum has no input"):
        plant_experiment.run(ExperimentOptions(kind="prbs", **asked))
    with pytest.raises(InputError, match="--arm: is of the device"):
        plant_experiment.run(ExperimentOptions(kind="decay", arm=True, **asked))
    with pytest.raises(InputError, match="--amplitude: 2000 is beyond the limit of F, 1000 N"):
        plant_experiment.run(
            ExperimentOptions(kind="prbs", plant="axis", amplitude_nm=2000.0, out=tmp_path / "axis.csv")
        )
    with pytest.raises(InputError, match=r"not 2 to [0-9]* samples of tanks, which is sampled every 1 s"):
        plant_experiment.run(ExperimentOptions(kind="prbs", plant="tanks", duration_s=0.2, out=tmp_path / "t.csv"))
    with pytest.raises(InputError, match="pendulum: has no input"):
        identify.run(IdentifyOptions(recordings=(str(tmp_path / "run.csv"),), plant="pendulum"))


# ---------------------------------------------------------------------------------------------- lab


def test_the_lab_diagnoses_a_recording_in_memory(tmp_path: Path) -> None:
    swing = lab.load(decay(tmp_path / "swing.csv", 0.6), "alpha=angle:deg", plant="pendulum")
    found = lab.diagnose(swing, plant=lab.plant("pendulum"), free_run=False)
    assert found.verdict == "parameters"
    assert found.parameters["J"] == pytest.approx(INERTIA, rel=0.02)
    assert found.effects == {}
    assert "parameters" in repr(found).lower()
    assert load_plant_model(found.save(tmp_path / "found.yaml")).plant.values["J"] == pytest.approx(INERTIA, rel=0.02)
    with pytest.raises(TypeError, match="colour"):
        lab.diagnose(swing, plant="pendulum", colour=1)


# ---------------------------------------------------------------------------------------------- design


def test_a_law_for_an_axis_has_the_poles_that_were_asked_for() -> None:
    found = design.run(DesignOptions(law="placement", plant="axis", poles="-20+10j,-20-10j"))
    wanted = np.exp((-20 + 10j) * 0.001)
    assert any(abs(complex(one["re"], abs(one["im"])) - wanted) < 1e-6 for one in found["closed_loop_poles"])
    assert (found["states"], found["inputs"], found["channels"]) == (["x", "dx"], ["F"], ["x"])
    with pytest.raises(InputError, match="LAW: pid is a law of the hoop"):
        design.run(DesignOptions(law="pid", plant="axis"))
    with pytest.raises(InputError, match="pendulum: has no input"):
        design.run(DesignOptions(law="lqg", plant="pendulum"))


def test_a_quadratic_law_keeps_tanks_at_their_levels() -> None:
    asked = {"law": "lqg", "plant": "tanks", "at": "q=5e-5,h1=0.2,h2=0.2"}
    found = design.run(DesignOptions(**asked))
    assert max(abs(complex(one["re"], one["im"])) for one in found["closed_loop_poles"]) < 1.0
    cheap = design.run(DesignOptions(**asked, weights=("q=1e-3",)))
    assert abs(cheap["feedback"][0][0]) > abs(found["feedback"][0][0])
