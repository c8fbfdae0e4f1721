"""Model files (`hoopd.model/1`) on their plants: read, checked, made into plants and effects with numbers.

Rules of this file: everything wrong in a file is one `InputError`; no equation lives here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hoopd.files.model import EffectEntry, ModelFile, Parameter
from hoopd.files.reading import InputError, parse_yaml, read_text, to_struct
from hoopd.files.records import between
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.found_effects import EffectError, FoundEffect, FoundEffects, check_region, checked, weak_end
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.effects.inner_hoop import INNER_HOOP
from hoopd.plants.hoop.parameters import PARAMETER_UNITS, ParameterError, check_parameters
from hoopd.plants.hoop.plant import HoopPlant

HOOP, PLANT_SCHEMA = "hoop", "hoopd.plant/1"
# No number of such a device is outside of these: a typing error, and products of such numbers leave the computer's.
SMALLEST, LARGEST = 1e-15, 1e12
# Of the hoop's radius, what the ball's centre at least moves on: the swing's frequency has it in the denominator.
LEAST_TRACK = 1e-3


def load_model(path: Path) -> ModelFile:
    """A checked model file; InputError otherwise."""
    return parse_model(read_text(path), path)


def model_content(text: str, path: object) -> Any:
    """What a model file's text holds, unchecked; InputError for a plant's file, which is given elsewhere."""
    content = parse_yaml(text, path)
    if isinstance(content, dict) and content.get("schema") == PLANT_SCHEMA:
        raise InputError(path, "schema", f"{PLANT_SCHEMA} is a plant, no model of one: give it with --plant")
    return content


def parse_model(text: str, path: object) -> ModelFile:
    """A checked model from its file's text; `path` is what a message calls it."""
    content = model_content(text, path)
    if isinstance(content, dict) and content.get("plant", HOOP) != HOOP:
        raise InputError(path, "plant", f"a model of {content['plant']!r}, where one of the hoop is needed")
    model = to_struct(content, ModelFile, path)
    units = PARAMETER_UNITS[model.structure]
    for name, entry in model.parameters.items():
        check_parameter(path, f"parameters.{name}", entry, units.get(name))
    values = model.values()
    try:
        check_parameters(model.structure, values)
    except ParameterError as error:
        known = {"mb": "device.ball_mass_kg", "Ro": "device.hoop_radius_m", "Rb": "device.ball_radius_m"}
        known["g"] = "device.gravity_m_s2"
        inside = error.name in model.parameters or error.name not in known
        raise InputError(path, f"parameters.{error.name}" if inside else known[error.name], error.reason) from None
    for name, size in (("ball_mass_kg", 1e3), ("hoop_radius_m", 1e2), ("ball_radius_m", 1e2), ("gravity_m_s2", 1e3)):
        between(path, f"device.{name}", getattr(model.device, name), SMALLEST, size)
    if not values["Ro"] - values["Rb"] > LEAST_TRACK * values["Ro"]:
        raise InputError(path, "device.ball_radius_m", f"Rb = {values['Rb']:g} m fills the hoop of {values['Ro']:g} m")
    if model.device.inner is not None:
        # the ball has to find room between both
        most = values["Ro"] - 2.0 * values["Rb"]
        between(path, "device.inner.radius_m", model.device.inner.radius_m, SMALLEST, most)
        if any(one.name == INNER_HOOP for one in model.effects):
            raise InputError(path, "device.inner", f"stands beside the effect {INNER_HOOP}")
    between(path, "device.torque_limit_nm", model.device.torque_limit_nm, 0.0, 100.0)
    between(path, "device.encoder_counts", model.device.encoder_counts, 0, 2**26)
    between(path, "sample_time_s", model.sample_time_s, 0.0, 1.0)
    _check_effects(path, model)
    return model


def _check_effects(path: object, model: ModelFile) -> None:
    """InputError for an effect that the plant does not know, twice, or with numbers that cannot be meant."""
    known = known_effects(effects_plant(model), [one.name for one in model.effects])
    seen: set[str] = set()
    for index, entry in enumerate(model.effects):
        key = f"effects[{index}]"
        if entry.name in seen:
            raise InputError(path, f"{key}.name", f"{entry.name} stands twice")
        seen.add(entry.name)
        try:
            checked(effects_plant(model), entry.name, {name: one.value for name, one in entry.parameters.items()})
            check_region(entry.valid)
        except EffectError as error:
            raise InputError(path, f"{key}.{error.key}", error.reason) from None
        for name, one in entry.parameters.items():
            check_parameter(path, f"{key}.parameters.{name}", one, known[entry.name].parameter(name).unit)


def plant_of(model: ModelFile) -> HoopPlant:
    """The plant that a model file describes; its effects are not part of it (`effects_of`)."""
    return HoopPlant(model.structure, model.values())


def effects_plant(model: ModelFile) -> Plant:
    """The same plant, declared for effects."""
    device = model.device
    return hoop_plant(
        model.structure, model.values(), limit=device.torque_limit_nm, encoder_counts=device.encoder_counts
    )


def effects_of(model: ModelFile) -> FoundEffects:
    """The effects of a model file with their numbers, and what is sure of them."""
    known = known_effects(effects_plant(model), [one.name for one in model.effects])
    entries = tuple(_found(known[entry.name], entry) for entry in model.effects)
    inner = model.device.inner
    if inner is not None:
        entries += (FoundEffect(INNER_HOOP, {"radius": inner.radius_m}),)
    return FoundEffects(model.structure, model.values(), entries, model.device.torque_limit_nm)


def _found(effect: Effect, entry: EffectEntry) -> FoundEffect:
    given = entry.parameters.items()
    values = {**effect.neutral(), **{name: one.value for name, one in given}}
    weak = {name: weak_end(effect.parameter(name), one.value, one.ci95) for name, one in given}
    lost = _has_no_common_phase(effect, entry)
    if lost:
        weak |= {p.name: p.neutral for p in effect.parameters if p.role == "amplitude"}
    return FoundEffect(entry.name, values, weak, check_region(entry.valid), lost)


def _has_no_common_phase(effect: Effect, entry: EffectEntry) -> bool:
    """Measured, but with a phase that was another one in each recording: what is fed forward could add to it."""
    own = entry.parameters
    measured = any(p.role == "amplitude" and p.name in own and own[p.name].ci95 for p in effect.parameters)
    lost = any(
        p.role == "phase" and p.per_recording and p.name in own and own[p.name].ci95 is None for p in effect.parameters
    )
    return measured and lost


def check_parameter(path: object, key: str, entry: Parameter, unit: str | None) -> None:
    """InputError for a wrong unit, a size that cannot be meant, or an interval beside its value."""
    if unit is not None and entry.unit != unit:
        raise InputError(path, f"{key}.unit", f"wrong unit {entry.unit!r}: this parameter is in {unit}")
    if entry.value and not SMALLEST <= abs(entry.value) <= LARGEST:
        raise InputError(path, f"{key}.value", f"must be 0 or of size {SMALLEST:g} to {LARGEST:g}, not {entry.value:g}")
    if entry.ci95 is not None and not entry.ci95[0] <= entry.value <= entry.ci95[1]:
        raise InputError(path, f"{key}.ci95", f"the interval {list(entry.ci95)} does not hold the value {entry.value}")
