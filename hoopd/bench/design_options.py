"""Options of `hoopd design` as a specification.

Rules of this file: a number or text that makes no sense is one `InputError` with the option's name.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite
from typing import Any

from hoopd.design.laws import Spec
from hoopd.design.lqg import Weights
from hoopd.files import InputError

WEIGHT_NAMES = {"dtheta": "dtheta_rad_s", "psi": "psi_rad", "dpsi": "dpsi_rad_s", "torque": "torque_nm"}
# Option of each number of the specification, and between which values it makes sense.
RANGES = {
    "omega_rad_s": ("--omega", 0.0, 1e3),
    "mt": ("--mt", 1.0, 100.0),
    "phase_deg": ("--phase", -180.0, 180.0),
    "zeta": ("--zeta", 0.0, 10.0),
    "filter_ratio": ("--filter", 0.0, 1e3),
    "ratio": ("--ratio", 0.0, 1e3),
    "sample_time_s": ("--sample-time", 0.0, 0.1),
}
LONGEST_DELAY_S = 0.2  # the filter's memory is 0.25 s


def spec_from(**values: Any) -> Spec:
    """A specification; InputError names the option whose number makes no sense."""
    for name, (option, low, high) in RANGES.items():
        value = values.get(name)
        if value is not None and not low < value <= high:
            raise InputError(option, "", f"must be above {low:g} and at most {high:g}, not {value:g}")
    if not 0.0 <= values.get("delay_s", 0.0) <= LONGEST_DELAY_S:
        raise InputError("--delay", "", f"must be from 0 to {LONGEST_DELAY_S:g} s, not {values['delay_s']:g}")
    if not isfinite(values.get("gain", 1.0)):
        raise InputError("--gain", "", "must be a finite number")
    if values.get("lead") is not None and not all(0.0 < value <= 1e3 for value in values["lead"]):
        raise InputError("--lead", "", "takes rad/s and N, both above 0 and at most 1000")
    return Spec(**values)


def weights_from(texts: list[str]) -> Weights:
    """Weights of "psi=0.2" and the like; InputError for a name or a number that is none."""
    changes: dict[str, float] = {}
    for text in (part for item in texts for part in item.split(",")):
        name, equals, value = text.strip().partition("=")
        number = _number(value)
        if not equals or name not in WEIGHT_NAMES or not 0.0 < number < inf:
            names = ", ".join(f"{one}=..." for one in WEIGHT_NAMES)
            raise InputError("--weights", "", f"expected {names} with numbers above 0, not {text!r}")
        changes[WEIGHT_NAMES[name]] = number
    return replace(Weights(), **changes)


def poles_from(text: str) -> tuple[complex, ...]:
    """Poles of "-6+6j,-6-6j,-1" in rad/s; InputError unless all are stable numbers."""
    try:
        poles = tuple(complex(part.strip().replace("i", "j")) for part in text.split(","))
    except ValueError:
        raise InputError("--poles", "", f"expected complex numbers such as -6+6j,-6-6j,-1, not {text!r}") from None
    if not all(pole.real < 0.0 and isfinite(abs(pole)) for pole in poles):
        raise InputError("--poles", "", "a stable loop has poles with negative real parts (rad/s, continuous time)")
    return poles


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
