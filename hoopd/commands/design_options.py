"""Options of `hoopd design` as a specification.

Rules of this file: a number or text that makes no sense is one `InputError` with the option's name.
"""

from __future__ import annotations

from cmath import isfinite
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import inf
from types import MappingProxyType
from typing import Any

from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.design import DesignOptions
from hoopd.design.laws import LAWS, Spec, SpecError
from hoopd.design.weights import Weights
from hoopd.files.reading import InputError

# Every law of the hoop.
KINDS = (*LAWS, "arx", "identified")
# What some laws of the hoop alone are asked for.
OF_LAWS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "recording": ("arx",),
        "identified": ("identified",),
        "omega_rad_s": ("pid", "pi", "lead", "lag"),
        "mt": ("pid",),
        "phase_deg": ("pid", "pi"),
        "zeta": ("pi",),
        "filter_ratio": ("pid",),
        "lead": ("pid",),
        "ratio": ("lead", "lag"),
        "gain": ("lead", "lag"),
        "poles": ("placement",),
        "weights": ("lqg", "arx", "identified"),
    }
)
WEIGHT_NAMES = {"dtheta": "dtheta_rad_s", "psi": "psi_rad", "dpsi": "dpsi_rad_s", "torque": "torque_nm"}


# No drive of a laboratory moves as fast.
FASTEST_RAD_S = 1e6


def refuse_of_other_laws(options: DesignOptions, of_laws: Mapping[str, Sequence[str]] = OF_LAWS) -> None:
    """InputError for what is told and belongs to another law: it would be taken no notice of."""
    for one in fields(DesignOptions):
        laws = of_laws.get(one.name)
        if laws is not None and options.law not in laws and getattr(options, one.name) != one.default:
            reason = f"is of {' and '.join(laws)}: {options.law} takes no notice of it"
            raise InputError(option_name(DesignOptions, one.name), "", reason)


def spec_from(options: DesignOptions) -> Spec:
    """A specification; InputError names the option whose number makes no sense."""
    refuse_of_other_laws(options)
    read: dict[str, Any] = {"poles": poles_from(options.poles), "weights": weights_from(options.weights)}
    values: dict[str, Any] = {one.name: read.get(one.name, getattr(options, one.name, None)) for one in fields(Spec)}
    told = {name: value for name, value in values.items() if hasattr(options, name)}
    if options.sample_time_s is None:
        told.pop("sample_time_s")
    try:
        return Spec(**told)
    except SpecError as error:
        raise InputError(option_name(DesignOptions, error.name), "", error.reason) from None


def weights_from(texts: Sequence[str]) -> Weights:
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
    """Poles of "-6+6j,-6-6j,-1" in rad/s; InputError unless all are numbers."""
    try:
        poles = tuple(complex(part.strip().replace("i", "j")) for part in text.split(","))
        if not all(isfinite(pole) for pole in poles):
            raise ValueError("no pole lies at infinity")
    except ValueError:
        raise InputError("--poles", "", f"expected complex numbers such as -6+6j,-6-6j,-1, not {text!r}") from None
    if (fastest := max(abs(pole) for pole in poles)) > FASTEST_RAD_S:
        raise InputError("--poles", "", f"at most {FASTEST_RAD_S:g} rad/s from 0, not {fastest:g}")
    return poles


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")
