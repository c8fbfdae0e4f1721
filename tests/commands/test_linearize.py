"""`hoopd linearize`: the record, the files it writes, and one line for whatever cannot be used."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from samples import sampled

from hoopd.commands import cli, linearize
from hoopd.commands.linear_tables import of_linearize
from hoopd.commands.options.linearize import LinearizeOptions
from hoopd.plots import linear

MODELS = Path(__file__).resolve().parents[2] / "config" / "models"
THESIS = MODELS / "thesis.yaml"


def run(model: Path, **asked: Any) -> dict[str, Any]:
    """What the command finds."""
    return linearize.run(LinearizeOptions(model=model, **asked))


def command(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """Exit code of `hoopd linearize ARGUMENTS`."""
    monkeypatch.setattr(sys, "argv", ["hoopd", "linearize", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def complex_of(values: list[dict[str, float]]) -> list[complex]:
    return [complex(value["re"], value["im"]) for value in values]


def test_json_holds_the_thesis_s_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "l.json"
    assert command(monkeypatch, "--model", THESIS, "--json", path) == 0
    found: dict[str, Any] = json.loads(path.read_text())
    pair = -0.167663694405211 + 8.579375019784992j
    np.testing.assert_allclose(complex_of(found["poles"]), [0, -0.4816611437370447, pair, pair.conjugate()], atol=1e-12)
    np.testing.assert_allclose(complex_of(found["zeros"]), [0, -0.4727679267190814], atol=1e-12)
    np.testing.assert_allclose(found["transfer_function"]["numerator"], [210.12, 99.338, 0], atol=5e-4)
    np.testing.assert_allclose(found["transfer_function"]["denominator"], [1, 0.81699, 73.795, 35.467, 0], atol=5e-4)
    margins = found["margins"]
    assert margins["phase_margin_deg"] == pytest.approx(1.5704866, abs=1e-7)
    assert margins["phase_margin_rad_s"] == pytest.approx(16.8426461, abs=1e-7)
    assert margins["gain_margin"] is None and margins["closed_loop_stable"] is True
    assert found["bandwidth"]["absolute_rad_s"] == pytest.approx(19.254, abs=5e-4)
    assert found["bandwidth"]["below_dc_rad_s"] == pytest.approx(13.403, abs=5e-4)
    assert found["controllability"]["full"] is True
    assert found["observability"]["full"] is False and found["observability"]["lost"] == ["theta"]
    assert found["minimal"]["unseen"] == ["theta"]
    assert found["state_space"]["states"] == ["theta", "dtheta", "psi", "dpsi"]
    assert found["state_space"]["A"][3][2] == -73.63359905056758
    assert any("no gain margin (infinite)" in note for note in found["notes"])
    shown = capsys.readouterr().out
    assert "phase_margin_deg" in shown and "1.570487" in shown and "-0.1676637 + 8.579375j" in shown
    assert "hoop angle (theta) is not seen from psi" in shown


def test_no_number_of_any_record_is_infinite(tmp_path: Path) -> None:
    requests: list[dict[str, Any]] = [
        {"outputs": ("theta", "psi")},
        {"outputs": ("dtheta",), "held_rad": 0.3},
        {"sample_time_s": 0.02, "delay_samples": 3},
        {"top": True},
    ]
    for request in requests:
        result = run(MODELS / "hoop.yaml", **request)
        json.dumps(result, allow_nan=False)
        assert result["notes"]


def test_a_person_reads_margins_first_and_several_outputs_side_by_side() -> None:
    one, two = (of_linearize(run(THESIS, outputs=outputs)) for outputs in (("psi",), ("psi", "dtheta")))
    keys = list(two)
    firsts = [keys.index(key) for key in ("margins", "poles", "zeros of psi", "zeros of dtheta", "state_space", "step")]
    assert firsts == sorted(firsts) and keys[-1] == "notes"
    assert two["margins"]["gain_margin"] == {"psi": one["margins"]["gain_margin"], "dtheta": None}
    assert one["zeros"] == two["zeros of psi"] and one["poles"] == two["poles"]
    alone = of_linearize(run(THESIS, outputs=("theta", "psi")))  # theta does not settle and has no step
    assert all(row["theta"] is None for row in alone["step"].values())


def test_several_outputs_see_everything_and_each_has_its_figures() -> None:
    result = run(THESIS, outputs=("psi", "theta"))
    assert result["observability"]["full"] and result["detectability"]["detectable"]
    theta = result["further_outputs"]["theta"]
    assert theta["bandwidth"]["dc_gain"] is None and theta["step"] is None
    assert len(theta["zeros"]) == 2 and result["output"] == "psi"


def test_sampled_plant_has_its_delay_as_states_and_margins_in_samples() -> None:
    result = run(THESIS, sample_time_s=0.02, delay_samples=2)
    assert result["state_space"]["states"][4:] == ["torque_2", "torque_1"]
    assert complex_of(result["poles"])[:2] == [0, 0]
    assert result["transfer_function"]["variable"] == "z"
    assert result["margins"]["closed_loop_stable"] is False
    assert result["margins"]["delay_margin_samples"] is None


def test_operating_point_with_a_turning_hoop() -> None:
    result = run(THESIS, turning_rad_s=60.0)
    point = result["operating_point"]
    assert point["dtheta"] == 60.0 and 0.0 < point["psi"] < 0.2 and 0.0 < point["torque"] < 0.1
    assert math.isclose(result["state_space"]["A"][3][2], -73.63359905056758 * math.cos(point["psi"]))
    assert "rolling friction" in result["notes"][0]


def with_effects(folder: Path, *entries: str) -> Path:
    path = folder / "m.yaml"
    path.write_text(THESIS.read_text().replace("effects: []", f"effects: [{', '.join(entries)}]"))
    return path


def test_dry_friction_is_left_out_and_its_describing_value_told(tmp_path: Path) -> None:
    friction = "{name: hoop.coulomb_friction, parameters: {Fc: {value: 0.008, unit: N m}}}"
    result = run(with_effects(tmp_path, friction))
    assert result["effects"]["included"] == [] and result["poles"] == run(THESIS)["poles"]
    assert "hoop.coulomb_friction" in result["notes"][0] and "0.0102 N m s at 1 rad/s" in result["notes"][0]


def test_smooth_effects_enter_the_linear_model(tmp_path: Path) -> None:
    imbalance = "{name: hoop.imbalance, parameters: {A: {value: 0.008, unit: N m}, phi: {value: 0.7, unit: rad}}}"
    gain = "{name: actuator.torque_gain, parameters: {k: {value: 0.5, unit: '-'}}}"
    base, result = run(THESIS)["state_space"], run(with_effects(tmp_path, imbalance, gain))
    point, space = result["operating_point"], result["state_space"]
    # the drive holds it: 0.5 u = A sin phi
    assert point["torque"] == pytest.approx(0.008 * math.sin(0.7) / 0.5)
    assert space["B"][1][0] == pytest.approx(0.5 * base["B"][1][0])
    # d theta''/d theta = -L1 A cos phi
    assert space["A"][1][0] == pytest.approx(-base["B"][1][0] * 0.008 * math.cos(0.7))
    assert space["A"][1][1:] == pytest.approx(base["A"][1][1:])


def test_a_latency_is_a_delay_where_the_model_is_sampled(tmp_path: Path) -> None:
    late = with_effects(tmp_path, "{name: camera.latency, parameters: {d: {value: 0.04, unit: s}}}")
    sampled = run(late, sample_time_s=0.02)
    assert sampled["poles"] == run(THESIS, sample_time_s=0.02, delay_samples=2)["poles"]
    assert any("40 ms of delay" in note for note in run(late)["notes"])
    assert run(late, sample_time_s=0.02, outputs=("dtheta",))["effects"]["delay_s"] == 0.0


def test_what_turns_with_the_hoop_has_no_mean(tmp_path: Path) -> None:
    imbalance = "{name: hoop.imbalance, parameters: {A: {value: 0.008, unit: N m}, phi: {value: 0.7, unit: rad}}}"
    result = run(with_effects(tmp_path, imbalance), turning_rad_s=10.0)
    assert result["state_space"] == run(THESIS, turning_rad_s=10.0)["state_space"]
    assert "mean over the turns" in result["effects"]["left_out"][0]["reason"]


def test_the_page_s_python_runs(capsys: pytest.CaptureFixture[str]) -> None:
    page = (MODELS.parents[1] / "docs" / "explanations" / "linear.md").read_text()
    exec(page.split("```python\n")[1].split("```")[0], {"path": THESIS})
    assert "phase_rad=" in capsys.readouterr().out


@pytest.mark.parametrize("plot", sampled(list(linear.DRAWINGS), ["bode", "nyquist"]))
def test_every_figure_is_drawn(tmp_path: Path, plot: str) -> None:
    run(THESIS, figure=tmp_path / "a.png", plot=plot)
    assert len((tmp_path / "a.png").read_bytes()) > 10_000


@pytest.mark.proof
def test_a_figure_repeats_its_bytes(tmp_path: Path) -> None:
    judge_figure(tmp_path, {"sample_time_s": 0.02, "delay_samples": 2})


@pytest.mark.proof
@pytest.mark.parametrize("extra", [{"outputs": ("theta",)}, {"top": True}])
def test_a_figure_of_other_outputs_and_at_the_top_repeats_its_bytes(tmp_path: Path, extra: dict[str, Any]) -> None:
    judge_figure(tmp_path, extra)


def judge_figure(tmp_path: Path, extra: dict[str, Any]) -> None:
    first, second = tmp_path / "a.png", tmp_path / "b.png"
    for path in (first, second):
        run(THESIS, figure=path, **extra)
    assert first.read_bytes() == second.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--model", "no.yaml"], "no.yaml: no such file or directory"),
        (["--model", THESIS, "--output", "phi"], "--output: must be of theta, dtheta, psi, dpsi, not phi"),
        (["--model", THESIS, "--output", "psi", "--output", "psi"], "--output: an output is named twice"),
        (["--model", THESIS, "--hoop-speed", "1000"], "--hoop-speed: no equilibrium at 1000 rad/s"),
        (["--model", THESIS, "--psi", "nan"], "--psi: must be a finite number"),
        (["--model", THESIS, "--psi", "0.1", "--top"], "--psi: cannot be given together with --top"),
        (["--model", THESIS, "--sample-time", "-1"], "--sample-time: must be between 1e-05 and 3600 s"),
        (["--model", MODELS / "hoop.yaml", "--top", "--sample-time", "10"], "--sample-time: the plant runs away"),
        (["--model", THESIS, "--delay", "2"], "--delay: counts samples: give --sample-time too"),
        (["--model", THESIS, "--sample-time", "0.02", "--delay", "-1"], "--delay: must be 0 to 100 samples"),
        (["--model", THESIS, "--plot", "bode"], "--plot: chooses what --figure shows: give --figure too"),
        (["--model", THESIS, "--figure", "a.gif"], "unknown extension '.gif'"),
        (["--model", THESIS, "--figure", "no/a.png"], "no such folder"),
        (["--model", THESIS, "--figure", "a.png", "--plot", "pie"], "--plot: must be one of overview"),
        (["--model", THESIS, "--json", "no/l.json"], "no/l.json"),
        ([], "Missing option '--model'"),
    ],
    ids=lambda value: value[:24] if isinstance(value, str) else "",
)
def test_what_cannot_be_used_is_one_line_and_exit_code_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[object],
    line: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command(monkeypatch, *arguments) == 2
    shown = capsys.readouterr()
    assert line in shown.err and shown.err.count("\n") == 1
    assert shown.out == ""
    assert not list(tmp_path.iterdir())
