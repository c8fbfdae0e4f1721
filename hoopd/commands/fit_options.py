"""What `hoopd fit` is asked for, from text to checked settings.

Rules of this file: everything unusable is one `InputError` that names the option; no mathematics.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from hoopd.commands.inputs import read_values
from hoopd.commands.options.fit import FitOptions
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.files.shipped import START_MODELS, defaults_folder, or_shipped
from hoopd.plants.fits.free_parameters import Prior
from hoopd.plants.fits.robust_least_squares import LOSSES
from hoopd.plants.hoop.fitting.fit import METHODS, FitSettings, nominal_values
from hoopd.plants.hoop.fitting.free_parameters import scale_of
from hoopd.plants.hoop.parameters import PARAMETER_UNITS, STRUCTURES, ParameterError, check_parameters
from hoopd.plants.hoop.recordings.fit_data import CHANNELS
from hoopd.plants.model_file import effects_of


def start_model(options: FitOptions) -> Path:
    """The file of the model that a fit of the hoop starts from."""
    _one_of("--structure", options.structure, STRUCTURES)
    return or_shipped(options.model or defaults_folder() / START_MODELS[options.structure])


def settings_of(options: FitOptions, base: ModelFile) -> FitSettings:
    """The settings of a fit that starts from a model."""
    _one_of("--structure", options.structure, STRUCTURES)
    _one_of("--loss", options.loss, LOSSES)
    _one_of("--method", options.method, METHODS)
    if options.kinematics and base.effects:
        raise InputError("--kinematics", "", "compares models without effects, and this one has some")
    nominal = nominal_values(base, options.structure)
    names = tuple(PARAMETER_UNITS[options.structure])
    if options.window_s is not None and not 0.2 <= options.window_s <= 1e4:
        raise InputError("--window", "", f"must be 0.2 to 10000 s, not {options.window_s:g}")
    return FitSettings(
        structure=options.structure,
        free=_known("--free", options.free, names),
        fixed=_possible("--fix", options.structure, nominal, fixed_values(options.fix, nominal, names)),
        priors=priors_of(options.prior, names, lambda name: _is_positive(options.structure, name)),
        channels=_known("--channels", options.channels, CHANNELS),
        window_s=options.window_s,
        loss=options.loss,
        method=options.method,
        encoder_counts=base.device.encoder_counts,
        effects=effects_of(base).on(options.structure, nominal) if base.effects else None,
    )


def _one_of(option: str, value: str, known: Sequence[str]) -> None:
    if value not in known:
        raise InputError(option, "", f"unknown {value!r}; known: {', '.join(known)}")


def _known(option: str, names: tuple[str, ...], known: Sequence[str]) -> tuple[str, ...]:
    for name in names:
        _one_of(option, name, known)
    return names


def fixed_values(texts: Sequence[str], nominal: Mapping[str, float], names: tuple[str, ...]) -> dict[str, float]:
    """ "mb=0.06", or "mb" alone: at its nominal value."""
    fixed: dict[str, float] = {}
    for part in (part for text in texts for part in text.split(",") if part.strip()):
        name, equals, _ = (piece.strip() for piece in part.partition("="))
        _one_of("--fix", name, names)
        if name in fixed:
            raise InputError("--fix", name, "stands twice")
        fixed |= read_values("--fix", part, names) if equals else {name: nominal[name]}
    return fixed


def _possible(option: str, structure: str, nominal: Mapping[str, float], fixed: dict[str, float]) -> dict[str, float]:
    """The values, when such a plant can be."""
    try:
        check_parameters(structure, {**nominal, **fixed})
    except ParameterError as error:
        raise InputError(option, error.name, error.reason) from None
    return fixed


def _is_positive(structure: str, name: str) -> bool:
    return bool(scale_of(structure, (name,), {name: 1.0}).positive[0])


def priors_of(texts: Sequence[str], names: tuple[str, ...], is_positive: Callable[[str], bool]) -> dict[str, Prior]:
    """ "mb=0.06:0.1": the value, and the relative standard deviation of a positive parameter (else the absolute)."""
    priors = {}
    for text in texts:
        head, colon, sigma = text.rpartition(":")
        if not colon:
            raise InputError("--prior", text, "expected NAME=VALUE:SIGMA, e.g. mb=0.06:0.1")
        ((name, value),) = read_values("--prior", head, names).items()
        width = read_values("--prior", f"sigma={sigma}", ("sigma",))["sigma"]
        if width <= 0.0:
            raise InputError("--prior", name, "sigma must be positive")
        if value <= 0.0 and is_positive(name):
            raise InputError("--prior", name, f"must be positive, not {value:g}")
        priors[name] = Prior(value, width)
    return priors
