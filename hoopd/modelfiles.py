"""Model files (`hoopd.model/1`) and controller files (`hoopd.controller/1`): their records, checks and objects.

Rules of this file: everything wrong in a file is one `InputError`; no control law and no equation lives here.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from hoopd.core.controllers import Controller, LinearGains, Lqg, LqgGains, LqgLinear, TransferFunctionController
from hoopd.core.drift import CHANNELS, Level
from hoopd.core.estimator import DelayedEkf, EkfSettings
from hoopd.core.limits import Limiter
from hoopd.excitationfile import excitation_entry, excitation_of
from hoopd.files import InputError, parse_yaml, read_text, to_struct
from hoopd.physics.declared import DeclaredPlant, hoop_plant
from hoopd.physics.effects.base import Effect
from hoopd.physics.effects.catalogue import library
from hoopd.physics.found import EffectError, Found, FoundEffect, check_region, checked, weak_end
from hoopd.physics.parameters import PARAMETER_UNITS, ParameterError, check_parameters
from hoopd.physics.plant import Plant
from hoopd.yamltext import text_of

# No number of such a device is outside of these: a typing error, and products of such numbers leave the computer's.
SMALLEST, LARGEST = 1e-15, 1e12
# Of the hoop's radius, what the ball's centre at least moves on: the swing's frequency has it in the denominator.
LEAST_TRACK = 1e-3


class _Strict(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """Base of all records: unknown keys are refused."""


# ---------------------------------------------------------------------------------------------- model


class DeviceConstants(_Strict, frozen=True):
    """What is weighed and measured on the device, and the limits of its drive and encoder."""

    ball_mass_kg: float
    hoop_radius_m: float  # Ro: axis to the contact circle
    ball_radius_m: float  # Rb: the ball's rolling radius on its O-rings
    gravity_m_s2: float = 9.81
    torque_limit_nm: float = 0.7
    encoder_counts: int = 4096

    def values(self) -> dict[str, float]:
        """By the names of the equations."""
        return {"mb": self.ball_mass_kg, "Ro": self.hoop_radius_m, "Rb": self.ball_radius_m, "g": self.gravity_m_s2}


class Parameter(_Strict, frozen=True):
    """A number of the model: value and unit, 95 % interval where it was estimated, and what it started from."""

    value: float
    unit: str
    ci95: tuple[float, float] | None = None
    nominal: float | None = None


class EffectEntry(_Strict, frozen=True):
    """A found effect (vocabulary of effects, `slot.name`) with its parameters, and where it was seen."""

    name: str
    parameters: dict[str, Parameter] = {}
    # by theta, dtheta, psi, dpsi or u: [lowest, highest] of what was recorded; nothing is fed forward outside
    valid: dict[str, tuple[float, float]] = {}


class ModelFile(_Strict, frozen=True):
    """`hoopd.model/1`."""

    schema: Literal["hoopd.model/1"]
    name: str
    structure: Literal["rolling", "published", "entries"]
    device: DeviceConstants
    parameters: dict[str, Parameter]
    effects: list[EffectEntry] = []
    sample_time_s: float = 0.02

    def values(self) -> dict[str, float]:
        """Parameters by name; a parameter overrides the device constant of the same name."""
        return {**self.device.values(), **{name: entry.value for name, entry in self.parameters.items()}}


def load_model(path: Path) -> ModelFile:
    """A checked model file; InputError otherwise."""
    return parse_model(read_text(path), path)


def parse_model(text: str, path: object) -> ModelFile:
    """A checked model from its file's text; `path` is what a message calls it."""
    model = to_struct(parse_yaml(text, path), ModelFile, path)
    units = PARAMETER_UNITS[model.structure]
    for name, entry in model.parameters.items():
        _check_parameter(path, f"parameters.{name}", entry, units.get(name))
    values = model.values()
    try:
        check_parameters(model.structure, values)
    except ParameterError as error:
        known = {"mb": "device.ball_mass_kg", "Ro": "device.hoop_radius_m", "Rb": "device.ball_radius_m"}
        known["g"] = "device.gravity_m_s2"
        inside = error.name in model.parameters or error.name not in known
        raise InputError(path, f"parameters.{error.name}" if inside else known[error.name], error.reason) from None
    for name, size in (("ball_mass_kg", 1e3), ("hoop_radius_m", 1e2), ("ball_radius_m", 1e2), ("gravity_m_s2", 1e3)):
        _between(path, f"device.{name}", getattr(model.device, name), SMALLEST, size)
    if not values["Ro"] - values["Rb"] > LEAST_TRACK * values["Ro"]:
        raise InputError(path, "device.ball_radius_m", f"Rb = {values['Rb']:g} m fills the hoop of {values['Ro']:g} m")
    _between(path, "device.torque_limit_nm", model.device.torque_limit_nm, 0.0, 100.0)
    _between(path, "device.encoder_counts", model.device.encoder_counts, 0, 2**26)
    _between(path, "sample_time_s", model.sample_time_s, 0.0, 1.0)
    _check_effects(path, model)
    return model


def _check_effects(path: object, model: ModelFile) -> None:
    """InputError for an effect that the plant does not know, twice, or with numbers that cannot be meant."""
    known = library(effects_plant(model))
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
            _check_parameter(path, f"{key}.parameters.{name}", one, known[entry.name].parameter(name).unit)


def model_text(model: ModelFile) -> str:
    """The text of a model file, every number to its last bit."""
    lines: list[str] = []
    for key, value in msgspec.to_builtins(model).items():
        if isinstance(value, dict) and all(isinstance(one, dict) for one in value.values()):
            lines += [f"{key}:"] + [f"  {name}: {_flow(one)}" for name, one in value.items()]
        elif isinstance(value, list) and value:
            lines += [f"{key}:"] + [f"  - {_flow(one)}" for one in value]
        else:
            lines += [f"{key}: {_flow(value)}"]
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    """One line of YAML."""
    return text_of(value, default_flow_style=True, width=10**6).removesuffix("...\n").strip()


def plant_of(model: ModelFile) -> Plant:
    """The plant that a model file describes; its effects are not part of it (`effects_of`)."""
    return Plant(model.structure, model.values())


def effects_plant(model: ModelFile) -> DeclaredPlant:
    """The same plant, declared for effects."""
    return hoop_plant(model.structure, model.values(), limit=model.device.torque_limit_nm)


def effects_of(model: ModelFile) -> Found:
    """The effects of a model file with their numbers, and what is sure of them."""
    known = library(effects_plant(model))
    entries = tuple(_found(known[entry.name], entry) for entry in model.effects)
    return Found(model.structure, model.values(), entries, model.device.torque_limit_nm)


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


def _check_parameter(path: object, key: str, entry: Parameter, unit: str | None) -> None:
    if unit is not None and entry.unit != unit:
        raise InputError(path, f"{key}.unit", f"wrong unit {entry.unit!r}: this parameter is in {unit}")
    if entry.value and not SMALLEST <= abs(entry.value) <= LARGEST:
        raise InputError(path, f"{key}.value", f"must be 0 or of size {SMALLEST:g} to {LARGEST:g}, not {entry.value:g}")
    if entry.ci95 is not None and not entry.ci95[0] <= entry.value <= entry.ci95[1]:
        raise InputError(path, f"{key}.ci95", f"the interval {list(entry.ci95)} does not hold the value {entry.value}")


# ---------------------------------------------------------------------------------------------- controller


class EstimatorEntry(_Strict, frozen=True):
    """Numbers of `EkfSettings` in a file."""

    q: tuple[float, float, float, float]
    r_theta: float
    r_dtheta: float
    r_psi: float
    gate_nis: float = 25.0
    reacquire_after: int = 5
    horizon_s: float = 0.25
    # of theta, dtheta, psi: [all, slow] of the innovations on a device that is as the model says (`core.drift`)
    innovations: dict[str, tuple[float, float]] = {}


class ControllerLimits(_Strict, frozen=True):
    """What this law may ask for."""

    torque_nm: float = 0.7
    slew_nm_per_tick: float = 1.4


class ControllerFile(_Strict, frozen=True):
    """`hoopd.controller/1`: all numbers of a law, so that nothing is designed at run time.

    `gains` holds numbers and (nested) lists of them, by the names of the law: `LqgGains`, `LinearGains`, `b` and
    `a`, or those of an experiment (`hoopd.excitationfile`).
    """

    schema: Literal["hoopd.controller/1"]
    name: str
    kind: Literal["lqg", "lqg_linear", "pid", "lead", "transfer_function", "excitation"]
    gains: dict[str, Any]
    estimator: EstimatorEntry
    limits: ControllerLimits = ControllerLimits()
    model: str = "models/hoop.yaml"
    sample_time_s: float = 0.02
    notes: str = ""


def load_controller(path: Path) -> ControllerFile:
    """A checked controller file; InputError otherwise."""
    return parse_controller(read_text(path), path)


def parse_controller(text: str, path: object) -> ControllerFile:
    """A checked controller from its file's text; `path` is what a message calls it."""
    file = to_struct(parse_yaml(text, path), ControllerFile, path)
    _between(path, "limits.torque_nm", file.limits.torque_nm, 0.0, 0.7)
    _between(path, "limits.slew_nm_per_tick", file.limits.slew_nm_per_tick, 0.0, math.inf)
    _between(path, "sample_time_s", file.sample_time_s, 0.0, 1.0)
    _checked(path, "gains", lambda: controller_of(file))
    _checked(path, "estimator", lambda: (settings_of(file), levels_of(file)))
    return file


def controller_of(file: ControllerFile) -> Controller:
    """The law of a controller file; ValueError when its gains do not fit it."""
    if file.kind == "excitation":
        return _excitation(file)
    if file.kind == "lqg":
        gains = _numbers(file.gains)
        missing = {"k_dtheta", "k_psi", "k_dpsi"} - gains.keys()
        unknown = gains.keys() - set(LqgGains.__dataclass_fields__)
        if missing or unknown:
            raise ValueError(f"missing {sorted(missing)}, unknown {sorted(unknown)}")
        return Lqg(LqgGains(**gains))
    if file.kind == "lqg_linear":
        return LqgLinear(_linear_gains(file.gains))
    if file.gains.keys() != {"b", "a"}:
        raise ValueError("expected b and a, the coefficients of C(z) from the highest power down")
    return TransferFunctionController(_array(file.gains, "b", 1).tolist(), _array(file.gains, "a", 1).tolist())


def _excitation(file: ControllerFile) -> Controller:
    entry = excitation_entry(file.gains)
    if entry.around is None:
        return excitation_of(entry, None)
    change = {"kind": entry.around.kind, "gains": entry.around.gains}
    return excitation_of(entry, controller_of(msgspec.structs.replace(file, **change)))


def settings_of(file: ControllerFile) -> EkfSettings:
    """The filter's settings in a controller file."""
    numbers = msgspec.structs.asdict(file.estimator)
    del numbers["innovations"]
    return EkfSettings(**numbers)


def levels_of(file: ControllerFile) -> dict[str, Level]:
    """What is normal of the filter's innovations; ValueError for a channel or a number that cannot be."""
    for name, pair in file.estimator.innovations.items():
        if name not in CHANNELS or not all(0.0 < value < math.inf for value in pair):
            raise ValueError(f"innovations: two numbers above 0 of {', '.join(CHANNELS)}, not {name}: {list(pair)}")
    return {name: Level(*pair) for name, pair in file.estimator.innovations.items()}


def estimator_of(file: ControllerFile, plant: Plant) -> DelayedEkf:
    """The filter of a controller file on a plant."""
    return DelayedEkf(plant.step_and_jacobian, settings_of(file))


def limiter_of(file: ControllerFile) -> Limiter:
    """The limits of a controller file."""
    return Limiter(file.limits.torque_nm, file.limits.slew_nm_per_tick)


def _linear_gains(gains: dict[str, Any]) -> LinearGains:
    shapes = {"a": 2, "b": 1, "c": 2, "filter_gain": 2, "feedback": 1}
    if gains.keys() != {*shapes, "feedforward"}:
        raise ValueError(f"expected {', '.join(LinearGains._fields)}")
    arrays = {name: _array(gains, name, ndim) for name, ndim in shapes.items()}
    n = len(arrays["b"])
    wanted = {"a": (n, n), "b": (n,), "c": (2, n), "filter_gain": (n, 2), "feedback": (n,)}
    for name, shape in wanted.items():
        if arrays[name].shape != shape:
            raise ValueError(f"{name} must have shape {shape}, not {arrays[name].shape}")
    return LinearGains(**arrays, feedforward=_numbers({"feedforward": gains["feedforward"]})["feedforward"])


def _array(gains: dict[str, Any], name: str, ndim: int) -> np.ndarray:
    try:
        array = np.array(gains[name], dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be a table of numbers") from None
    if array.ndim != ndim or not np.isfinite(array).all():
        raise ValueError(f"{name} must be {'a list' if ndim == 1 else 'a list of rows'} of finite numbers")
    return array


def _numbers(gains: dict[str, Any]) -> dict[str, float]:
    for name, value in gains.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number, not {value!r}")
    return {name: float(value) for name, value in gains.items()}


def _checked(path: object, key: str, make: Any) -> None:
    try:
        make()
    except ValueError as error:
        raise InputError(path, key, str(error)) from None


def _between(path: object, key: str, value: float, low: float, high: float) -> None:
    if not low < value <= high:
        raise InputError(path, key, f"must be above {low:g} and at most {high:g}, not {value:g}")
