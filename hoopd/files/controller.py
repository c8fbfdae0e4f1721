"""Controller files (`hoopd.controller/1`): their records, checks and objects.

Rules of this file: everything wrong in a file is one `InputError`; no control law lives here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, Protocol

import msgspec
import numpy as np

from hoopd.core.controllers import Controller, LinearGains, Lqg, LqgGains, LqgLinear, TransferFunctionController
from hoopd.core.drift import CHANNELS, Level
from hoopd.core.estimator import DelayedEkf, EkfSettings, Step
from hoopd.core.excitation import Excitation
from hoopd.core.limits import SLEW_NM_PER_TICK, TORQUE_LIMIT_NM, Limiter
from hoopd.files.excitation import excitation_entry, excitation_of
from hoopd.files.planned_motion import flight_doubt, planned_motion_entry, tracker_of
from hoopd.files.reading import InputError, parse_yaml, read_text, to_struct
from hoopd.files.records import Strict, between

# What a file that names no plant is of.
HOOP = "hoop"


class FilterPlant(Protocol):
    """A plant that a filter can predict with."""

    @property
    def step_and_jacobian(self) -> Step:
        """(x, u, h) -> state after h seconds and its derivative by x."""


# A filter begins so far back, in steps, within a tick; pictures are 50 ms old, and those of 0.3 s are a fault.
LONGEST_HORIZON_S = 1.0
# Pictures that agree with each other against the prediction before they are believed: a false one alone never is.
FEWEST_ALIKE = 2
# A picture farther off than this is a false one, however uncertain pictures are: a wider gate believes a lying camera.
WIDEST_GATE_RAD = 0.5


class EstimatorEntry(Strict, frozen=True):
    """Numbers of `EkfSettings` in a file."""

    q: tuple[float, float, float, float]
    r_theta: float
    r_dtheta: float
    r_psi: float
    gate_nis: float = 25.0
    reacquire_after: int = 5
    horizon_s: float = 0.25
    # of theta, dtheta, psi: [all, slow] of the innovations on a device that is as the model says (`core.drift`)
    innovations: dict[str, tuple[float, float]] = msgspec.field(default_factory=dict)


class ControllerLimits(Strict, frozen=True):
    """What this law may ask for."""

    torque_nm: float = TORQUE_LIMIT_NM
    slew_nm_per_tick: float = SLEW_NM_PER_TICK


class ControllerFile(Strict, frozen=True):
    """`hoopd.controller/1`: all numbers of a law, so that nothing is designed at run time.

    `gains` holds numbers and (nested) lists of them, by the names of the law: `LqgGains`, `LinearGains`, `b` and
    `a`, those of an experiment (`hoopd.files.excitation`), or a planned motion (`hoopd.files.planned_motion`).
    """

    schema: Literal["hoopd.controller/1"]
    name: str
    kind: Literal["lqg", "lqg_linear", "pid", "lead", "transfer_function", "excitation", "maneuver"]
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
    file = parse_recorded_controller(text, path)
    between(path, "estimator.horizon_s", file.estimator.horizon_s, 0.0, LONGEST_HORIZON_S)
    if file.estimator.reacquire_after < FEWEST_ALIKE:
        reason = f"must be at least {FEWEST_ALIKE}, not {file.estimator.reacquire_after}"
        raise InputError(path, "estimator.reacquire_after", reason)
    gate_rad = math.sqrt(file.estimator.gate_nis * file.estimator.r_psi)
    if gate_rad > WIDEST_GATE_RAD:
        reason = f"times r_psi: a picture is believed {gate_rad:.3g} rad off, at most {WIDEST_GATE_RAD} is safe"
        raise InputError(path, "estimator.gate_nis", reason)
    if beyond := beyond_own_limits(file):
        raise InputError(path, "gains", beyond)
    if file.kind == "maneuver" and (doubt := flight_doubt(planned_motion_entry(file.gains), file.sample_time_s)):
        raise InputError(path, "gains", doubt)
    return file


def parse_recorded_controller(text: str, path: object) -> ControllerFile:
    """A controller that has been played, with what no new file may have: a replay does what the run did."""
    content = parse_yaml(text, path)
    if isinstance(content, dict) and content.get("plant", HOOP) != HOOP:
        raise InputError(path, "plant", f"a controller of {content['plant']!r}: the daemon runs the hoop alone")
    file = to_struct(content, ControllerFile, path)
    between(path, "limits.torque_nm", file.limits.torque_nm, 0.0, TORQUE_LIMIT_NM)
    between(path, "limits.slew_nm_per_tick", file.limits.slew_nm_per_tick, 0.0, math.inf)
    between(path, "sample_time_s", file.sample_time_s, 0.0, 1.0)
    _checked(path, "gains", lambda: controller_of(file))
    _checked(path, "estimator", lambda: (settings_of(file), levels_of(file)))
    return file


def controller_of(file: ControllerFile) -> Controller:
    """The law of a controller file; ValueError when its gains do not fit it."""
    if file.kind == "excitation":
        return _excitation(file)
    if file.kind == "maneuver":
        return tracker_of(planned_motion_entry(file.gains))
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


def beyond_own_limits(file: ControllerFile) -> str:
    """By what the plan that a law plays is beyond the file's limits, which would make another one of it; empty: by
    nothing, or it plays none."""
    if file.kind == "maneuver":
        told = beyond_limits(planned_motion_entry(file.gains).torques_nm, file.limits)
        return f"torques_nm {told}" if told else ""
    law = controller_of(file)
    told = beyond_limits(law.torques_nm, file.limits) if isinstance(law, Excitation) else ""
    return f"table_nm {told}" if told else ""


def beyond_limits(torques_nm: Sequence[float], limits: ControllerLimits) -> str:
    """By what the torques of a plan are beyond its limits; empty: they keep them."""
    largest = max(map(abs, torques_nm))
    step = max(abs(after - before) for before, after in pairwise([0.0, *torques_nm]))
    if largest > limits.torque_nm:
        return f"asks for {largest:.3g} N m, and {limits.torque_nm:g} N m are in force"
    if step > limits.slew_nm_per_tick:
        return f"steps by {step:.3g} N m in a tick, and {limits.slew_nm_per_tick:g} N m are in force"
    return ""


def _excitation(file: ControllerFile) -> Controller:
    entry, around = excitation_entry(file.gains), None
    if entry.around is not None:
        change = {"kind": entry.around.kind, "gains": entry.around.gains}
        around = controller_of(msgspec.structs.replace(file, **change))
    return excitation_of(entry, around)


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


def estimator_of(file: ControllerFile, plant: FilterPlant) -> DelayedEkf:
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
