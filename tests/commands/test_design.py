"""`hoopd design`: from a model to a file that the daemon loads and that holds the ball."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness.rigrun import run_rig
from samples import sampled
from shared import shared_path

from hoopd.commands import cli, design as command
from hoopd.commands.design_effects import sentence
from hoopd.commands.design_options import poles_from, spec_from, weights_from
from hoopd.commands.linear_tables import of_design
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.output import table_rows
from hoopd.daemon.build import build_tick, mismatch, read_texts
from hoopd.design.arx_law import arriving
from hoopd.design.gang_of_four import noise_gain
from hoopd.design.laws import LAWS, Spec
from hoopd.design.margins import margins
from hoopd.design.weights import Weights
from hoopd.files.controller import controller_of, load_controller
from hoopd.files.reading import InputError
from hoopd.plants.effects.library import library
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.loop.closed_loop import LinearPlant, Scenario, picture_timing
from hoopd.plants.hoop.loop.trial import Trial, trial
from hoopd.plants.model_file import effects_of, load_model, plant_of
from hoopd.recording.recording import from_columns
from hoopd.shell.config import load as load_config

CONFIG = Path(__file__).resolve().parents[2] / "config"
HOOP, THESIS = CONFIG / "models" / "hoop.yaml", CONFIG / "models" / "thesis.yaml"
SHIPPED_LQG = CONFIG / "controllers" / "lqg.yaml"
BEARING = ("lqg", "lqr", "placement", "pid", "pi")


def run(law: str, model: Path, **asked: Any) -> dict[str, Any]:
    """What the command finds."""
    return command.run(DesignOptions(law=law, model=model, **asked))


@cache
def shipped() -> dict[str, Any]:
    """The shipped model's LQG: asked for once."""
    return run("lqg", HOOP)


@cache
def trial_of_the_shipped() -> Trial:
    """What the nonlinear plant does with the shipped law."""
    model = load_model(HOOP)
    law = load_controller(CONFIG / "controllers" / "lqg.yaml")
    return trial(law, plant_of(model), 0.3, Spec().delay_s)


def untried(law: str, model: Path, **asked: Any) -> dict[str, Any]:
    """The same without the runs of the nonlinear plant, which take most of the time and are judged elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "trial", lambda *of, **more: trial_of_the_shipped())
        return run(law, model, **asked)


def simulated(folder: Path) -> Path:
    """A recording like the old ones: all of a row taken at once, two-level torque."""
    plant, rng = plant_of(load_model(HOOP)), np.random.default_rng(3)
    x, rows = np.zeros(4), []
    for k in range(2500):
        u = 0.06 * rng.choice((-1.0, 1.0)) if k % 3 == 0 else rows[-1][1]
        noise = rng.normal(size=2) * (0.05, 0.002)
        rows.append((0.02 * k, u, x[0], x[1] + noise[0], x[2] + noise[1]))
        x = plant.advance(x, u, 0.02)
    path = folder / "run.csv"
    text = "\n".join(",".join(f"{value:.9g}" for value in row) for row in rows)
    path.write_text(f"t,u,theta,dtheta,psi\n{text}\n")
    return path


def test_a_person_reads_margins_first_and_poles_last(tmp_path: Path) -> None:
    out = tmp_path / "my law.yaml"
    result = run("lqg", HOOP, out=out)
    shown = of_design(result, out)
    order = [key for key in shown if isinstance(shown[key], dict)]
    assert order == ["margins", "closed_loop", "gang_of_four", "gains", "design", "closed_loop_poles"]
    assert shown["closed_loop"]["nonlinear_difference_rad"]["wrong_zero"] is None
    titles = {tuple(one) for one in shown["closed_loop"].values()}
    assert titles == {("disturbed", "released", "wrong_zero")} and table_rows(shown["closed_loop"])
    poles = shown["closed_loop_poles"]
    assert poles["2"]["z"] == "0.88919 +- 0.13473j" and poles["delays"]["z"] == "0, 6 of them"
    assert shown["next"] == f"hoopd --sim --set control.file='{out}'"
    assert "next" not in of_design(result) and "next" not in result


@pytest.mark.parametrize("law", sampled(BEARING, ["lqg", "pid"]))
def test_what_is_written_is_what_the_daemon_loads(tmp_path: Path, law: str) -> None:
    out = tmp_path / "mine.yaml"
    result = untried(law, HOOP, out=out)
    file = load_controller(out)
    assert file.gains == result["gains"] and file.kind == result["kind"] and file.name == "mine"
    controller_of(file)
    config = load_config(None, sim=True, overrides=[f"control.file={out}"])
    texts = read_texts(config, None)
    assert mismatch(config, texts) == "" and texts.model == HOOP.read_text()
    build_tick(config, texts)


def test_default_lqg_is_the_shipped_one(tmp_path: Path) -> None:
    out = tmp_path / "mine.yaml"
    untried("lqg", HOOP, out=out)
    ours, mine = load_controller(CONFIG / "controllers" / "lqg.yaml"), load_controller(out)
    assert mine.estimator == ours.estimator and mine.limits == ours.limits and mine.model == ours.model
    assert mine.gains == pytest.approx(ours.gains, rel=1e-6)


@pytest.mark.parametrize(("law", "bound_s"), sampled([("lqg", 1.5), ("placement", 1.5), ("pid", 3.0)], [("lqg", 1.5)]))
def test_designed_law_holds_the_ball_in_the_rig(tmp_path: Path, law: str, bound_s: float) -> None:
    """Its own model in its own folder, the whole daemon in lock-step on a rig of the same device."""
    model = tmp_path / "fits" / "fitted.yaml"
    model.parent.mkdir()
    model.write_text(HOOP.read_text().replace("name: hoop", "name: fitted"))
    out = tmp_path / "mine.yaml"
    untried(law, model, out=out)
    assert load_controller(out).model == "fits/fitted.yaml"
    made = run_rig(tmp_path / "run", f"control.file={out}", duration_s=8.0)
    assert made.settled_s(made.psi, 0.05) < bound_s


def test_recordings_do_not_tell_where_the_model_lay(tmp_path: Path) -> None:
    (tmp_path / "fits").mkdir()
    (tmp_path / "fits" / "m.yaml").write_text(HOOP.read_text())
    (tmp_path / "laws").mkdir()
    out = tmp_path / "laws" / "mine.yaml"
    untried("lqg", tmp_path / "fits" / "m.yaml", out=out)
    assert load_controller(out).model == "../fits/m.yaml"
    texts = read_texts(load_config(None, sim=True, overrides=[f"control.file={out}"]), None)
    assert "\nmodel: m.yaml\n" in texts.controller and "fits" not in texts.controller


def test_arx_is_designed_from_a_recording(tmp_path: Path) -> None:
    out = tmp_path / "arx.yaml"
    result = untried("arx", HOOP, recording=str(simulated(tmp_path)), out=out)
    assert result["kind"] == "lqg_linear" and result["margins"]["phase_deg"] > 45
    assert result["design"]["innovation_std"]["psi_rad"] == pytest.approx(0.005, rel=0.2)
    made = run_rig(tmp_path / "run", f"control.file={out}", duration_s=8.0)
    assert made.settled_s(made.psi, 0.05) < 1.5


@pytest.mark.parametrize("name", ["meas_hoopAndBall2_01", "meas_hoop01_prbs"])
def test_arx_of_a_real_recording_holds_the_ball_in_the_rig(tmp_path: Path, name: str) -> None:
    """Judged on the thesis's model, run on a rig of the thesis's device; the recorded device is another one."""
    recording = str(shared_path(f"recordings/{name}.mat"))
    out = tmp_path / "arx.yaml"
    result = untried("arx", THESIS, recording=recording, out=out)
    assert result["margins"]["phase_deg"] > 50 and result["margins"]["delay_ms"] > 60
    made = run_rig(tmp_path / "run", f"control.file={out}", "sim.model=models/thesis.yaml", duration_s=8.0)
    assert made.settled_s(made.psi, 0.05) < 2.0


def test_a_recording_that_tells_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="hardly moves"):
        run("arx", THESIS, recording=str(shared_path("recordings/meas_ballOnly01.mat")))


def test_a_file_without_arrival_times_is_made_late() -> None:
    t = 0.02 * np.arange(8)
    rec = from_columns({"t": t, "u": t, "theta": t, "dtheta": t, "psi": t})
    _, y = arriving(rec, Spec(delay_s=0.05))
    assert np.isnan(y[:1, 0]).all() and y[1, 0] == 0.0
    assert np.isnan(y[:3, 1]).all() and y[3, 1] == 0.0
    daemon = from_columns({"t": t, "u": t, "theta": t, "dtheta": t, "psi": t, "psi_t": t - 0.05})
    np.testing.assert_array_equal(arriving(daemon, Spec())[1][:, 1], t)
    with pytest.raises(ValueError, match="resample"):
        arriving(from_columns({"t": 2 * t, "u": t}), Spec())


def with_effect(folder: Path, *entries: str) -> Path:
    model = folder / "m.yaml"
    model.write_text(HOOP.read_text().replace("effects: []", f"effects: [{', '.join(entries)}]"))
    return model


FRICTION = "{name: hoop.coulomb_friction, parameters: {Fc: {value: 0.008, unit: N m}}}"
LATE_CAMERA = "{name: camera.latency, parameters: {d: {value: 0.04, unit: s}}}"
LATE_DRIVE = "{name: actuator.delay, parameters: {d: {value: 0.03, unit: s}}}"
SLIP = "{name: ball.slip, parameters: {mu: {value: 0.1, unit: '-'}}}"


def test_a_law_is_designed_on_what_feed_forward_leaves(tmp_path: Path) -> None:
    plain, found = shipped(), run("lqg", with_effect(tmp_path, FRICTION), out=tmp_path / "found.yaml")
    # of a hoop that friction holds other innovations are normal than of one that moves
    normal, usual = (load_controller(one).estimator.innovations for one in (tmp_path / "found.yaml", SHIPPED_LQG))
    assert normal["dtheta"][1] > 1.5 * usual["dtheta"][1]
    assert found["gains"] == plain["gains"] and found["margins"] == plain["margins"]
    assert found["effects"]["fed_forward"] == found["effects"]["in_the_filter"] == ["hoop.coulomb_friction"]
    released = found["closed_loop"]["released"]
    assert released["psi_settled_s"] < 1.5 and abs(released["end_psi_rad"]) < 0.005
    assert "effects" not in plain
    assert found["summary"] == "Fed forward, so that the law need not act on it: hoop.coulomb_friction."
    assert plain["summary"].startswith("The model names no effects: nothing is fed forward. Dry friction, ")
    assert of_design(found)["notes"][0] == found["summary"]


def count_poles(result: dict[str, Any]) -> int:
    return int(result["delay_poles"]) + len(result["closed_loop_poles"])


def test_delays_of_a_model_are_in_the_loop(tmp_path: Path) -> None:
    plain = shipped()
    late = run("lqg", with_effect(tmp_path, LATE_CAMERA, LATE_DRIVE))
    assert late["delay_s"] == pytest.approx(plain["delay_s"] + 0.04)
    # torques on their way: two ticks in what is seen of the hoop, two and two more in what is seen of the ball
    assert count_poles(late) > count_poles(plain) + 6 and late["margins"]["delay_ms"] > 20.0
    assert late["effects"]["delays_s"] == {"torque_s": 0.03, "camera_s": 0.04, "encoder_s": 0.0}
    assert late["closed_loop"]["released"]["psi_settled_s"] < 1.5
    told = late["summary"]
    assert told.startswith("Nothing is fed forward; ") and "delays (torque 30 ms, pictures 40 ms)" in told


def test_delays_that_no_filter_remembers_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="effects"):
        run("lqg", with_effect(tmp_path, LATE_CAMERA.replace("0.04", "0.2"), LATE_DRIVE))


def test_effects_that_a_daemon_cannot_use_are_named(tmp_path: Path) -> None:
    made = untried("lqg", with_effect(tmp_path, SLIP))
    (warning,) = made["warnings"]
    assert "ball.slip" in warning and "no state" in warning
    assert made["summary"] == "Nothing is fed forward; nothing is done about ball.slip."


def test_the_sentence_has_a_word_on_whatever_effect_a_model_names() -> None:
    base = effects_of(load_model(HOOP))
    for name, effect in library(base.plant).items():
        values = {one.name: one.size or 0.01 for one in effect.parameters}
        said = sentence(FoundEffects(base.structure, base.base, (FoundEffect(name, values),)))
        late = effect.delay or effect.lag or effect.latency
        assert ("reckons with delays" if late else name) in said, name


def test_a_limit_of_the_drive_limits_the_law(tmp_path: Path) -> None:
    limit = "{name: actuator.saturation, parameters: {s: {value: 0.3, unit: N m}}}"
    out = tmp_path / "c.yaml"
    untried("lqg", with_effect(tmp_path, limit), out=out)
    assert load_controller(out).limits.torque_nm == 0.3


# ------------------------------------------------------------------------------------------ the thesis's figures


def test_pid_of_the_thesis_specification_and_what_delay_does_to_it(tmp_path: Path) -> None:
    result = run("pid", THESIS, delay_s=0.0, out=tmp_path / "pid.yaml")
    design = result["design"]
    assert (design["kp"], design["ki"], design["kd"]) == pytest.approx((0.1966659, 2.8154613, 0.0473456), abs=5e-8)
    assert design["peak_complementary"]["value"] == pytest.approx(1.25, abs=1e-9)
    assert result["margins"]["phase_deg"] == pytest.approx(45.7, abs=0.05)
    assert result["warnings"] == []
    disturbed = result["closed_loop"]["disturbed"]
    assert disturbed["psi_settled_s"] < 1.5
    assert abs(result["closed_loop"]["wrong_zero"]["end_hoop_speed_rad_s"]) == pytest.approx(7.4, abs=0.1)
    with pytest.raises(InputError, match=r"unstable with pictures 60 ms old: pole z = 1\.\d+ \+- 0\.\d+j"):
        run("pid", THESIS, omega_rad_s=10, mt=1.25, phase_deg=50, delay_s=0.06, out=tmp_path / "no.yaml")
    assert not (tmp_path / "no.yaml").exists()


def test_lead_settles_without_delay_and_is_refused_with_it(tmp_path: Path) -> None:
    result = run("lead", THESIS, delay_s=0.0)
    np.testing.assert_allclose(result["gains"]["b"], [2.4342806945451483, -1.1514210418177229], rtol=1e-12)
    np.testing.assert_allclose(result["gains"]["a"], [1.0, 0.28285965272742575], rtol=1e-12)
    assert result["closed_loop"]["disturbed"]["psi_settled_s"] < 1.5
    with pytest.raises(InputError, match="unstable"):
        run("lead", THESIS, out=tmp_path / "no.yaml")
    assert list(tmp_path.iterdir()) == []


def test_state_feedback_bears_the_delay_that_a_pid_does_not() -> None:
    lqg, pid = run("lqg", THESIS), untried("pid", THESIS)
    assert lqg["warnings"] == [] and lqg["margins"]["delay_ms"] > 90
    assert any("phase margin" in text for text in pid["warnings"])
    assert pid["margins"]["delay_ms"] < 40
    placed = untried("placement", THESIS, poles="-4,-6+6j,-6-6j")
    found = {round(value, 6) for value in placed["natural_rad_s"]}
    assert {4.0, round(abs(-6 + 6j), 6)} <= found


# ------------------------------------------------------------------------------------------ the command line


def design(*words: str) -> None:
    cli.app(["design", *words], standalone_mode=False)


def test_command_writes_file_figure_and_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From any folder, with a shipped model by its name; the same command makes the same bytes."""
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        words = ["--out", "law.yaml", "--figure", f"{name}.png", "--json", f"{name}.json"]
        design("lqg", "--model", "models/hoop.yaml", "--weights", "psi=0.3,torque=0.1", "--weights", "dtheta=3", *words)
    result: dict[str, Any] = json.loads((tmp_path / "one.json").read_text())
    assert result["design"]["weights"] == {"dtheta_rad_s": 3, "psi_rad": 0.3, "dpsi_rad_s": 1.2, "torque_nm": 0.1}
    assert load_controller(tmp_path / "law.yaml").model == "models/hoop.yaml"
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fuzzy"], "unknown law 'fuzzy'; known: lqg"),
        (["arx"], "--recording"),
        (["pid", "--recording", "x.csv"], "--recording"),
        (["pid", "--mt", "0.9"], "--mt: must be above 1"),
        (["pid", "--delay", "-1"], "--delay: must be from 0"),
        (["placement", "--poles", "-1,-2"], "3 poles are to be placed, not 2"),
        (["placement", "--poles", "1,-2,-3"], "--poles: a stable loop"),
        (["placement", "--poles", "fast"], "--poles: expected complex numbers"),
        (["placement", "--poles", "-1e300,-1e300,-1"], "--poles: at most 1e+06 rad/s"),
        (["lqg", "--weights", "phi=1"], "--weights: expected dtheta="),
        (["lqg", "--figure", "x.bmp"], "unknown extension"),
        (["lqg", "--out", "nowhere/x.yaml"], "no such folder"),
        (["pi", "--omega", "8.7", "--zeta", "0.5"], "adds no damping"),
        (["lag"], "the closed loop is unstable"),
    ],
)
def test_bad_input_is_one_line(words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        design(*words, "--model", str(HOOP))
    assert message in str(caught.value) and "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_options_become_a_specification() -> None:
    assert weights_from([]) == Weights()
    assert poles_from("-6+6j, -6-6i,-1") == (-6 + 6j, -6 - 6j, -1)
    assert spec_from(DesignOptions(law="pid", model=HOOP, lead=(80.0, 5.0), delay_s=0.0)).loop_delay_s == 0.0
    assert Spec(delay_s=0.05).delay_ticks == 3 and Spec(delay_s=0.04).delay_ticks == 2


# ------------------------------------------------------------------------------------------ the trial


def test_picture_timing_gives_the_wanted_age() -> None:
    for delay_s, frames, phase_s in ((0.0, 0, 0.0), (0.02, 1, 0.0), (0.05, 2, 0.01), (0.035, 1, 0.005)):
        timing = picture_timing(delay_s, 0.02)
        assert timing["delay_frames"] == frames and timing["phase_s"] == pytest.approx(phase_s)
        Scenario(**timing)  # type: ignore[arg-type]


def test_linear_plant_is_the_plant_for_small_angles() -> None:
    plant, x = plant_of(load_model(HOOP)), np.array([0.1, 0.2, 1e-4, -1e-3])
    np.testing.assert_allclose(LinearPlant(plant).advance(x, 1e-3, 0.013), plant.advance(x, 1e-3, 0.013), rtol=1e-6)
    far = np.array([0.0, 0.0, 1.0, 0.0])
    assert np.abs(LinearPlant(plant).advance(far, 0.0, 0.02) - plant.advance(far, 0.0, 0.02)).max() > 1e-3


def test_the_page_tells_what_the_command_finds() -> None:
    """Margins, largest |S| and noise of the table in docs/explanations/control_laws.md."""
    text = (CONFIG.parent / "docs" / "explanations" / "control_laws.md").read_text()
    rows, name = [], ""
    for line in text.split("## The same device")[1].split("## ")[0].splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        if len(cells) > 5 and cells[1].endswith(" ms") and "unstable" not in line:
            name = cells[0].strip("`") or name
            rows.append(
                (name, *(float(cell.split()[0]) for cell in (cells[1], cells[2], cells[3], cells[-4], cells[-3])))
            )
    assert len(rows) == 6
    plant = plant_of(load_model(THESIS))
    for law, delay_ms, phase_deg, more_ms, ms, noise in rows:
        made = LAWS[law](plant, Spec(delay_s=delay_ms / 1e3))
        found = margins(made.loop)
        assert np.degrees(abs(found.phase_rad)) == pytest.approx(phase_deg, abs=0.06), law
        assert 1e3 * found.delay_s == pytest.approx(more_ms, abs=0.6), law
        assert found.peak_sensitivity == pytest.approx(ms, abs=0.006), law
        assert noise_gain(made.plant, made.controller, made.loop) == pytest.approx(noise, abs=0.006), law
