"""The engineer's interface against the rooms that it stands on; its examples; what a newcomer gets wrong."""

from __future__ import annotations

import doctest
import importlib
import pkgutil
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import hoopd.lab as lab
from hoopd.design.analysis import linear_model
from hoopd.design.laws import Spec, design_lqg
from hoopd.design.margins import margins
from hoopd.design.weights import Weights
from hoopd.files.controller import load_controller
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.fitting.fit import FitSettings, fit as fit_parameters
from hoopd.plants.hoop.fitting.fit_percent import score
from hoopd.plants.hoop.loop.closed_loop import Scenario, picture_timing
from hoopd.plants.hoop.loop.trial import run as closed
from hoopd.plants.hoop.recordings.recorded_runs import Subject
from hoopd.plants.model_file import load_model
from hoopd.recording.edit import between

PUMPED = lab.simulate(plant="tanks", input=(np.arange(60.0), 5e-5)).recorded
TABLE = {"mb": 0.0608, "Ro": 0.0957, "Rb": 0.0104}  # weighed and measured


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return lab.experiment("prbs", duration=6, seed=1, file=tmp_path_factory.mktemp("lab") / "prbs.mcap")


@pytest.fixture(scope="module")
def thesis():
    return lab.model("thesis")


@pytest.mark.parametrize("module", [one.name for one in pkgutil.iter_modules(lab.__path__)])
def test_examples(module):
    found = doctest.testmod(importlib.import_module(f"hoopd.lab.{module}"))
    assert found.failed == 0


# ---------------------------------------------------------------------------------------------- models


def test_a_model_by_name_is_the_shipped_file(thesis):
    assert thesis.file == load_model(defaults_folder() / "models/thesis.yaml")
    assert thesis.parameters == thesis.file.values()


def test_a_changed_model_is_another_one_and_comes_back_from_its_file(thesis, tmp_path):
    changed = thesis.with_parameters(K2=-80.0, mb=0.05)
    assert thesis.parameters["K2"] == pytest.approx(-73.6336, abs=1e-4)
    saved = changed.save(tmp_path / "heavy.yaml")
    again = lab.model(tmp_path / "heavy.yaml")
    assert again.parameters == changed.parameters == saved.parameters
    assert (again.name, again.parameters["mb"]) == ("heavy", 0.05)
    assert "K2" in again.table()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: lab.model("thesys"), "shipped are only hoop, inner_hoop, thesis"),
        (lambda: lab.model("no/such.yaml"), "such.yaml"),
        (lambda: lab.model("thesis").with_parameters(bb=1.0), "bb: not a parameter of the entries model"),
        (lambda: lab.model("hoop").with_parameters(Ih=-1.0), "Ih: must be positive"),
        (lambda: lab.load("nothing.mcap"), "no such file"),
        (lambda: lab.simulate(lab.model("hoop"), np.zeros(5)), r"a recording or a pair \(t, u\)"),
        (lambda: lab.simulate(lab.model("hoop"), ([0, 1, 0.5], 0.0)), "increase"),
        (lambda: lab.simulate(lab.model("hoop"), ([0, 1, 2], [0.1])), "one finite torque for each of 3"),
        (lambda: lab.simulate(lab.model("hoop"), ([0, 1], 0.0), x0={"angle": 1}), "unknown angle; known: theta"),
        (lambda: lab.simulate(lab.model("hoop"), ([0, 1], 0.0), x0=[1, 2]), "x0 must be"),
        (lambda: lab.fit([]), "a recording or several"),
        (lambda: lab.fit("run.mcap"), "a recording or several"),
        (lambda: lab.fit(PUMPED, plant="tanks", structure="rolling"), "--structure: belongs to the hoop"),
        (lambda: lab.fit(PUMPED, plant="tanks", free="a3"), "a3"),
        (lambda: lab.fit(PUMPED, "rollling"), "--structure: unknown 'rollling'; known: rolling"),
        (lab.simulate, "simulate takes a model, or another plant"),
        (lambda: lab.simulate(plant="tanks", input=PUMPED, window=1.0), "window is of the hoop"),
        (lambda: lab.simulate(plant="tanks", input=PUMPED, moving="ball"), "--moving: belongs to the hoop"),
        (lambda: lab.simulate(plant="tanks", input=PUMPED, x0={"h3": 1.0}), "x0: unknown h3; known: h1, h2"),
        (lambda: lab.simulate(plant="tanks", input=([0, 1], {"v": 0.0})), "u of tanks is a mapping of q"),
        (lambda: lab.simulate("hoop", ([0, 1], 0.0), step=3.0), "--step: must be"),
        (lambda: lab.simulate("hoop", ([0, 1], 0.0), moving="all"), "--moving: unknown 'all'"),
        (lambda: lab.experiment("steps", plant="axis", centring=0.01), "--centring: is of the device"),
        (lambda: lab.experiment("steps", plant="axis", rig="thesis"), "rig is of the hoop"),
        *(
            (call, "has q, h1, h2 and no u, theta, psi: no recording of the hoop")
            for call in (
                lambda: lab.fit(PUMPED),
                lambda: lab.simulate("hoop", PUMPED),
                lambda: lab.diagnose(PUMPED),
                lambda: lab.design("arx", "hoop", recording=PUMPED),
            )
        ),
        (lambda: lab.linearize(lab.model("hoop"), "phi"), "outputs must be"),
        (lambda: lab.linearize(lab.model("hoop"), delay=2), "give sample_time too"),
        (lambda: lab.linearize(lab.model("hoop"), top=True, psi=0.1), "nothing beside it"),
        (lambda: lab.design("pidd", lab.model("hoop")), "unknown law 'pidd'; known: lqg"),
        (lambda: lab.design("pid", "hoop", at={"x": 1.0}), "at and steer are of other plants"),
        (lambda: lab.design("lqg"), "design takes a model, or another plant"),
        (lambda: lab.design("lqg", plant="axis", omega=3.0), "--omega: is of the hoop's laws"),
        (lambda: lab.design("lqg", plant="axis", method="zoh"), "method are of the hoop's laws"),
        (lambda: lab.linearize(plant="axis", psi=0.1), "are of the hoop"),
        (lab.linearize, "linearize takes a model"),
        (lambda: lab.linearize("hoop", at={"x": 1.0}), "at is of other plants"),
        (lambda: lab.linearize(plant="axis", at={"y": 1.0}), "y: unknown; known: F, x, dx"),
        (lambda: lab.linearize(lab.model("hoop"), plant="axis"), "knows its plant"),
        (lambda: lab.design("pid", lab.model("hoop"), omega=-3), "omega_rad_s: must be above"),
        (lambda: lab.design("lqg", lab.model("hoop"), weights={"psi": 0}), "numbers above 0"),
        (lambda: lab.design("arx", lab.model("hoop")), "goes with the law arx"),
        (lambda: lab.controller("pidd"), "shipped are only arx, lead, lqg, pid"),
        (lambda: lab.feedback(lab.model("hoop"), "lqg", delay=2), "delay must be"),
        (lambda: lab.feedback(lab.model("hoop"), "lqg", duration=0), "duration must be"),
        (lambda: lab.load("run.csv", age={"phi": 0.03}), "age: unknown phi; known: psi, y"),
        (lambda: lab.experiment("noise"), "unknown kind"),
        (lambda: lab.experiment("prbs", amplitude=9), "outside 0 to the limit"),
        (lambda: lab.plot(3), "plot takes"),
        (lambda: lab.experiment("prbs", duration=5, amplitude=0.3), "^experiment: ball angle .* beyond 1.25$"),
        (lambda: lab.design("pid", "hoop", omega="10"), "omega must be a number, not '10'"),
        (lambda: lab.feedback("hoop", 3), "a law is a design"),
        (lambda: lab.feedback(3, "lqg"), "expected a model"),
        (lambda: lab.feedback("hoop", "lqg", reference=float("nan")), "reference must be"),
        (lambda: lab.feedback("hoop", "lqg", psi0=float("inf")), "psi0 must be"),
        (
            lambda: lab.simulate(lab.model("thesis").with_parameters(J22=50.0), (np.arange(9.0), 0.1), {"psi": 1}),
            "bound",
        ),
    ],
)
def test_a_wrong_argument_is_one_clear_line(call, words):
    with pytest.raises(ValueError, match=words):
        call()


# ---------------------------------------------------------------------------------------------- recordings


def test_an_experiment_is_the_recording_that_it_wrote(recording, tmp_path):
    path = tmp_path / "copy.mcap"
    lab.save(recording, path)
    cut = lab.load(f"{path}@2:4")
    assert np.array_equal(cut.theta, between(lab.load(path), 2.0, 4.0).theta)
    assert 0.05 <= np.nanmax(np.abs(recording.u)) <= 0.3


def test_a_recording_is_told_how_old_its_samples_are(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,u,theta,dtheta,psi\n" + "".join(f"{0.02 * k:.2f},0,0,0,0\n" for k in range(9)))
    aged = lab.load(path, age={"psi": 0.03})
    assert np.array_equal(aged.psi_t, aged.t - 0.03) and np.array_equal(aged.y_t, aged.t)
    with pytest.raises(ValueError, match="psi must be 0 to 1 s, not 30"):
        lab.load(path, age={"psi": 30})


def test_the_same_seed_gives_the_same_experiment(recording):
    again = lab.experiment("prbs", duration=6, seed=1)
    np.testing.assert_array_equal(again.u, recording.u)
    np.testing.assert_array_equal(again.psi, recording.psi)


def test_an_option_that_the_command_does_not_have_is_refused():
    with pytest.raises(TypeError, match="colour"):
        lab.experiment("prbs", colour="red")


# ---------------------------------------------------------------------------------------------- simulate, fit


def test_simulate_is_the_free_run_and_its_score(recording, thesis):
    run = lab.simulate(thesis, recording, x0={"psi": 0.1})
    plain = score(Subject("entries", thesis.parameters), recording, start={"psi": 0.1}, moving="both")
    assert run.fit == plain.nrmse_percent
    np.testing.assert_array_equal(run.states, plain.runs[0].states)
    assert len(run.t) == len(run.states)


def test_a_torque_may_be_rows_a_number_or_a_function(thesis):
    t = np.arange(0.0, 1.0, 0.02)
    rows = lab.simulate(thesis, (t, np.sin(t)), x0=(0, 0, 0.1, 0))
    function = lab.simulate(thesis, (t, np.sin), x0={"psi": 0.1})
    np.testing.assert_array_equal(rows.states, function.states)
    assert rows.fit == {}
    plant = thesis.plant
    np.testing.assert_allclose(rows.states[1], plant.advance((0, 0, 0.1, 0), 0.0, 0.02), atol=1e-7)


def test_a_simulation_is_a_recording_that_a_fit_takes(thesis):
    run = lab.simulate(thesis, (np.arange(0, 6, 0.02), lambda t: 0.1 * np.sign(np.sin(5 * t))), x0={"psi": 0.3})
    found = lab.fit(run.recording).model.parameters
    for name in ("J11", "K1", "L1", "J22", "K2", "L2"):
        assert found[name] == pytest.approx(thesis.parameters[name], rel=0.02)


def test_fit_is_the_fit_of_the_room(recording):
    fitted = lab.fit([recording], "rolling", fix=["mb", "Ro", "Rb"])
    nominal = lab.model("hoop").parameters
    fixed = {name: nominal[name] for name in ("mb", "Ro", "Rb")}
    plain = fit_parameters([recording], nominal, FitSettings(structure="rolling", fixed=fixed))
    assert fitted.fit.values == plain.values
    assert fitted.intervals == plain.intervals
    assert any("mb" in text for text in fitted.words)
    assert all(name in fitted.table() for name in ("Ih", "bh", "["))


# ---------------------------------------------------------------------------------------------- another plant


def test_another_plant_is_played_fitted_and_simulated_by_the_same_names(tmp_path):
    run = lab.experiment("steps", plant="axis", duration=2, amplitude=60.0, file=tmp_path / "steps.mcap")
    plant = lab.plant("axis")
    start = replace(plant, values={**plant.values, "M": 1.3 * plant.values["M"]})
    fitted = lab.fit(run, plant=start, free="M")
    assert fitted.values["M"] == pytest.approx(plant.values["M"], rel=1e-6)
    assert fitted.model.values["M"] == fitted.values["M"] == fitted.model.file.parameters["M"].value
    again = lab.simulate(fitted.model, run)
    assert again.percent["x"] == pytest.approx(100.0, abs=1e-3)
    assert lab.linearize(fitted.model).poles == pytest.approx(lab.linearize(plant="axis").poles, abs=1e-6)
    coarse = lab.simulate(plant="axis", input=run, x0=[0.0, 0.0], step=0.05)
    assert coarse.run.percent != lab.simulate(plant="axis", input=run, x0={}).run.percent
    known = lab.fit(run, plant="axis", free="M", prior={"M": (80.0, 1e-9)})
    assert known.values["M"] == pytest.approx(80.0, rel=1e-6)


def test_former_names_do_as_the_new_ones_and_say_so():
    with pytest.warns(DeprecationWarning, match=r"lab.fit\(..., plant=PLANT\)"):
        fitted = lab.fit_plant("tanks", PUMPED, free=())
    assert fitted.intervals == {} and fitted.values == lab.plant("tanks").values
    with pytest.warns(DeprecationWarning, match="lab.simulate"):
        run = lab.simulate_plant("tanks", PUMPED, {"h1": 0.1})
    assert run.percent == lab.simulate(plant="tanks", input=PUMPED, x0={"h1": 0.1}).percent
    with pytest.warns(DeprecationWarning, match="torque is now input"):
        lab.simulate("hoop", torque=([0, 1], 0.0))


# ---------------------------------------------------------------------------------------------- linear, design


def test_linearize_is_python_controls_system(thesis):
    linear = lab.linearize(thesis, outputs=("psi", "theta"))
    plain = linear_model(thesis.plant, outputs=("psi", "theta"))
    np.testing.assert_array_equal(linear.system.A, plain.A)
    assert linear.system.output_labels == ["psi", "theta"]
    assert linear.controllability.full
    assert linear.observability.full
    assert not lab.linearize(thesis).observability.full  # the hoop angle
    assert linear.step_info is None or "SettlingTime" in linear.step_info


def test_margins_lose_phase_with_delay(thesis):
    linear, pid = lab.linearize(thesis), lab.design("pid", thesis, delay=0.0).numbers
    c = control.tf([pid["kd"], pid["kp"], pid["ki"]], [pid["filter_s"], 1.0, 0.0])
    fresh, late = linear.margins(c), linear.margins(c, delay=0.02)
    assert fresh.stable
    lost = fresh.gain_crossovers[-1].w_rad_s * 0.02
    assert late.phase_rad == pytest.approx(fresh.phase_rad - lost, abs=1e-6)


def test_design_is_the_law_of_the_room(thesis):
    made = lab.design("lqg", thesis, weights={"psi": 0.1})
    plain = design_lqg(thesis.plant, Spec(weights=Weights(psi_rad=0.1)))
    assert made.controller_file.gains == plain.gains
    assert made.margins == margins(plain.loop)
    assert made.stable


def test_a_saved_law_is_what_the_daemon_loads(thesis, tmp_path):
    mine = thesis.with_parameters(K2=-80.0)
    law = lab.design("lqg", mine)
    with pytest.raises(ValueError, match="save the model first"):
        law.save(tmp_path / "law.yaml")
    saved = lab.design("lqg", mine.save(tmp_path / "mine.yaml")).save(tmp_path / "law.yaml")
    assert load_controller(saved.path).gains == law.controller_file.gains
    again = lab.controller(tmp_path / "law.yaml")
    assert again.model.parameters == mine.parameters
    assert again.controller_file.model == "mine.yaml"


def test_an_unstable_design_can_be_looked_at_and_is_never_written(thesis, tmp_path):
    late = lab.design("pid", thesis, omega=10, mt=1.25, delay=0.05)
    assert not late.stable
    with pytest.raises(ValueError, match="unstable"):
        late.save(tmp_path / "late.yaml")
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------------------------------------- closed loop


def test_feedback_is_the_trial_of_the_room(thesis):
    law = lab.design("lqg", thesis)
    made = lab.feedback(thesis, law, psi0=0.3, delay=0.04, duration=2.0, seed=4)
    scenario = Scenario(duration_s=2.0, psi0_rad=0.3, seed=4, **picture_timing(0.04, 0.02))
    plain = closed(law.controller_file, thesis.plant, thesis.plant, scenario)
    np.testing.assert_array_equal(made.states, plain.x)
    np.testing.assert_array_equal(made.u, plain.u)


def test_the_filter_knows_the_designs_model_and_the_plant_is_the_other(thesis):
    law = lab.design("lqg", thesis)
    own = lab.feedback(thesis, law, psi0=0.3, duration=2.0)
    other = lab.feedback(thesis.with_parameters(K2=-60.0), law, psi0=0.3, duration=2.0)
    assert np.abs(own.psi - other.psi).max() > 0.005


def test_a_reference_is_held_as_number_and_as_function(thesis):
    law = lab.design("lqg", thesis)
    number = lab.feedback(thesis, law, reference=0.05, duration=1.0)
    function = lab.feedback(thesis, law, reference=lambda t: 0.05, duration=1.0)
    np.testing.assert_array_equal(number.psi, function.psi)


def test_the_daemon_runs_a_law_on_the_rig(thesis):
    recording = lab.daemon(lab.design("lqg", thesis), duration=4.0, psi0=0.3)
    assert np.nanmax(np.abs(recording.psi)) > 0.25
    assert np.nanmax(np.abs(recording.psi[-25:])) < 0.05
    with pytest.raises(ValueError, match=r"sim\.wind"):
        lab.daemon("lqg", sim__wind=3)


def test_the_daemon_is_asked_for_a_reference_and_has_a_wrong_zero():
    held = lab.daemon("lqg", duration=9.0, reference=0.03, sim__psi_noise_rad=0.0)
    assert np.nanmean(between(held, 8.0, 9.0).psi) == pytest.approx(0.03, abs=0.005)
    pid = lab.design("pid", lab.model("hoop"))  # the shipped one is the thesis's: unstable with late pictures
    wrong = lab.daemon(pid, duration=9.0, zero_angle=0.02)
    assert np.nanmean(between(wrong, 8.0, 9.0).dtheta) < -2.0  # the hoop runs away from under the ball


# ---------------------------------------------------------------------------------------------- pictures


def test_a_name_is_a_model_everywhere(thesis):
    np.testing.assert_array_equal(lab.linearize("thesis").system.A, lab.linearize(thesis).system.A)
    assert lab.design("lqg", "thesis").controller_file == lab.design("lqg", thesis).controller_file
    assert lab.feedback("thesis", "lqg", duration=0.2).t[-1] == pytest.approx(0.18)


def test_whatever_is_printed_is_one_line(recording, thesis):
    law = lab.design("pid", thesis)
    things = [recording, thesis, law, lab.fit(recording), lab.simulate(thesis, recording)]
    things += [lab.feedback(thesis, law, duration=0.2), lab.simulate(thesis, ([0, 1], 0.0))]
    for thing in things:
        assert len(repr(thing)) < 200
        assert "\n" not in repr(thing)
    assert repr(recording).endswith("s, u, theta, dtheta, current, psi)")


def test_a_prior_is_a_value_and_its_width(recording):
    with pytest.raises(ValueError, match="prior: mb needs"):
        lab.fit(recording, "rolling", prior={"mb": 0.06})
    fitted = lab.fit(recording, "rolling", prior={name: (value, 1e-6) for name, value in TABLE.items()})
    for name, value in TABLE.items():
        assert fitted.model.parameters[name] == pytest.approx(value, rel=1e-4)


def test_one_name_is_a_name_and_not_its_letters(recording):
    assert set(lab.fit(recording, "rolling", free="bh").intervals) == {"bh"}
    assert lab.fit(recording, fix="K2", channels="psi").model.parameters["K2"] == lab.model("thesis").parameters["K2"]


@pytest.mark.proof
def test_everything_can_be_looked_at(recording, thesis, tmp_path):
    fitted = lab.fit(recording)
    law = lab.design("pid", thesis)
    run = lab.feedback(thesis, law, disturbance=0.2, duration=1.0)
    pictures = [
        lab.plot(recording),
        lab.plot({"pid": run, "again": run}),
        lab.simulate(thesis, recording).plot(),
        fitted.plot(),
        fitted.plot_intervals(thesis),
        lab.linearize(thesis).plot("bode"),
        law.plot(),
        lab.plot(run),
        lab.plot({"a": recording, "b": recording}),
    ]
    for index, picture in enumerate(pictures):
        assert picture.save(tmp_path / f"{index}.png").stat().st_size > 5000
    assert pictures[1]._repr_png_().startswith(b"\x89PNG")
    assert isinstance(pictures[1].save(str(tmp_path / "text.svg")), Path)


def test_a_diagnosis_takes_one_thread_whatever_imported_numpy_before(monkeypatch: pytest.MonkeyPatch) -> None:
    threads: list[int] = []

    def looked_at(*_: object) -> None:
        threads.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        raise KeyboardInterrupt

    monkeypatch.setattr("hoopd.lab.diagnosis.searched", looked_at)
    t = 0.02 * np.arange(400)
    run = lab.Recording(t, u=0.1 * np.sin(3 * t), theta=np.sin(t), dtheta=np.cos(t), psi=0.1 * np.sin(7 * t))
    with threadpool_limits(limits=2, user_api="blas"), pytest.raises(KeyboardInterrupt):
        lab.diagnose(run)
    assert threads and set(threads) == {1}
