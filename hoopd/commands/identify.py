"""`hoopd identify`: recordings to a linear model by any of the methods, compared on data it was not fitted to.

Rules of this file: files in, files out; the mathematics is in `hoopd.ident`. Nothing is written before all is known.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.commands.identify_columns import column_choice, offsets_of, read_columns, without
from hoopd.commands.identify_data import OUTPUTS, check_held, read, split
from hoopd.commands.identify_figures import HOOP_UNITS, draw
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.identify import IdentifyOptions
from hoopd.commands.output_files import check_targets
from hoopd.commands.plant_inputs import other_plant
from hoopd.files.identified import IdentifiedFile, identified_text
from hoopd.files.reading import InputError
from hoopd.files.whole_files import replace_file
from hoopd.ident.data import Data
from hoopd.ident.doubts import IdentificationWarning
from hoopd.ident.identified_model import IdentifiedModel
from hoopd.ident.measures import fit_percent
from hoopd.ident.models import Innovations, Polynomials
from hoopd.ident.polynomial.arx import varx
from hoopd.ident.polynomial.pem import armax, bj, oe
from hoopd.ident.prediction import predict
from hoopd.ident.residualtests import residuals
from hoopd.ident.result_summary import estimates
from hoopd.ident.stacked_models import stack
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.subspace import subspaceid
from hoopd.ident.structure_search import identify
from hoopd.ident.uncertain import matrix_spread
from hoopd.plants.declaration import Plant
from hoopd.plots import style

Progress = Callable[[str], None]

HOOP_OUTPUTS = ("theta", "dtheta", "psi")
AUTO = "auto"
METHODS = ("arx", "armax", "oe", "bj", "subspace", "pem", AUTO)
STATE_SPACE = ("subspace", "pem")
POLYNOMIAL = ("arx", "armax", "oe", "bj")
# Samples ahead of the predictions of the hoop that are drawn; of columns the simulation is.
AHEAD = 10
# Candidates that are told, and those of other families that are drawn.
MOST_ROWS, MOST_BESIDE = 12, 2
COLUMNS_ALONE = "goes with columns: --input COLUMN,... --output COLUMN,..."
HORIZONS = {"1": 1.0, "10": 10.0, "simulation": np.inf}


@dataclass(frozen=True)
class IdentifyTask:
    """What is asked for: data of the fit and of the comparison, units, operating point, and what was said of them."""

    options: IdentifyOptions
    train: list[Data]
    held: list[Data]
    how: str
    notes: list[str]
    units: Mapping[str, str] = field(default_factory=dict)
    offsets: Mapping[str, float] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Identified:
    """The model, others to stand beside it, and what is told of the choice."""

    name: str
    model: IdentifiedModel
    beside: Mapping[str, IdentifiedModel]
    notes: list[str]
    told: Mapping[str, Any] = field(default_factory=dict)


def run(options: IdentifyOptions, *, progress: Progress = lambda text: None) -> dict[str, Any]:
    """Identify, compare, write and draw; the result as plain data. InputError: nothing that can be used."""
    check_targets([*options.recordings, *options.holdout], {"--out": options.out, "--figure": options.figure})
    if options.figure is not None:
        style.check_path(options.figure)
    task = _task(options, progress)
    found = _identified(task, progress)
    progress("comparing")
    form = found.model.state_space
    percent, lost = _percents(form, task.held)
    try:
        report = residuals(found.model, task.held)
    except ValueError as error:
        raise InputError("--method", task.options.method, str(error)) from None
    notes = list(dict.fromkeys([*task.notes, *found.notes, *lost, *report.warnings]))
    if options.out is not None:
        replace_file(options.out, identified_text(_file(task, found, percent, notes)).encode())
    if options.figure is not None:
        progress("drawing")
        shown = max(task.held, key=lambda one: one.n)
        horizon = math.inf if task.columns else AHEAD
        models, units = {found.name: found.model, **found.beside}, task.units
        if options.detrend:  # each stretch had a mean of its own
            units = {name: f"{units.get(name, '')} minus its mean".strip() for name in shown.outputs}
        draw(models, shown, task.how, options.figure, units, horizon, task.offsets)
    return {
        "method": task.options.method,
        **({"structure": found.name} if task.options.method == AUTO else {}),
        "states": form.nx,
        "outputs": list(form.outputs),
        "held_out": task.how,
        "fit_percent": percent,
        **found.told,
        "poles": [{"re": float(z.real), "im": float(z.imag)} for z in poles_of(form)],
        **({"estimates": estimates(found.model)} if task.columns else {}),
        "residual_tests": {one.name: {"p": one.chance, "passed": one.passed}
                           for one in (*report.white, *report.independent, *report.feedback)},
        "warnings": notes,
    }  # fmt: skip


# ---------------------------------------------------------------------------------------------- data


def _task(options: IdentifyOptions, progress: Progress) -> IdentifyTask:
    progress("reading the recordings")
    if options.plant is None and options.inputs:
        return _task_of_columns(options)
    for name in ("time", "step_s", "keep_means", "no_direct"):
        if getattr(options, name) != IdentifyOptions.__dataclass_fields__[name].default:
            raise InputError(
                option_name(IdentifyOptions, name), "", "goes with columns: --input COLUMN,... --output COLUMN,..."
            )
    plant = other_plant(options.plant)
    options = replace(options, outputs=options.outputs or (OUTPUTS if plant is None else tuple(plant.channels)))
    options = replace(options, method=options.method or "arx")
    if plant is not None and not options.inputs:
        options = replace(options, inputs=tuple(one.name for one in plant.inputs))
    _check(options, plant)
    train, said = read(options.recordings, options, plant)
    held, more = read(options.holdout, options, plant)
    return _divided(IdentifyTask(options, train, held, "", [*said, *more], HOOP_UNITS if plant is None else {}))


def _task_of_columns(options: IdentifyOptions) -> IdentifyTask:
    if options.columns is not None or options.delay_s is not None or options.detrend:
        raise InputError(
            "--input", "", "names the columns: --columns, --delay and --detrend go with the hoop or a --plant"
        )
    choice = column_choice(options.inputs, options.outputs, options.time, options.step_s)
    options = replace(
        options, method=options.method or AUTO, outputs=tuple(choice.outputs), inputs=tuple(choice.inputs)
    )
    _check_method(options)
    train, units, said = read_columns(options.recordings, choice, options.hold)
    held, more, notes = read_columns(options.holdout, choice, options.hold) if options.holdout else ([], {}, [])
    columns = {name: column for name, (column, _) in {**choice.inputs, **choice.outputs}.items()}
    columns |= {"t": options.time} if options.time else {}
    task = _divided(
        IdentifyTask(
            options,
            train,
            held,
            "",
            [*said, *notes],
            more | units,
            {},
            columns | ({"t": options.time} if options.time else {}),
        )
    )
    offsets = {} if options.keep_means else offsets_of(task.train)
    return replace(
        task, offsets=offsets, train=[without(one, offsets) for one in task.train],
        held=[without(one, offsets) for one in task.held],
    )  # fmt: skip


def _divided(task: IdentifyTask) -> IdentifyTask:
    """The same with a part held out, where no other recording is."""
    options = task.options
    how = ", ".join(options.holdout) or "the last third of every recording"
    train, held = (task.train, task.held) if task.held else split(task.train)
    check_held(train, held, ", ".join(options.holdout) or f"{', '.join(options.recordings)}, last third")
    return replace(task, train=train, held=held, how=how)


# ---------------------------------------------------------------------------------------------- models


def _check(options: IdentifyOptions, plant: Plant | None) -> None:
    _check_method(options)
    known = HOOP_OUTPUTS if plant is None else tuple(plant.channels)
    if plant is not None and not plant.inputs:
        raise InputError("--plant", plant.name, "has no input: there is nothing to identify a response to")
    if plant is not None and options.delay_s is not None:
        raise InputError("--delay", "", "is of the hoop's pictures")
    driving = () if plant is None else tuple(one.name for one in plant.inputs)
    if set(options.inputs) - set(driving) or len(set(options.inputs)) != len(options.inputs):
        known_inputs = ", ".join(driving) or "none: the hoop has its torque alone"
        raise InputError("--inputs", "", f"different ones of {known_inputs}, not {','.join(options.inputs)}")
    if not options.outputs or set(options.outputs) - set(known) or len(set(options.outputs)) != len(options.outputs):
        raise InputError("--outputs", "", f"different ones of {', '.join(known)}, not {','.join(options.outputs)}")
    if options.delay_s is not None and set(options.outputs) - set(OUTPUTS):
        raise InputError("--delay", "", f"is known of {', '.join(OUTPUTS)} only")


def _check_method(options: IdentifyOptions) -> None:
    if options.method not in METHODS:
        raise InputError("--method", "", f"unknown method {options.method!r}; known: {', '.join(METHODS)}")
    if not 2 <= len(options.orders) <= 3 or min(options.orders) < 1:
        raise InputError("--orders", "", "two or three whole numbers from 1 on: na,nb or na,nb,nc")
    if len(options.orders) == 3 and options.method in ("arx", "oe"):
        reason = f"{options.method} takes na,nb; the samples by which inputs act late are --input-delay"
        raise InputError("--orders", "", reason)
    if options.input_delay < 0 or (options.input_delay and options.method not in POLYNOMIAL):
        raise InputError("--input-delay", "", f"from 0 on, with {', '.join(POLYNOMIAL)}")
    if options.order is not None and options.order < 1:
        raise InputError("--order", "", f"at least 1, not {options.order}")


def _identified(task: IdentifyTask, progress: Progress) -> Identified:
    """The model that was asked for, or the best of all; what it warned of."""
    options, where = task.options, ", ".join(task.options.recordings)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", IdentificationWarning)
        try:
            if options.method == AUTO:
                found = _searched(task, progress)
            else:
                progress(f"fitting {options.method}")
                found = Identified(options.method, _by_method(task.train, options), {}, [])
        except (ValueError, ArithmeticError) as error:
            raise InputError(where, "", str(error)) from None
    notes = [str(one.message) for one in caught if issubclass(one.category, IdentificationWarning)]
    return replace(found, notes=[*found.notes, *dict.fromkeys(notes)])


def _searched(task: IdentifyTask, progress: Progress) -> Identified:
    """The best of all structures, with the best of other families to stand beside it."""
    # what arrives in a tick of the daemon cannot answer to that tick's torque
    found = identify(task.train, direct=bool(task.columns) and not task.options.no_direct, progress=progress)
    beside: dict[str, IdentifiedModel] = {}
    families = {found.best.family}
    for one in found.candidates:
        if one.family not in families and one.stable and len(beside) < MOST_BESIDE:
            families.add(one.family)
            beside[one.name] = one.model
    rows = {
        one.name: {"parameters": one.parameters, **{name: round(fit, 2) for name, fit in one.fit.items()},
                   "mean": round(one.score, 2)}
        for one in found.candidates[:MOST_ROWS]
    }  # fmt: skip
    told = {"recommendation": found.recommendation, "candidates": rows}
    return Identified(found.best.name, found.model, beside, [], told)


def _by_method(train: Sequence[Data], options: IdentifyOptions) -> IdentifiedModel:
    late = 1 + options.input_delay
    if options.method == "arx":
        na, nb = options.orders[:2]
        return varx(train, na, nb, late)
    if options.method in STATE_SPACE:
        # what a tick sends answers what it has read: no input tells an output of its own row
        if options.method == "subspace":
            return subspaceid(train, options.order, direct=False)
        return pem(train, options.order, direct=False)
    na, nb, nc = (*options.orders, options.orders[0])[:3]
    fits: Mapping[str, Callable[[Sequence[Data]], Polynomials]] = {
        "armax": lambda each: armax(each, na, nb, nc, late),
        "oe": lambda each: oe(each, nb, na, late),
        "bj": lambda each: bj(each, nb, nc, nc, na, late),
    }
    rows = [fits[options.method]([one.channels([i]) for one in train]) for i in range(train[0].ny)]
    return rows[0] if len(rows) == 1 else stack(rows)


def _percents(model: Innovations, held: Sequence[Data]) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Fit of each output over all held-out data by horizon; none, in words, where a prediction diverges."""
    y, found, said = np.concatenate([one.y for one in held]), {}, []
    for name, horizon in HORIZONS.items():
        with np.errstate(over="ignore", invalid="ignore"):
            ahead = np.concatenate([predict(model, one, horizon) for one in held])
            fits = fit_percent(y, ahead)
        found[name] = {one: float(p) for one, p in zip(held[0].outputs, fits, strict=True) if np.isfinite(p)}
        if len(found[name]) < len(fits):
            what = "the simulation" if horizon == np.inf else f"the prediction {name} ahead"
            said.append(f"{what} diverges: the model is unstable, and there is no fit to tell")
    return found, said


def _file(
    task: IdentifyTask, found: Identified, percent: Mapping[str, dict[str, float]], notes: Sequence[str]
) -> IdentifiedFile:  # fmt: skip
    options, model = task.options, found.model.state_space
    r = np.zeros((model.ny, model.ny)) if model.r is None else model.r
    of_columns: dict[str, Any] = {}
    if task.columns:
        of_columns = {
            "structure": found.name,
            "units": dict(task.units),
            "operating_point": dict(task.offsets),
            "usual_size": _sizes(task.train),
            "columns": dict(task.columns),
            "estimates": estimates(found.model),
        }
    return IdentifiedFile(
        schema="hoopd.identified/1",
        name=options.method if options.out is None else options.out.stem,
        method=found.name.replace(",", " ").split()[0],
        sample_time_s=model.dt,
        inputs=[*task.train[0].inputs],
        outputs=list(options.outputs),
        **{name: getattr(model, name).tolist() for name in ("a", "b", "c", "d", "k")},
        r=r.tolist(),
        recordings=[Path(one).name for one in options.recordings],
        fit_percent={name: dict(one) for name, one in percent.items()},
        notes=list(notes),
        spread=matrix_spread(found.model).tolist(),
        **of_columns,
    )


def _sizes(each: Sequence[Data]) -> dict[str, float]:
    y, u = np.concatenate([one.y for one in each]), np.concatenate([one.u for one in each])
    names = (*each[0].outputs, *each[0].inputs)
    return dict(zip(names, [*np.nanstd(y, axis=0).tolist(), *u.std(axis=0).tolist()], strict=True))


def poles_of(model: Innovations) -> NDArray[np.complex128]:
    """The slowest first."""
    return np.asarray(sorted(np.linalg.eigvals(model.a), key=lambda z: -abs(z)), dtype=complex)
