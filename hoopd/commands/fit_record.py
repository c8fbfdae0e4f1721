"""The result of a fit as a record: parameters, fit on all recordings, residuals, what it means, notes.

Rules of this file: plain data for JSON, which knows no NaN: a fit that does not exist is null.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hoopd.commands.options.fit import FitOptions
from hoopd.commands.plant_inputs import number
from hoopd.commands.simulate import off_words
from hoopd.commands.simulate_plant import memory_words
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.files.shipped import START_MODELS, defaults_folder
from hoopd.ident.normal import Z95
from hoopd.plants.fits.plain_numbers import plain
from hoopd.plants.hoop.entries import ENTRIES
from hoopd.plants.hoop.fitting.entry_constraints import constraint_words
from hoopd.plants.hoop.fitting.filter_noise import NOISE_UNITS
from hoopd.plants.hoop.fitting.fit import FittedParameters, nominal_values
from hoopd.plants.hoop.fitting.fit_percent import WINDOW_S, score
from hoopd.plants.hoop.fitting.free_parameters import PRIOR
from hoopd.plants.hoop.fitting.identifiability import determined
from hoopd.plants.hoop.fitting.physical_parameters import Known, physical_from_entries
from hoopd.plants.hoop.kinematics import MEASURED, compare_kinematics, entries_covariance, known_from
from hoopd.plants.hoop.parameters import PARAMETER_UNITS, ParameterError
from hoopd.plants.hoop.recordings.fit_data import UNITS, prepare
from hoopd.plants.hoop.recordings.recorded_runs import Subject
from hoopd.plants.hoop.recordings.suspicions import suspicions
from hoopd.plants.hoop.thesis import table_words
from hoopd.plants.likelihood.prediction_error import PredictionSolution
from hoopd.plants.model_file import load_model
from hoopd.recording.edit import has_times
from hoopd.recording.recording import Recording

# What a laboratory can weigh and measure. It is believed widely, never taken for given: a recording may have been made
# with another ball.
GEOMETRY = ("mb", "Ro", "Rb")

# Points of fit that no noise explains.
WORSE_PERCENT = 2.0
COLOURED = {
    "output": "residuals are coloured (the model misses something): the intervals count their correlation, "
    "and may still be half as wide as they should be: compare --method prediction",
    "prediction": "innovations are not white: the intervals count it; for free runs prefer --method output",
}
AGELESS = (
    "all samples are taken at their row's time; if camera or board answer late, say so with --age (docs/guides/fit.md)"
)


Progress = Callable[[str], None]


def record(
    found: FittedParameters,
    base: ModelFile,
    options: FitOptions,
    train: Mapping[str, Recording],
    held: Mapping[str, Recording],
    progress: Progress,
) -> dict[str, Any]:
    """Everything that a fit says; recordings by the names they were given."""
    progress("scoring")
    judged = _judged(found, train, held)
    result = {
        "structure": found.structure,
        "method": found.settings.method,
        "channels": list(found.channels),
        "starts": len(found.runs),
        "converged": found.solution.converged,
        "parameters": _parameters(found),
        "fit": judged,
        "residuals": _residuals(found),
        "correlation": _correlation(found),
        "notes": [*_notes(found, [*train.values(), *held.values()]), *_worse(judged)],
    }
    return result | {**_noise(found), **_physics(found, base, [*train.values()], options, progress)}


def _worse(judged: dict[str, Any]) -> list[str]:
    """Held-out runs that the fitted model repeats worse than the model it started from."""
    return [
        f"{name}: {channel} is repeated worse than by the model it started from ({row['fitted']:.1f} against "
        f"{row['nominal']:.1f} %): the fit learned what is not there in this recording, or the device has changed"
        for name, rows in judged.get("holdout", {}).items()
        for channel, row in rows.items()
        if None not in (row["fitted"], row["nominal"]) and row["fitted"] < row["nominal"] - WORSE_PERCENT
    ]


def _parameters(found: FittedParameters) -> dict[str, Any]:
    intervals, units = found.intervals, PARAMETER_UNITS[found.structure]
    return {
        name: {
            "value": found.values[name],
            "unit": units[name],
            "ci95": list(intervals[name]) if name in intervals else None,
            "nominal": found.nominal[name],
        }
        for name in units
        if name in intervals or name in found.settings.fixed
    }


def _judged(found: FittedParameters, train: Mapping[str, Recording], held: Mapping[str, Recording]) -> dict[str, Any]:
    """Percent of fit by recording and channel: what it started from, and what was found; of one free run over the
    whole recording and of windows."""
    subjects = {"nominal": found.nominal, "fitted": found.values}
    judged: dict[str, Any] = {}
    for part, recordings in (("train", train), ("holdout", held)):
        if recordings:
            judged[part] = {name: _scores(found, subjects, one) for name, one in recordings.items()}
    return judged


def _scores(
    fitted: FittedParameters, subjects: Mapping[str, Mapping[str, float]], recording: Recording
) -> dict[str, Any]:
    columns: dict[str, dict[str, Any]] = {}
    settings = fitted.settings
    for label, values in subjects.items():
        for suffix, window_s in (("", None), (f"_{WINDOW_S:g}s", WINDOW_S)):
            subject = Subject(fitted.structure, values, effects=settings.effects)
            found = score(subject, recording, window_s=window_s, encoder_counts=settings.encoder_counts)
            for channel, one in found.channels.items():
                row = columns.setdefault(channel, {})
                row[label + suffix] = number(one.nrmse_percent)
                row |= {"samples": one.samples, "set_aside": one.set_aside}
    return columns


def _residuals(found: FittedParameters) -> dict[str, Any]:
    return {
        name: {
            "sigma": found.solution.sigma[name],
            "unit": UNITS[name],
            "samples": int(sum(len(e[name]) for e in found.solution.residuals if name in e)),
            "memory_samples": memory,
        }
        for name, memory in found.uncertainty.memory.items()
    }


def _correlation(found: FittedParameters) -> dict[str, Any]:
    return {"names": list(found.solution.names), "matrix": np.round(found.uncertainty.correlation, 6).tolist()}


def _notes(found: FittedParameters, recordings: Sequence[Recording]) -> list[str]:
    notes = [f"{one.source}: {text}" for one in recordings for text in suspicions(one)]
    notes += [text for one in recordings for text in off_words(one)]
    aside: dict[tuple[str, str], int] = {}
    for run_ in found.runs:
        for name, count in run_.set_aside.items():
            aside[run_.recording, name] = aside.get((run_.recording, name), 0) + count
    notes += [
        f"{rec}: {n} samples of {name} repeat the last one and do not count" for (rec, name), n in aside.items() if n
    ]
    if found.settings.effects:
        notes.append(f"the model's effects are held as they are: {', '.join(found.settings.effects.names)}")
        notes += memory_words(found.settings.effects.plant, found.settings.effects.effects())
    if "theta_rate" in found.channels and not found.settings.channels:
        notes.append("the model does not follow the hoop's angle to the encoder's counts: its rate was fitted instead")
    if any(found.uncertainty.memory.values()):
        notes.append(COLOURED[found.settings.method])
        notes += [AGELESS] if not all(has_times(one, "y") or has_times(one, "psi") for one in recordings) else []
    if not found.solution.converged:
        notes.append("the search ended before it had converged")
    return notes


def _noise(found: FittedParameters) -> dict[str, Any]:
    """Noise levels of a prediction-error fit, as the daemon's filter takes them."""
    if found.prediction is None or not isinstance(found.solution, PredictionSolution):
        return {}
    intervals = found.prediction.noise
    levels = {
        name: {
            "value": level,
            "unit": NOISE_UNITS[name],
            "ci95": [number(one) for one in intervals[name]] if name in intervals else None,
        }
        for name, level in found.solution.levels.items()
    }
    white = {
        name: {"mean_square": one.mean_square, "lag1": one.lag1, "p_value": one.p_value}
        for name, one in found.prediction.whiteness.items()
    }
    return {"noise": levels, "innovations": white, "log_likelihood": found.solution.log_likelihood}


def _physics(
    found: FittedParameters, base: ModelFile, train: Sequence[Recording], options: FitOptions, progress: Progress
) -> dict[str, Any]:
    """What the parameters mean beyond themselves: what is not determined, what they are made of, which kinematics."""
    judged = determined(found.solution, found.uncertainty, found.structure)
    result: dict[str, Any] = {"undetermined": plain(judged)}
    device = _device(base, found.settings.fixed)
    if found.structure == "entries" and found.movings == ("both",):
        progress("physical parameters of the entries")
        asked = options.model is not None or options.kinematics
        printed = table_words() if asked and base.name == "thesis" else []
        try:
            result["physical"] = _second_step(found, device, printed)
        except (np.linalg.LinAlgError, ArithmeticError, ParameterError):  # entries far from those of any device
            result["no_physical_parameters"] = "the search for positive parameters of these entries ran away"
    if options.kinematics:
        progress("kinematics")
        runs = [
            one
            for one in prepare(train, ("theta_rate", "psi"), None, found.settings.encoder_counts)
            if one.moving == "both"
        ]
        if not runs:
            raise InputError("--kinematics", "", "needs a recording in which both hoop and ball move")
        known = _known(base, device) if options.model is not None else ()  # else nobody has said that it was measured
        result["kinematics"] = plain(compare_kinematics(runs, device, known=known, progress=progress))
    return result


def _known(base: ModelFile, device: Mapping[str, float]) -> tuple[Known, ...]:
    """How well a model's device is known: what was fitted as well as its interval says, the rest as measured."""
    spread = {**MEASURED}
    for name, entry in base.parameters.items():
        if name in spread and entry.ci95 is not None:
            spread[name] = (entry.ci95[1] - entry.ci95[0]) / (2 * Z95 * entry.value)
    return known_from(device, spread)


def _device(base: ModelFile, fixed: Mapping[str, float]) -> dict[str, float]:
    """What the device is believed to be before any data: the model it started from, where that is physical, else the
    shipped one with its geometry; what the user fixed is as he said."""
    shipped = nominal_values(load_model(defaults_folder() / START_MODELS["rolling"]), "rolling")
    own = {**base.values(), **fixed}
    return {name: own.get(name, value) for name, value in shipped.items()}


def _second_step(found: FittedParameters, device: Mapping[str, float], printed: list[str]) -> dict[str, Any]:
    """Entries to positive physical parameters under both kinematics, with the misfit that remains."""
    entries = {name: found.values[name] for name in found.solution.names}
    if len(entries) != len(ENTRIES):
        return {}
    covariance = entries_covariance(found.solution, found.uncertainty)
    if not np.isfinite(covariance).all():  # an entry that nothing determines: `undetermined` says which
        return {}
    known = [Known(name, device[name], PRIOR[name]) for name in GEOMETRY]
    made: dict[str, Any] = {"words": [*constraint_words(entries, covariance), *printed]}
    for kinematics in ("rolling", "published"):
        one = physical_from_entries(kinematics, entries, device, covariance=covariance, fixed=("g",), known=known)
        made[kinematics] = {
            "parameters": one.parameters,
            "misfit_percent": {name: 100.0 * miss.relative for name, miss in one.misfit.items()},
        }
        made["words"] += [f"{kinematics}: {text}" for text in one.words]
    return made
