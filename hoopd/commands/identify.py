"""`hoopd identify`: recordings to a linear model by any of the methods, compared on data it was not fitted to.

Rules of this file: files in, files out; the mathematics is in `hoopd.ident`. Nothing is written before all is known.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from hoopd.commands.identify_data import OUTPUTS, check_held, read, split
from hoopd.commands.identify_figures import draw, poles_of
from hoopd.commands.options.identify import IdentifyOptions
from hoopd.commands.output_files import check_targets
from hoopd.commands.plant_inputs import other_plant
from hoopd.files.identified import IdentifiedFile, identified_text
from hoopd.files.reading import InputError
from hoopd.files.whole_files import replace_file
from hoopd.ident.confidence import Estimated
from hoopd.ident.data import Data
from hoopd.ident.doubts import IdentificationWarning
from hoopd.ident.measures import fit_percent
from hoopd.ident.models import Innovations, Polynomials, state_space
from hoopd.ident.polynomial.arx import varx
from hoopd.ident.polynomial.pem import armax, bj, oe
from hoopd.ident.prediction import predict
from hoopd.ident.residualtests import residuals
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.subspace import subspaceid
from hoopd.plants.declaration import Plant
from hoopd.plots import style

Progress = Callable[[str], None]

HOOP_OUTPUTS = ("theta", "dtheta", "psi")
METHODS = ("arx", "armax", "oe", "bj", "subspace", "pem")
STATE_SPACE = ("subspace", "pem")
HORIZONS = {"1": 1.0, "10": 10.0, "simulation": np.inf}


def run(options: IdentifyOptions, *, progress: Progress = lambda text: None) -> dict[str, Any]:
    """Identify, compare, write and draw; the result as plain data. InputError: nothing that can be used."""
    recordings, holdout, out, figure = options.recordings, options.holdout, options.out, options.figure
    plant = other_plant(options.plant)
    options = replace(options, outputs=options.outputs or (OUTPUTS if plant is None else tuple(plant.channels)))
    if plant is not None and not options.inputs:
        options = replace(options, inputs=tuple(one.name for one in plant.inputs))
    _check(options, plant)
    check_targets([*recordings, *holdout], {"--out": out, "--figure": figure})
    if figure is not None:
        style.check_path(figure)
    progress("reading the recordings")
    train, said = read(recordings, options, plant)
    held, more = read(holdout, options, plant)
    how = ", ".join(holdout) or "the last third of every recording"
    if not held:
        train, held = split(train)
    check_held(train, held, ", ".join(holdout) or f"{', '.join(recordings)}, last third")
    progress(f"fitting {options.method}")
    model, parts, doubts = _identified(train, options, recordings)
    progress("comparing")
    percent, lost = _percents(model, held)
    try:
        report = residuals(model, held)
    except ValueError as error:
        raise InputError("--method", options.method, str(error)) from None
    notes = [*said, *more, *doubts, *lost, *report.warnings]
    file = _file(model, options, recordings, percent, notes, train[0].inputs)
    if figure is not None:
        draw(model, parts, options.method, max(held, key=lambda one: one.n), how, report, figure)
    if out is not None:
        replace_file(out, identified_text(file).encode())
    return {
        "method": options.method,
        "states": model.nx,
        "outputs": list(options.outputs),
        "held_out": how,
        "fit_percent": percent,
        "poles": [{"re": float(z.real), "im": float(z.imag)} for z in poles_of(model)],
        "residual_tests": {one.name: {"p": one.chance, "passed": one.passed}
                           for one in (*report.white, *report.independent, *report.feedback)},
        "warnings": notes,
    }  # fmt: skip


# ---------------------------------------------------------------------------------------------- models


def _check(options: IdentifyOptions, plant: Plant | None) -> None:
    if options.method not in METHODS:
        raise InputError("--method", "", f"unknown method {options.method!r}; known: {', '.join(METHODS)}")
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
    if not 2 <= len(options.orders) <= 3 or min(options.orders) < 1:
        raise InputError("--orders", "", "two or three whole numbers from 1 on: na,nb or na,nb,nc")
    if options.order is not None and options.order < 1:
        raise InputError("--order", "", f"at least 1, not {options.order}")


def _identified(
    train: Sequence[Data], options: IdentifyOptions, recordings: Sequence[str]
) -> tuple[Innovations, list[Estimated], list[str]]:
    """The model in innovation form, as its method gave it (a part an output, or one), and what that warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", IdentificationWarning)
        try:
            model, parts = _by_method(train, options)
        except (ValueError, ArithmeticError) as error:
            raise InputError(", ".join(recordings), "", str(error)) from None
    notes = [str(one.message) for one in caught if issubclass(one.category, IdentificationWarning)]
    return model, parts, list(dict.fromkeys(notes))


def _by_method(train: Sequence[Data], options: IdentifyOptions) -> tuple[Innovations, list[Estimated]]:
    if options.method == "arx":
        joint = varx(train, *options.orders[:2])
        return joint.state_space, [joint]
    if options.method in STATE_SPACE:
        model = subspaceid(train, options.order) if options.method == "subspace" else pem(train, options.order)
        return model, [model]
    na, nb, nc = (*options.orders, options.orders[0])[:3]
    fits: Mapping[str, Callable[[Sequence[Data]], Polynomials]] = {
        "armax": lambda each: armax(each, na, nb, nc),
        "oe": lambda each: oe(each, nb, na),
        "bj": lambda each: bj(each, nb, nc, nc, na),
    }
    rows = [fits[options.method]([one.channels([i]) for one in train]) for i in range(train[0].ny)]
    return beside([state_space(one) for one in rows]), [*rows]


def beside(models: Sequence[Innovations]) -> Innovations:
    """Models of one output each as one of all outputs, their states under each other."""
    first = models[0]
    r = block_diag(*(np.zeros((1, 1)) if one.r is None else one.r for one in models))
    return Innovations(
        block_diag(*(one.a for one in models)), np.vstack([one.b for one in models]),
        block_diag(*(one.c for one in models)), np.vstack([one.d for one in models]),
        block_diag(*(one.k for one in models)), first.dt, r=r, inputs=first.inputs,
        outputs=tuple(one.outputs[0] for one in models),
    )  # fmt: skip


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
    model: Innovations, options: IdentifyOptions, recordings: Sequence[str], percent: Mapping[str, dict[str, float]],
    notes: Sequence[str], inputs: Sequence[str],
) -> IdentifiedFile:  # fmt: skip
    r = np.zeros((model.ny, model.ny)) if model.r is None else model.r
    return IdentifiedFile(
        schema="hoopd.identified/1",
        name=options.method if options.out is None else options.out.stem,
        method=options.method,
        sample_time_s=model.dt,
        inputs=[*inputs],
        outputs=list(options.outputs),
        **{name: getattr(model, name).tolist() for name in ("a", "b", "c", "d", "k")},
        r=r.tolist(),
        recordings=[Path(one).name for one in recordings],
        fit_percent={name: dict(one) for name, one in percent.items()},
        notes=list(notes),
    )
