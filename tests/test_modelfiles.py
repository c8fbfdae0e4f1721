"""Model and controller files: what ships loads, what is wrong is one clear line."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.excitation import Excitation
from hoopd.core.late import LateEstimator
from hoopd.files.controller import controller_of, estimator_of, limiter_of, load_controller, parse_controller
from hoopd.files.model import model_text
from hoopd.files.reading import InputError
from hoopd.plants.found_effects import EffectError, checked
from hoopd.plants.hoop.loop.writeback import cancelled, estimator_with, filter_effects, unused
from hoopd.plants.model_file import effects_of, effects_plant, load_model, parse_model, plant_of

CONFIG = Path(__file__).resolve().parents[1] / "config"


@pytest.mark.parametrize("path", sorted((CONFIG / "models").glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_models_load(path: Path) -> None:
    model = load_model(path)
    assert plant_of(model).structure == model.structure
    assert model.device.values()["mb"] == pytest.approx(0.0608)


@pytest.mark.parametrize("path", sorted((CONFIG / "controllers").glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_controllers_load(path: Path) -> None:
    file = load_controller(path)
    plant = plant_of(load_model(CONFIG / file.model))
    assert estimator_of(file, plant).settings.gate_nis == 25.0
    assert limiter_of(file).torque_nm == 0.7
    controller_of(file).reset()


MODEL_MISTAKES = [
    (("schema",), "hoopd.model/2", "schema"),
    (("structure",), "sliding", "structure"),
    (("parameters", "Ib", "unit"), "g cm^2", "wrong unit 'g cm^2': this parameter is in kg m^2"),
    (("parameters", "Ib", "value"), -1e-6, "parameters.Ib: must be positive"),
    (("parameters", "Ib", "ci95"), [1.0, 2.0], "parameters.Ib.ci95"),
    (("parameters", "Ic"), {"value": 1.0, "unit": "kg"}, "parameters.Ic: not a parameter of the rolling model"),
    (("device", "ball_mass_kg"), -0.06, "device.ball_mass_kg: must be positive"),
    (("device", "ball_mass_kg"), "60 mm", "device.ball_mass_kg: wrong unit 'mm'"),
    (("device", "torque_limit_nm"), 0.0, "device.torque_limit_nm: must be above 0"),
    (("device", "mass"), 1.0, "device.mass: unknown key"),
    (("sample_time_s",), 0.0, "sample_time_s"),
]


@pytest.mark.parametrize(("keys", "value", "message"), MODEL_MISTAKES, ids=lambda item: str(item)[:30])
def test_mistakes_in_a_model_are_one_line_with_file_and_key(keys: tuple[str, ...], value: object, message: str) -> None:
    check(parse_model, (CONFIG / "models" / "hoop.yaml").read_text(), keys, value, message)


def test_a_missing_parameter_is_named() -> None:
    data = yaml.safe_load((CONFIG / "models" / "hoop.yaml").read_text())
    del data["parameters"]["bh"]
    with pytest.raises(InputError, match=r"m\.yaml: parameters\.bh: missing"):
        parse_model(yaml.safe_dump(data), "m.yaml")


CONTROLLER_MISTAKES = [
    (("kind",), "fuzzy", "kind"),
    (("gains", "k_phi"), 1.0, "gains: missing [], unknown ['k_phi']"),
    (("gains", "k_psi"), "much", "gains: k_psi must be a finite number"),
    (("limits", "torque_nm"), 1.5, "limits.torque_nm: must be above 0 and at most 0.7"),
    (("limits", "slew_nm_per_tick"), 0.0, "limits.slew_nm_per_tick"),
    (("estimator", "r_psi"), 0.0, "estimator: r_psi must be above zero"),
    (("estimator", "horizon_s"), 30.0, "estimator.horizon_s: must be above 0 and at most 1"),
    (("estimator", "reacquire_after"), 1, "estimator.reacquire_after: must be at least 2"),
    (("estimator", "gate_nis"), 1e6, "estimator.gate_nis: times r_psi: a picture is believed 4 rad off"),
    (("estimator", "r_psi"), 1.0, "estimator.gate_nis: times r_psi: a picture is believed 5 rad off"),
    (("estimator", "q"), [1.0, 2.0], "estimator.q"),
]


@pytest.mark.parametrize(("keys", "value", "message"), CONTROLLER_MISTAKES, ids=lambda item: str(item)[:30])
def test_mistakes_in_a_controller_are_one_line(keys: tuple[str, ...], value: object, message: str) -> None:
    check(parse_controller, (CONFIG / "controllers" / "lqg.yaml").read_text(), keys, value, message)


ARX_MISTAKES = [
    (("gains", "b"), [1.0, 2.0], "gains: a must have shape (2, 2)"),
    (("gains", "feedback"), [[1.0]], "gains: feedback must be a list of finite numbers"),
    (("gains", "c"), [[1.0], [1.0, 2.0]], "gains: c must be a table of numbers"),
]


@pytest.mark.parametrize(("keys", "value", "message"), ARX_MISTAKES, ids=lambda item: str(item)[:30])
def test_matrices_that_do_not_fit_are_refused(keys: tuple[str, ...], value: object, message: str) -> None:
    check(parse_controller, (CONFIG / "controllers" / "arx.yaml").read_text(), keys, value, message)


EXCITATION = """
schema: hoopd.controller/1
name: table
kind: excitation
estimator: {q: [1.0e-8, 4.0, 1.0e-6, 0.1], r_theta: 1.9609142e-7, r_dtheta: 0.0025, r_psi: 1.6e-5}
gains:
  table_nm: [0.05, -0.05, 0]
  torque_nm: 0.3
  hoop_speed_rad_s: 45
  ball_angle_rad: 1.25
"""
EXCITATION_MISTAKES = [
    (("gains", "table_nm"), [], "gains: Expected `array` of length >= 1"),
    (("gains", "table_nm"), [0.1, "much"], "gains: Expected `float`"),
    (("gains", "table_nm"), [0.1, float("nan")], "gains: the table needs finite torques"),
    (("gains", "table_nm"), [0.31], "gains: the table asks for more than the limit of 0.3 N m"),
    (("gains", "torque_nm"), 0.8, "gains: Expected `float` <= 0.7"),
    (("gains", "hoop_speed_rad_s"), float("nan"), "must be a finite number"),
    (("gains", "ball_angle_rad"), float("nan"), "must be a finite number"),
    (("gains", "centring_nm_per_rad_s"), float("nan"), "must be a finite number"),
    (("gains", "table"), [0.1], "gains: Object contains unknown field `table`"),
    (("gains", "around"), {"kind": "excitation", "gains": {}}, "gains: Invalid enum value 'excitation'"),
    (("gains", "around"), {"kind": "lqg", "gains": {"k_psi": 1.0}}, "gains: missing ['k_dpsi', 'k_dtheta']"),
]


def test_an_excitation_with_and_without_a_holding_law() -> None:
    law = controller_of(parse_controller(EXCITATION, "x.yaml"))
    assert isinstance(law, Excitation) and law.around is None and law.torques_nm == [0.05, -0.05, 0.0]
    data = yaml.safe_load(EXCITATION)
    data["gains"]["around"] = {"kind": "pid", "gains": {"b": [1.0], "a": [1.0]}}
    held = controller_of(parse_controller(yaml.safe_dump(data), "x.yaml"))
    assert isinstance(held, Excitation) and held.around is not None


@pytest.mark.parametrize(("keys", "value", "message"), EXCITATION_MISTAKES, ids=lambda item: str(item)[:30])
def test_mistakes_in_an_excitation_are_one_line(keys: tuple[str, ...], value: object, message: str) -> None:
    check(parse_controller, EXCITATION, keys, value, message)


def check(parse: object, text: str, keys: tuple[str, ...], value: object, message: str) -> None:
    data = yaml.safe_load(text)
    place = data
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = value
    with pytest.raises(InputError) as error:
        parse(yaml.safe_dump(data), "x.yaml")  # type: ignore[operator]
    assert str(error.value).startswith("x.yaml: ") and message in str(error.value)
    assert "\n" not in str(error.value)


# ------------------------------------------------------------------------------------------ effects

FRICTION = "{name: hoop.coulomb_friction, parameters: {Fc: {value: 0.008, unit: N m}}}"


@pytest.mark.parametrize(
    ("entries", "key"),
    [
        ("{name: hoop.rust}", "effects[0].name"),
        (f"{FRICTION}, {FRICTION}", "effects[1].name"),
        (FRICTION.replace("0.008", "8"), "effects[0].parameters.Fc"),
        (FRICTION.replace("N m", "N"), "effects[0].parameters.Fc.unit"),
        (FRICTION.replace("Fc", "F"), "effects[0].parameters.F"),
        ("{name: hoop.coulomb_friction}", "effects[0].parameters"),
        (FRICTION.replace("N m}}", "N m, ci95: [0.1, 0.2]}}"), "effects[0].parameters.Fc.ci95"),
        (FRICTION.replace("N m}}", "N m}}, valid: {speed: [0, 1]}"), "effects[0].valid.speed"),
        (FRICTION.replace("N m}}", "N m}}, valid: {dtheta: [1, 0]}"), "effects[0].valid.dtheta"),
    ],
)
def test_an_effect_that_cannot_be_meant_is_one_line(entries: str, key: str) -> None:
    text = (CONFIG / "models" / "hoop.yaml").read_text().replace("effects: []", f"effects: [{entries}]")
    with pytest.raises(InputError) as raised:
        parse_model(text, "m.yaml")
    assert raised.value.key == key and "\n" not in str(raised.value)


def test_effects_keep_their_numbers_and_what_is_sure_of_them() -> None:
    entry = FRICTION.replace("N m}}", "N m, ci95: [0.006, 0.01]}}, valid: {dtheta: [-5, 5]}")
    text = (CONFIG / "models" / "hoop.yaml").read_text().replace("effects: []", f"effects: [{entry}]")
    model = parse_model(text, "m.yaml")
    assert parse_model(model_text(model), "again") == model
    (one,) = effects_of(model).entries
    assert one.parameters == {"Fc": 0.008} and one.weakened().parameters == {"Fc": 0.006}
    assert one.valid == {"dtheta": (-5.0, 5.0)}


@pytest.mark.parametrize(("interval", "sure"), [(None, 0.0), ([0.3, 0.5], 0.007)])
def test_nothing_is_sure_of_an_effect_whose_phase_was_another_one_in_each_recording(
    interval: list[float] | None, sure: float
) -> None:
    phase = {"value": 0.4, "unit": "rad", "ci95": interval}
    size = {"value": 0.008, "unit": "N m", "ci95": [0.007, 0.009]}
    file = yaml.safe_load((CONFIG / "models" / "hoop.yaml").read_text())
    file["effects"] = [{"name": "hoop.imbalance", "parameters": {"A": size, "phi": phase}}]
    (one,) = effects_of(parse_model(yaml.safe_dump(file), "m.yaml")).entries
    assert one.parameters["A"] == 0.008
    assert one.weakened().parameters["A"] == sure
    found = effects_of(parse_model(yaml.safe_dump(file), "m.yaml"))
    assert filter_effects(found).names == cancelled(found) == (() if interval is None else ("hoop.imbalance",))
    assert [(name, "phase" in reason) for name, reason in unused(found)] == (
        [("hoop.imbalance", True)] if interval is None else []
    )


def test_an_encoder_whose_eccentricity_has_no_common_phase_is_believed_as_it_reads() -> None:
    size, phase = {"value": 0.02, "unit": "rad", "ci95": [0.01, 0.03]}, {"value": 0.4, "unit": "rad"}
    file = yaml.safe_load((CONFIG / "models" / "hoop.yaml").read_text())
    kept = {}
    for label, ci95 in (("lost", None), ("known", [0.3, 0.5])):
        parameters = {"a": size, "phi": {**phase, "ci95": ci95}}
        file["effects"] = [{"name": "encoder.eccentricity", "parameters": parameters}]
        kept[label] = estimator_with(effects_of(parse_model(yaml.safe_dump(file), "m.yaml")), EkfSettings())
    assert isinstance(kept["lost"], DelayedEkf)
    assert isinstance(kept["known"], LateEstimator)


def test_a_wave_of_any_whole_number_is_read_back() -> None:
    """A mechanism has no list of numbers, as an effect of the library has."""
    plant = effects_plant(load_model(CONFIG / "models/thesis.yaml"))
    assert checked(plant, "hoop.wave_of_theta", {"A": 0.005, "n": 33.0, "phi": 0.1})["n"] == 33.0
    with pytest.raises(EffectError, match=r"whole number, not 33\.5"):
        checked(plant, "hoop.wave_of_theta", {"A": 0.005, "n": 33.5, "phi": 0.1})
