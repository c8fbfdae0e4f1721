"""What changed, by a diagnosis: a parameter, another physics, or a sensor that is broken and never learned."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest
from harness.told_diagnosis import said

from hoopd.diagnose.record import Base, Diagnosis, EffectFinding, Evidence, Quantity
from hoopd.files.model import EffectEntry, Parameter
from hoopd.files.shipped import defaults_folder
from hoopd.heal.change import NOTHING, PARAMETERS, PHYSICS, SENSOR, UNKNOWN, judged, written_changes
from hoopd.plants.model_file import load_model

COUNTED = Evidence(log_likelihood_gain=90.0, threshold=10.0, heldout_gain_percent=None)
TINY = Evidence(log_likelihood_gain=47.0, threshold=10.0, heldout_gain_percent=0.0007)


def found(name: str, sizes: dict[str, float] | None = None, **more: Any) -> Diagnosis:
    """A diagnosis with one confirmed effect."""
    diagnosis = said(0.9)
    parameters = {key: Quantity(value=one, unit="", ci95=None, nominal=0.0) for key, one in (sizes or {}).items()}
    told = {"name": name, "slot": name.partition(".")[0], "parameters": parameters, **more}
    effect: EffectFinding = msgspec.structs.replace(diagnosis.effects[0], **told)
    return msgspec.structs.replace(diagnosis, effects=[effect])


def parameters(**values: tuple[float, float, float]) -> Base:
    """Value, half of the interval, and what it was."""
    return Base(
        model="hoop",
        parameters={
            name: Quantity(value=now, unit="", ci95=(now - half, now + half), nominal=before)
            for name, (now, half, before) in values.items()
        },
    )


def test_a_confirmed_effect_is_new_physics_with_its_sizes() -> None:
    judgement = judged(found("hoop.coulomb_friction", {"Fc": 0.006}), {}, 40.0)
    assert judgement.kind == PHYSICS and judgement.may_be_learned
    assert judgement.effects == {"hoop.coulomb_friction": {"Fc": 0.006}}


def test_a_parameter_that_left_its_interval_is_a_changed_parameter() -> None:
    base = parameters(bh=(1.4e-3, 1e-5, 7e-4), Ih=(1.52e-3, 1e-5, 1.518e-3))
    judgement = judged(said(base=base, verdict="parameters"), {}, 40.0)
    assert judgement.kind == PARAMETERS and judgement.parameters == {"bh": pytest.approx(1.0)}
    assert judged(said(base=parameters(bh=(7.05e-4, 1e-6, 7e-4))), {}, 40.0).kind == NOTHING


@pytest.mark.parametrize(("radius", "kind"), [(0.113, SENSOR), (0.080, SENSOR), (0.098, PARAMETERS)])
def test_a_length_that_seems_to_change_is_a_camera_that_sees_it_wrong(radius: float, kind: str) -> None:
    base = parameters(mb=(0.127, 1e-3, 0.0608), Ro=(radius, 1e-4, 0.0957))
    metres = {**base.parameters, "Ro": msgspec.structs.replace(base.parameters["Ro"], unit="m")}
    judgement = judged(said(base=Base(model="hoop", parameters=metres), verdict="parameters"), {}, 40.0)
    assert judgement.kind == kind
    assert kind != SENSOR or "no length changes while it runs" in judgement.reason


@pytest.mark.parametrize(
    "name",
    ["camera.outliers", "camera.late_frames", "camera.center_offset", "encoder.harmonic", "actuator.lost_commands"],
)
def test_a_broken_sensor_is_never_learned(name: str) -> None:
    judgement = judged(found(name, {"share": 0.1}, evidence=COUNTED), {}, 40.0)
    assert judgement.kind == SENSOR and not judgement.may_be_learned


@pytest.mark.parametrize(("name", "size"), [("camera.latency", "d"), ("encoder.speed_lag", "T")])
def test_a_delay_is_learned_up_to_60_ms(name: str, size: str) -> None:
    assert judged(found(name, {size: 0.055}), {}, 40.0).kind == PHYSICS
    late = judged(found(name, {size: 0.065}), {}, 40.0)
    assert late.kind == SENSOR and "65 ms is more than 60 ms" in late.reason


@pytest.mark.parametrize(
    ("faults", "kind"),
    [
        ({"ball_missing": 0.5}, PHYSICS),  # of 40 s: an accident
        ({"ball_missing": 2.0}, SENSOR),
        ({"camera_late": 2.0}, SENSOR),
        ({"ball_lost": 0.2}, SENSOR),  # took the torque away
        ({"speed_implausible": 0.02}, SENSOR),
        ({"overrun_persistent": 5.0, "model_drift": 40.0}, PHYSICS),  # of the computer, and what was asked about
    ],
)
def test_what_a_fault_row_names_stops_learning(faults: dict[str, float], kind: str) -> None:
    assert judged(found("hoop.coulomb_friction", {"Fc": 0.006}), faults, 40.0).kind == kind


def test_what_is_not_sure_or_has_no_law_is_left() -> None:
    assert judged(found("hoop.coulomb_friction", status="weak"), {}, 40.0).kind == NOTHING
    assert judged(found("hoop.coulomb_friction", in_model=False), {}, 40.0).kind == NOTHING
    assert judged(found("unknown.hoop"), {}, 40.0).kind == UNKNOWN
    assert judged(said(), {}, 40.0).kind == NOTHING


def test_a_correction_beside_the_change_is_no_change() -> None:
    friction, late = (found(*one).effects[0] for one in (("hoop.coulomb_friction",), ("encoder.latency", {"d": 7e-5})))
    late = msgspec.structs.replace(late, evidence=TINY)
    judgement = judged(said(effects=[friction, late]), {}, 40.0)
    assert judgement.kind == PHYSICS and list(judgement.effects) == ["hoop.coulomb_friction"]
    # beside a changed parameter it is none, either
    base = parameters(Ih=(2.0e-3, 1e-5, 1.5e-3))
    assert judged(said(effects=[late], base=base, verdict="missing_physics"), {}, 40.0).kind == PARAMETERS


def test_a_changed_parameter_is_told_with_its_new_size() -> None:
    base = Base(
        model="hoop",
        parameters={"hoop.coulomb_friction.Fc": Quantity(value=0.5, unit="N m", ci95=(0.499, 0.501), nominal=0.01)},
    )
    judgement = judged(said(base=base, verdict="parameters"), {}, 40.0)
    assert judgement.values == {"hoop.coulomb_friction.Fc": 0.5}


@pytest.mark.parametrize(
    ("name", "unit", "before", "now", "kind"),
    [
        ("camera.latency.d", "s", 0.02, 0.3, SENSOR),
        ("camera.latency.d", "s", 0.02, 0.05, PARAMETERS),
        ("encoder.harmonic.a", "rad", 0.02, 0.3, SENSOR),
        ("actuator.lost_commands.share", "", 0.01, 0.1, SENSOR),
        ("hoop.coulomb_friction.Fc", "N m", 0.01, 0.02, PARAMETERS),
    ],
)
def test_a_sensor_that_breaks_is_not_learned_where_the_model_has_its_effect(
    name: str, unit: str, before: float, now: float, kind: str
) -> None:
    changed = Quantity(value=now, unit=unit, ci95=(0.99 * now, 1.01 * now), nominal=before)
    base = Base(model="hoop", parameters={name: changed})
    assert judged(said(base=base, verdict="parameters"), {}, 40.0).kind == kind


def test_a_model_tells_every_number_that_it_changes_whatever_its_interval() -> None:
    shipped = load_model(defaults_folder() / "models" / "hoop.yaml")
    friction = EffectEntry(name="hoop.coulomb_friction", parameters={"Fc": Parameter(value=0.01, unit="N m")})
    before = msgspec.structs.replace(shipped, effects=[friction])
    bh, ih = shipped.parameters["bh"], shipped.parameters["Ih"]
    grown = {"bh": 1.6 * bh.value, "Ih": 1.01 * ih.value}
    moved = {name: msgspec.structs.replace(shipped.parameters[name], value=one) for name, one in grown.items()}
    after = msgspec.structs.replace(shipped, parameters={**shipped.parameters, **moved})
    told = written_changes(before, after)
    assert told.shares == {"bh": pytest.approx(0.6), "hoop.coulomb_friction.Fc": -1.0}
    assert told.values == {**grown, "hoop.coulomb_friction.Fc": 0.0}
    assert written_changes(before, before) == written_changes(shipped, before)


def test_what_was_0_has_no_share_that_a_file_could_not_keep() -> None:
    shipped = load_model(defaults_folder() / "models" / "hoop.yaml")
    before, after = (
        msgspec.structs.replace(
            shipped,
            effects=[EffectEntry(name="hoop.coulomb_friction", parameters={"Fc": Parameter(value=one, unit="N m")})],
        )
        for one in (0.0, 0.01)
    )
    told = written_changes(before, after)
    assert told.shares == {"hoop.coulomb_friction.Fc": None} == msgspec.json.decode(msgspec.json.encode(told.shares))
    judgement = judged(said(base=parameters(bh=(0.01, 0.001, 0.0)), verdict="parameters"), {}, 40.0)
    assert judgement.kind == PARAMETERS and judgement.reason == "changed: bh from 0"
    assert judgement.parameters == {"bh": None}
