"""`hoopd fit`: recordings to a model file, with intervals, what is not determined, and the fit on data never fitted.

Rules of this file: files in, a result record, a model file and a figure out; the mathematics is in `hoopd.ident`.
JSON knows no NaN: a fit that does not exist is null. Nothing is written before all is computed.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hoopd.bench.inputs import read_ages, read_model, read_recording, read_values
from hoopd.bench.simulate import number, off_words
from hoopd.files import InputError
from hoopd.ident.constraints import constraint_words
from hoopd.ident.determined import determined
from hoopd.ident.experiments import CHANNELS, UNITS, prepare
from hoopd.ident.fit import METHODS, Fit, Settings, fit, model_file, nominal_values
from hoopd.ident.freerun import Subject
from hoopd.ident.gaussnewton import LOSSES
from hoopd.ident.kinematics import compare_kinematics, entries_covariance
from hoopd.ident.noise import NOISE_UNITS
from hoopd.ident.parameters import PRIOR, Prior, scale_of
from hoopd.ident.physical import Known, physical_from_entries
from hoopd.ident.plain import plain
from hoopd.ident.prediction import PredictionSolution
from hoopd.ident.score import WINDOW_S, score
from hoopd.ident.thesis import table_words
from hoopd.modelfiles import ModelFile, model_text, parse_model
from hoopd.physics.entries import ENTRIES
from hoopd.physics.plant import PARAMETER_UNITS, STRUCTURES, ParameterError, check_parameters
from hoopd.recording.bytesof import check_target, replace_file
from hoopd.recording.edit import has_times
from hoopd.recording.recording import Recording
from hoopd.recording.suspicions import suspicions
from hoopd.shipped import START_MODELS, defaults_folder

# What a laboratory can weigh and measure. It is believed widely, never taken for given: a recording may have been made
# with another ball.
GEOMETRY = ("mb", "Ro", "Rb")

MISSED_PERCENT = 0.1  # of an entry; what the positive parameters miss less is the rounding of a fit

Progress = Callable[[str], None]

DIVERGED = "no finite result from this start; look at --model, --fix, --prior, or take --window 1"

COLOURED = {
    "output": "residuals are coloured (the model misses something): the intervals count their correlation, "
    "and may still be half as wide as they should be: compare --method prediction",
    "prediction": "innovations are not white: the intervals count it; for free runs prefer --method output",
}
AGELESS = "all samples are taken at their row's time; if camera or board answer late, say so with --age (docs/fit.md)"


class Wish(NamedTuple):
    """What the command line asks for, as text."""

    structure: str = "entries"
    model: Path | None = None
    columns: str | None = None
    age: str = ""
    free: str = ""
    fix: Sequence[str] = ()
    priors: Sequence[str] = ()
    channels: str = ""
    window_s: float | None = None
    loss: str = "linear"
    method: str = "output"
    kinematics: bool = False


def run(
    recordings: Sequence[str],
    holdout: Sequence[str] = (),
    wish: Wish | None = None,
    *,
    out: Path | None = None,
    figure: Path | None = None,
    progress: Progress = lambda text: None,
) -> dict[str, Any]:
    """Fit, judge, write; the result as a record. InputError when anything cannot be used or written."""
    wish = wish or Wish()
    _check_targets(out, figure)
    base, settings = _settings(wish)
    nominal = nominal_values(base, wish.structure)
    train = [read_recording(text, wish.columns, wish.age) for text in recordings]
    held = [read_recording(text, wish.columns, wish.age) for text in holdout]
    found = _fitted(train, nominal, settings, progress)
    progress("scoring")
    judged = _judged(found, dict(zip(recordings, train, strict=True)), dict(zip(holdout, held, strict=True)))
    result = {
        "structure": found.structure,
        "method": settings.method,
        "channels": list(found.channels),
        "starts": len(found.runs),
        "converged": found.solution.converged,
        "parameters": _parameters(found),
        "fit": judged,
        "residuals": _residuals(found),
        "correlation": _correlation(found),
        "notes": _notes(found, [*train, *held]),
    }
    result |= {"age_s": read_ages(wish.age)} if wish.age else {}
    result |= {**_noise(found), **_physics(found, base, train, wish, progress)}
    _write(found, base, train, out, figure)
    return {**result, **{key: str(path) for key, path in (("out", out), ("figure", figure)) if path is not None}}


def _fitted(train: Sequence[Recording], nominal: Mapping[str, float], settings: Settings, progress: Progress) -> Fit:
    """The fit; InputError when the numbers leave the computer's range on the way."""
    try:
        found = fit(train, nominal, settings, progress)
    except InputError:
        raise
    except (np.linalg.LinAlgError, ArithmeticError, ParameterError) as error:
        raise InputError("fit", "", f"{DIVERGED} ({error})") from None
    if not np.isfinite([*found.values.values()]).all():
        raise InputError("fit", "", DIVERGED)
    return found


# ---------------------------------------------------------------------------------------------- wishes


def _check_targets(out: Path | None, figure: Path | None) -> None:
    """Said before the work, not after it."""
    if out is not None:
        check_target(out, "--out")
    if figure is not None:
        from hoopd.plots.style import check_path

        check_path(figure)


def _settings(wish: Wish) -> tuple[ModelFile, Settings]:
    _one_of("--structure", wish.structure, STRUCTURES)
    _one_of("--loss", wish.loss, LOSSES)
    _one_of("--method", wish.method, METHODS)
    base = read_model(wish.model or defaults_folder() / START_MODELS[wish.structure])
    nominal = nominal_values(base, wish.structure)
    names = tuple(PARAMETER_UNITS[wish.structure])
    if wish.window_s is not None and not 0.2 <= wish.window_s <= 1e4:
        raise InputError("--window", "", f"must be 0.2 to 10000 s, not {wish.window_s:g}")
    return base, Settings(
        structure=wish.structure,
        free=_names("--free", wish.free, names),
        fixed=_fixed(wish.fix, names, nominal, wish.structure),
        priors=_priors(wish.priors, names, wish.structure),
        channels=_names("--channels", wish.channels, CHANNELS),
        window_s=wish.window_s,
        loss=wish.loss,
        method=wish.method,
        encoder_counts=base.device.encoder_counts,
    )


def _one_of(option: str, value: str, known: Sequence[str]) -> None:
    if value not in known:
        raise InputError(option, "", f"unknown {value!r}; known: {', '.join(known)}")


def _names(option: str, text: str, known: Sequence[str]) -> tuple[str, ...]:
    names = tuple(part.strip() for part in text.split(",") if part.strip())
    for name in names:
        _one_of(option, name, known)
    return names


def _fixed(
    texts: Sequence[str], names: tuple[str, ...], nominal: Mapping[str, float], structure: str
) -> dict[str, float]:
    """ "mb=0.06", or "mb" alone: at its nominal value."""
    fixed: dict[str, float] = {}
    for part in (part for text in texts for part in text.split(",") if part.strip()):
        name = part.strip()
        if "=" in part:
            fixed |= read_values("--fix", part, names)
        else:
            _one_of("--fix", name, names)
            fixed[name] = nominal[name]
    _possible("--fix", structure, {**nominal, **fixed})
    return fixed


def _possible(option: str, structure: str, values: Mapping[str, float]) -> None:
    try:
        check_parameters(structure, values)
    except ParameterError as error:
        raise InputError(option, error.name, error.reason) from None


def _priors(texts: Sequence[str], names: tuple[str, ...], structure: str) -> dict[str, Prior]:
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
        if value <= 0.0 and scale_of(structure, (name,), {name: 1.0}).positive[0]:
            raise InputError("--prior", name, f"must be positive, not {value:g}")
        priors[name] = Prior(value, width)
    return priors


# ---------------------------------------------------------------------------------------------- results


def _parameters(found: Fit) -> dict[str, Any]:
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


def _judged(found: Fit, train: Mapping[str, Recording], held: Mapping[str, Recording]) -> dict[str, Any]:
    """Percent of fit by recording and channel: what it started from, and what was found; of one free run over the
    whole recording and of windows."""
    subjects = {"nominal": found.nominal, "fitted": found.values}
    judged: dict[str, Any] = {}
    for part, recordings in (("train", train), ("holdout", held)):
        if recordings:
            counts = found.settings.encoder_counts
            judged[part] = {name: _scores(found.structure, subjects, one, counts) for name, one in recordings.items()}
    return judged


def _scores(
    structure: str, subjects: Mapping[str, Mapping[str, float]], recording: Recording, encoder_counts: int
) -> dict[str, Any]:
    columns: dict[str, dict[str, Any]] = {}
    for label, values in subjects.items():
        for suffix, window_s in (("", None), (f"_{WINDOW_S:g}s", WINDOW_S)):
            found = score(Subject(structure, values), recording, window_s=window_s, encoder_counts=encoder_counts)
            for channel, one in found.channels.items():
                row = columns.setdefault(channel, {})
                row[label + suffix] = number(one.nrmse_percent)
                row |= {"samples": one.samples, "set_aside": one.set_aside}
    return columns


def _residuals(found: Fit) -> dict[str, Any]:
    return {
        name: {
            "sigma": found.solution.sigma[name],
            "unit": UNITS[name],
            "samples": int(sum(len(e[name]) for e in found.solution.residuals if name in e)),
            "memory_samples": memory,
        }
        for name, memory in found.uncertainty.memory.items()
    }


def _correlation(found: Fit) -> dict[str, Any]:
    return {"names": list(found.solution.names), "matrix": np.round(found.uncertainty.correlation, 6).tolist()}


def _notes(found: Fit, recordings: Sequence[Recording]) -> list[str]:
    notes = [f"{one.source}: {text}" for one in recordings for text in suspicions(one)]
    notes += [text for one in recordings for text in off_words(one)]
    aside: dict[tuple[str, str], int] = {}
    for run_ in found.runs:
        for name, count in run_.set_aside.items():
            aside[run_.recording, name] = aside.get((run_.recording, name), 0) + count
    notes += [
        f"{rec}: {n} samples of {name} repeat the last one and do not count" for (rec, name), n in aside.items() if n
    ]
    if "theta_rate" in found.channels and not found.settings.channels:
        notes.append("the model does not follow the hoop's angle to the encoder's counts: its rate was fitted instead")
    if any(found.uncertainty.memory.values()):
        notes.append(COLOURED[found.settings.method])
        notes += [AGELESS] if not all(has_times(one, "y") or has_times(one, "psi") for one in recordings) else []
    if not found.solution.converged:
        notes.append("the search ended before it had converged")
    return notes


def _noise(found: Fit) -> dict[str, Any]:
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


def _physics(found: Fit, base: ModelFile, train: Sequence[Recording], wish: Wish, progress: Progress) -> dict[str, Any]:
    """What the parameters mean beyond themselves: what is not determined, what they are made of, which kinematics."""
    judged = determined(found.solution, found.uncertainty, found.structure)
    result: dict[str, Any] = {"undetermined": plain(judged)}
    device = _device(base, found.settings.fixed)
    if found.structure == "entries" and found.movings == ("both",):
        progress("physical parameters of the entries")
        asked = wish.model is not None or wish.kinematics
        printed = table_words() if asked and base.name == "thesis" else []
        try:
            result["physical"] = _second_step(found, device, printed)
        except (np.linalg.LinAlgError, ArithmeticError, ParameterError):  # entries far from those of any device
            result["no_physical_parameters"] = "the search for positive parameters of these entries ran away"
    if wish.kinematics:
        progress("kinematics")
        runs = [
            one
            for one in prepare(train, ("theta_rate", "psi"), None, found.settings.encoder_counts)
            if one.moving == "both"
        ]
        if not runs:
            raise InputError("--kinematics", "", "needs a recording in which both hoop and ball move")
        # without a model file nobody has said that the device was measured
        known = None if wish.model is not None else ()
        result["kinematics"] = plain(compare_kinematics(runs, device, known=known, progress=progress))
    return result


def _device(base: ModelFile, fixed: Mapping[str, float]) -> dict[str, float]:
    """What the device is believed to be before any data: the model it started from, where that is physical, else the
    shipped one with its geometry; what the user fixed is as he said."""
    shipped = nominal_values(read_model(defaults_folder() / START_MODELS["rolling"]), "rolling")
    own = {**base.values(), **fixed}
    return {name: own.get(name, value) for name, value in shipped.items()}


def _second_step(found: Fit, device: Mapping[str, float], printed: list[str]) -> dict[str, Any]:
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


def for_terminal(result: dict[str, Any]) -> dict[str, Any]:
    """The result as a person reads it: names of files without their folders, no matrices, sentences at the end."""
    hidden = ("correlation", "fit", "undetermined", "physical", "kinematics")
    shown = {key: value for key, value in result.items() if key not in hidden}
    shown["parameters"] = {name: _with_half_width(one) for name, one in result["parameters"].items()}
    for part, files in result["fit"].items():
        for name, rows in files.items():
            table = {channel: _percent(row) for channel, row in rows.items()}
            shown[f"fit of {Path(name).name} ({part})"] = table
    words = [*result["undetermined"]["words"]]
    if result.get("physical"):
        shown |= _made_of(result["physical"])
        words += result["physical"]["words"]
    words += result.get("kinematics", {}).get("words", [])
    shown |= {key: shown.pop(key) for key in ("out", "figure") if key in shown}  # last
    shown |= _next(result)
    shown["notes"] = [*result["notes"], *words]
    return shown


def _next(result: dict[str, Any]) -> dict[str, str]:
    """What a model file is for; fewer than eight entries are a bare hoop or a lone ball."""
    if "out" not in result or (result["structure"] == "entries" and "L2" not in result["parameters"]):
        return {}
    return {"next": f"hoopd design lqg --model {shlex.quote(result['out'])} --out lqg.yaml"}


def _with_half_width(parameter: dict[str, Any]) -> dict[str, Any]:
    """The row of a parameter with half of its interval in percent: digits alone do not show a narrow one."""
    value, ends = parameter["value"], parameter["ci95"]
    half = "-"
    if ends is not None and value:
        percent = 50.0 * (ends[1] - ends[0]) / abs(value)
        half = f"{percent:.2g} %" if percent < 10.0 else f"{percent:.0f} %"
    return {"value": value, "unit": parameter["unit"], "+-": half, "ci95": ends, "nominal": parameter["nominal"]}


def _made_of(physical: dict[str, Any]) -> dict[str, Any]:
    """Parameters of the entries under both kinematics, and what the entries miss."""
    kinds = [kind for kind in ("rolling", "published") if kind in physical]
    units = PARAMETER_UNITS["rolling"]
    values = {
        name: {**{kind: physical[kind]["parameters"][name] for kind in kinds}, "unit": unit}
        for name, unit in units.items()
    }
    misfit = {
        name: {kind: f"{physical[kind]['misfit_percent'][name]:+.1f} %" for kind in kinds}
        for name in physical[kinds[0]]["misfit_percent"]
        if any(abs(physical[kind]["misfit_percent"][name]) > MISSED_PERCENT for kind in kinds)
    }
    shown = {"positive parameters nearest to the entries": values}
    return {**shown, "what their entries miss": misfit} if misfit else shown


def _percent(row: dict[str, Any]) -> dict[str, Any]:
    return {
        name.replace("_", ", "): "-" if row[name] is None else f"{row[name]:.1f} %"
        for name in ("nominal", "fitted", f"nominal_{WINDOW_S:g}s", f"fitted_{WINDOW_S:g}s")
        if name in row
    }


def _write(found: Fit, base: ModelFile, train: Sequence[Recording], out: Path | None, figure: Path | None) -> None:
    if out is not None:
        text = model_text(model_file(found, base, out.stem))
        parse_model(text, out)  # never a model that no command could load
        replace_file(out, text.encode())
    if figure is not None:
        from hoopd.plots.simulation import draw_simulation
        from hoopd.plots.style import save

        whole = score(Subject(found.structure, found.values), train[0], encoder_counts=found.settings.encoder_counts)
        save(draw_simulation(whole, train[0], out.stem if out else found.structure), figure)
