"""`hoopd design identified` without the hoop: a law for any identified model, in a file for a program of one's own.

    u = u0 - K x,   x+ = A x + B (u - u0),   x += M (y - y0 - C x)
K is linear-quadratic: deviations of outputs and inputs by their usual sizes in the data cost the same (Bryson's rule),
or by --weights. M is the stationary Kalman filter for the innovations k e of the model.

Rules of this file: a model's file and options in, a controller's file and a result out; nothing is written before all
is known.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from pathlib import Path
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.commands.inputs import read_values
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_inputs import number
from hoopd.design.linear_law import LinearLaw
from hoopd.design.lqg import kalman_gain, lqr, observer_law
from hoopd.design.margins import Margins, margins
from hoopd.design.poles import closed_loop_poles, unstable
from hoopd.design.worst_case import WorstCase, models_about, worst_of
from hoopd.files.identified import IdentifiedFile, load_identified
from hoopd.files.plant_controller import PlantControllerFile, PlantGains, parse_plant_controller, plant_controller_text
from hoopd.files.reading import InputError
from hoopd.files.records import between
from hoopd.files.shipped import way_to
from hoopd.files.whole_files import replace_file
from hoopd.plants.model_file import LARGEST, SMALLEST

Array = NDArray[np.float64]

HEAD = "Made by `hoopd design identified`: x += M (y - y0 - C x), u = u0 - K x, x = A x + B (u - u0)."
ASKED = ("law", "identified", "weights", "out", "json_path")
# Noise of the filter's states beside the model's own, as a share of the outputs': no mode goes unwatched.
LEAST_NOISE = 1e-6
# Models that the data leave open and that are asked at least.
LEAST_MODELS = 100


def design_for(path: Path, options: DesignOptions) -> dict[str, Any]:
    """Design, judge, write; the result as plain data. InputError: unusable input or an unstable loop."""
    _refuse_others(options)
    check_results(options.out, None)
    file = load_identified(path)
    sizes = _sizes(file, options)
    try:
        law = _law(file, sizes)
        poles = closed_loop_poles(law.loop)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise InputError("design identified", "", str(error)) from None
    if worst := unstable(poles):
        raise InputError("design identified", "", f"the closed loop is unstable: |z| = {abs(worst.z):.4g}")
    written = _file(file, law, path, options.out)
    if options.out is not None:
        text = plant_controller_text(written, HEAD)
        parse_plant_controller(text, options.out)
        replace_file(options.out, text.encode())
    found = margins(law.loop) if law.loop.ninputs == 1 else None
    open_ = _left_open(file, law) if found is not None else None
    return {
        "model": path.name,
        "controller": "" if options.out is None else options.out.name,
        "kind": written.kind,
        "sample_time_s": file.sample_time_s,
        "weights": {name: sizes[name] for name in (*file.outputs, *file.inputs)},
        "feedback": written.gains.feedback,
        "poles": [{"re": one.z.real, "im": one.z.imag} for one in poles],
        **({} if found is None else _margins(found)),
        **({} if open_ is None else {"worst_case": _worst(open_)}),
        "notes": [
            *([] if open_ is None or open_.stable else [_unstable_ones(open_)]),
            "every figure is of the model itself: try the law with little authority first",
        ],
    }


def _refuse_others(options: DesignOptions) -> None:
    for name, one in DesignOptions.__dataclass_fields__.items():
        if name not in ASKED and getattr(options, name) != one.default:
            raise InputError(option_name(DesignOptions, name), "", "has no meaning for a model of columns")


def _sizes(file: IdentifiedFile, options: DesignOptions) -> dict[str, float]:
    """What deviations cost the same: usual sizes in the data, unless told."""
    names = (*file.outputs, *file.inputs)
    usual = {name: file.usual_size.get(name, 1.0) or 1.0 for name in names}
    told = read_values("--weights", ",".join(options.weights), names) if options.weights else {}
    for name, value in told.items():
        between("--weights", name, value, SMALLEST, LARGEST)
    return usual | told


def _law(file: IdentifiedFile, sizes: Mapping[str, float]) -> LinearLaw:
    parts = file.matrices()
    if np.any(parts["d"] != 0.0):
        raise ValueError("the model answers in the sample in which its input acts: no law can see that")
    outputs, inputs = (np.array([sizes[name] for name in names]) for names in (file.outputs, file.inputs))
    a, b, c = parts["a"], parts["b"], parts["c"]
    weight = c.T @ np.diag(1.0 / outputs**2) @ c
    feedback = lqr(a, b, weight + LEAST_NOISE * np.trace(weight) / len(a) * np.eye(len(a)), np.diag(1.0 / inputs**2))
    noise = parts["k"] @ parts["r"] @ parts["k"].T
    driven = b @ np.diag(inputs**2) @ b.T * LEAST_NOISE
    gain = kalman_gain(a, c, noise + driven, parts["r"] + LEAST_NOISE * np.diag(outputs**2))
    model = control.ss(a, b, c, 0.0 * parts["d"], file.sample_time_s)
    return LinearLaw(feedback, gain, model, observer_law(model, gain, feedback) * model)


def _file(file: IdentifiedFile, law: LinearLaw, path: Path, out: Path | None) -> PlantControllerFile:
    rows = {
        "feedback": law.feedback, "filter": law.filter, "a": law.model.A, "b": law.model.B, "c": law.model.C
    }  # fmt: skip
    return PlantControllerFile(
        schema="hoopd.controller/1",
        name="identified" if out is None else out.stem,
        plant=str(path) if out is None else way_to(path, out),
        kind="state_feedback",
        sample_time_s=file.sample_time_s,
        states=[f"x{i + 1}" for i in range(law.model.nstates)],
        inputs={name: file.units.get(name, "") for name in file.inputs},
        channels={name: file.units.get(name, "") for name in file.outputs},
        operating_point={name: file.operating_point.get(name, 0.0) for name in (*file.inputs, *file.outputs)},
        gains=PlantGains(**{name: np.asarray(one, float).tolist() for name, one in rows.items()}),
        notes=f"for the identified model {file.name} ({file.method})",
    )


def _left_open(file: IdentifiedFile, law: LinearLaw) -> WorstCase | None:
    """The law around every model that the data leave open; None of a file that does not say how far off it may be."""
    moves = file.moves()
    if not moves:
        return None
    observer = observer_law(law.model, law.filter, law.feedback)
    others = models_about(file.matrices(), moves, file.sample_time_s, max(LEAST_MODELS, 4 * len(moves)))
    return worst_of([observer * one for one in others])


def _worst(found: WorstCase) -> dict[str, Any]:
    return {
        **_margins(found),
        "stable_share": found.stable_share,
        "models": found.models,
        "level": found.level,
    }


def _unstable_ones(found: WorstCase) -> str:
    return (
        f"of {found.models} models that the data leave open ({100 * found.level:g} %) the law keeps "
        f"{100 * found.stable_share:.0f} % stable: record more, or ask for less (--weights)"
    )


def _margins(found: Margins | WorstCase) -> dict[str, Any]:
    return {
        "phase_margin_deg": number(degrees(found.phase_rad)),
        "gain_margin": number(found.gain_up),
        "delay_margin_s": number(found.delay_s),
        "largest_sensitivity": number(found.peak_sensitivity),
    }
