"""One fit from recordings to a model: structure, what is free, which channels, by which method.

Rules of this file: it chooses and composes; the mathematics is in the modules beside it; no files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import tau

import numpy as np

from hoopd.files.model import ModelFile, Parameter
from hoopd.files.reading import InputError
from hoopd.plants.fits.free_parameters import Prior
from hoopd.plants.fits.output_error import Progress, Solution
from hoopd.plants.fits.runs import Run
from hoopd.plants.fits.uncertainty import Uncertainty, intervals, uncertainty
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.fitting.filter_noise import NoiseModel
from hoopd.plants.hoop.fitting.free_parameters import default_priors, determined_names
from hoopd.plants.hoop.fitting.hoop_output_error import fit_output_error
from hoopd.plants.hoop.fitting.hoop_prediction_error import fit_prediction_error
from hoopd.plants.hoop.parameters import PARAMETER_UNITS
from hoopd.plants.hoop.recordings.fit_data import prepare
from hoopd.plants.likelihood.innovation_tests import PredictionUncertainty, prediction_uncertainty
from hoopd.recording.recording import Recording

# Where the simulated hoop stays this near to the encoder's reading, the reading itself is fitted: its error is white
# then, and the intervals are right. Where it drifts away, only its rate can be compared.
FOLLOWS_COUNTS = 3.0
# Before its parameters are fitted to the angle itself it may be ten times as far off, or the fit is not worth trying.
NEARLY_COUNTS = 30.0
# A first fit in short runs, whose starts are known from the data, brings the long run's search near its end.
FIRST_WINDOW_S = 2.0
# Fits that only bring the next one near its end stop at a step that gains less than this share of the cost.
NEAR_GAIN = 1e-5
METHODS = ("output", "prediction")


@dataclass(frozen=True)
class FitSettings:
    """What a fit is asked to do."""

    structure: str = "entries"
    free: tuple[str, ...] = ()  # empty: all on which the recordings bear
    fixed: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, Prior] = field(default_factory=dict)
    channels: tuple[str, ...] = ()  # empty: psi and theta, or its rate where the model cannot follow theta
    window_s: float | None = None  # None: one free run over each recording
    loss: str = "linear"
    method: str = "output"  # or prediction
    encoder_counts: int = 4096  # of the hoop's turn
    effects: FoundEffects | None = None  # beside the base, held as they are


@dataclass(frozen=True)
class FittedParameters:
    """A fitted model: values, how well they are known, and what they were fitted to."""

    structure: str
    solution: Solution
    uncertainty: Uncertainty
    runs: tuple[Run, ...]
    channels: tuple[str, ...]
    nominal: dict[str, float]  # what it started from
    settings: FitSettings
    prediction: PredictionUncertainty | None = None  # noise levels and whiteness of a prediction-error fit

    @property
    def values(self) -> dict[str, float]:
        """Every parameter of the structure."""
        return self.solution.values

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % intervals of the fitted ones."""
        return intervals(self.solution, self.uncertainty)

    @property
    def movings(self) -> tuple[str, ...]:
        """Kinds of recordings among the runs: both, hoop, ball."""
        return tuple(dict.fromkeys(run.moving for run in self.runs))


def nominal_values(model: ModelFile, structure: str) -> dict[str, float]:
    """Values to start from: the model's own, or those of its structure's device."""
    if model.structure == structure or {model.structure, structure} <= {"rolling", "published"}:
        return model.values()
    raise InputError(model.name, "structure", f"is {model.structure}: nothing to start a fit of {structure} from")


def fit(
    recordings: Sequence[Recording],
    nominal: Mapping[str, float],
    settings: FitSettings | None = None,
    progress: Progress = lambda text: None,
) -> FittedParameters:
    """Parameters from recordings; InputError when they do not fit together or hold nothing."""
    settings = settings or FitSettings()
    if settings.method == "prediction":
        return _fit_prediction(recordings, nominal, settings, progress)
    values = {**nominal, **settings.fixed}
    channels = settings.channels or ("theta_rate", "psi")
    runs = prepare(recordings, channels, settings.window_s, settings.encoder_counts)
    names = free_names(settings, runs)
    priors = {**default_priors(settings.structure, names, values), **settings.priors}
    values = _near(recordings, values, names, priors, settings, progress)
    solution = _solve(values, names, runs, priors, settings, progress)
    if not settings.channels and any("theta_rate" in run.series for run in runs):
        closer = prepare(recordings, ("theta", "psi"), settings.window_s, settings.encoder_counts)
        if _follows(solution, closer, settings):
            again = _solve(solution.values, names, closer, priors, settings, progress)
            if again.sigma["theta"] < FOLLOWS_COUNTS * tau / settings.encoder_counts:
                solution, runs, channels = again, closer, ("theta", "psi")
    known = uncertainty(solution, settings.loss)
    return FittedParameters(settings.structure, solution, known, tuple(runs), tuple(channels), dict(nominal), settings)


def _fit_prediction(
    recordings: Sequence[Recording], nominal: Mapping[str, float], settings: FitSettings, progress: Progress
) -> FittedParameters:
    """The likelihood of a filter's innovations, begun where free runs end."""
    if settings.effects:
        names = ", ".join(settings.effects.names)
        raise InputError("--method", "prediction", f"its filter does not know {names}: take --method output")
    if "theta_rate" in settings.channels:
        raise InputError("--channels", "theta_rate", "the filter takes measurements, not their differences: use theta")
    first = fit(recordings, nominal, replace(settings, method="output", channels=(), loss="linear"), progress)
    channels = settings.channels or ("theta", "psi")
    runs = prepare(recordings, channels, settings.window_s, settings.encoder_counts)
    solution = fit_prediction_error(
        settings.structure,
        first.values,
        first.solution.names,
        runs,
        priors=first.solution.priors,
        noise=NoiseModel(encoder_counts=settings.encoder_counts),
        loss="linear" if settings.loss == "linear" else "student",  # any robust one
        progress=progress,
    )
    judged = prediction_uncertainty(solution)
    return FittedParameters(
        settings.structure, solution, judged.parameters, tuple(runs), channels, dict(nominal), settings, judged
    )


def free_names(settings: FitSettings, runs: Sequence[Run]) -> tuple[str, ...]:
    """Parameters that are fitted, in the structure's order; InputError when none or a wrong one is wanted."""
    kinds = tuple(dict.fromkeys(run.moving for run in runs))
    if settings.structure == "entries" and len(kinds) > 1:
        names = {kind: next(run.recording for run in runs if run.moving == kind) for kind in kinds}
        raise InputError(
            names[kinds[1]],
            "structure",
            f"entries of hoop and ball together ({names[kinds[0]]}: {kinds[0]}) are not those of one alone "
            f"({kinds[1]}): fit them apart, or use rolling",
        )
    known = PARAMETER_UNITS[settings.structure]
    for name in (*settings.free, *settings.fixed, *settings.priors):
        if name not in known:
            raise InputError(name, "", f"not a parameter of the {settings.structure} model; known: {', '.join(known)}")
    driven = any(np.any(run.u != 0.0) for run in runs)
    determined = determined_names(settings.structure, kinds, driven=driven)
    wanted = settings.free or determined
    free = tuple(name for name in wanted if name in determined and name not in settings.fixed)
    if not free:
        raise InputError("--free", "", f"nothing is left to fit; these recordings bear on {', '.join(determined)}")
    if idle := [name for name in settings.free if name not in determined]:
        raise InputError("--free", idle[0], f"these recordings bear on {', '.join(determined)} only")
    if idle := [name for name in settings.priors if name not in free]:
        raise InputError("--prior", idle[0], f"is not fitted; {', '.join(free)} are")
    return free


def model_file(fitted: FittedParameters, base: ModelFile, name: str) -> ModelFile:
    """The fit as a model file on the base's device: fitted values with their intervals, the others as they were."""
    units, found = PARAMETER_UNITS[fitted.structure], fitted.intervals
    device_names = base.device.values()
    parameters = {}
    for key, unit in units.items():
        value = fitted.values[key]
        if key in found:
            parameters[key] = Parameter(value=value, unit=unit, ci95=found[key], nominal=fitted.nominal[key])
        elif key not in device_names or value != device_names[key]:
            parameters[key] = Parameter(value=value, unit=unit, nominal=fitted.nominal[key])
    return ModelFile(
        schema="hoopd.model/1",
        name=name,
        structure=fitted.structure,  # type: ignore[arg-type]
        device=base.device,
        parameters=parameters,
        effects=base.effects if fitted.settings.effects else [],
        sample_time_s=base.sample_time_s,
    )


def _near(
    recordings: Sequence[Recording],
    values: dict[str, float],
    names: Sequence[str],
    priors: Mapping[str, Prior],
    settings: FitSettings,
    progress: Progress,
) -> dict[str, float]:
    """Values of a quick fit in short runs, from which a long one does not go astray."""
    if settings.window_s is not None and settings.window_s <= FIRST_WINDOW_S:
        return values
    channels = tuple("theta_rate" if name == "theta" else name for name in settings.channels) or ("theta_rate", "psi")
    runs = prepare(recordings, channels, FIRST_WINDOW_S, settings.encoder_counts)
    progress(f"first in {len(runs)} runs of {FIRST_WINDOW_S:g} s")
    found = fit_output_error(
        settings.structure,
        values,
        names,
        runs,
        priors=priors,
        loss="soft_l1",
        rounds=1,
        smallest_gain=NEAR_GAIN,
        effects=settings.effects,
        progress=progress,
    )
    return found.values


def _solve(
    values: Mapping[str, float],
    names: Sequence[str],
    runs: Sequence[Run],
    priors: Mapping[str, Prior],
    settings: FitSettings,
    progress: Progress,
) -> Solution:
    return fit_output_error(
        settings.structure,
        values,
        names,
        runs,
        priors=priors,
        loss=settings.loss,
        effects=settings.effects,
        progress=progress,
    )


def _follows(solution: Solution, runs: Sequence[Run], settings: FitSettings) -> bool:
    """Whether the model's hoop stays near the encoder's reading, once each run starts at its best angle."""
    trial = fit_output_error(
        settings.structure,
        solution.values,
        (),
        runs,
        loss=settings.loss,
        effects=settings.effects,
        rounds=1,
        smallest_gain=NEAR_GAIN,
    )
    errors = np.concatenate([e["theta"] for e in trial.residuals if "theta" in e])
    return bool(np.std(errors) < NEARLY_COUNTS * tau / settings.encoder_counts)
