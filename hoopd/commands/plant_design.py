"""`hoopd design lqg|placement --plant`: a law for the linear model of any plant, told and judged, not loaded.

Rules of this file: from files to a result; the daemon runs the hoop alone, so that no controller file is written.
"""

from __future__ import annotations

from math import degrees, isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.commands.design_options import poles_from
from hoopd.commands.inputs import read_values
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.plant_linear import LinearizedPlant, linearized
from hoopd.design.linear_law import LinearLaw, placed, quadratic, sampled, with_filter
from hoopd.design.margins import margins
from hoopd.design.poles import closed_loop_poles, unstable
from hoopd.files.reading import InputError

Array = NDArray[np.float64]

LAWS = ("lqg", "placement")


def run(options: DesignOptions) -> dict[str, Any]:
    """Gains, filter, poles and margins; InputError: no such law, nothing to steer, an unstable loop."""
    if options.law not in LAWS:
        raise InputError("LAW", "", f"{options.law} is a law of the hoop; of other plants: {', '.join(LAWS)}")
    for name, value in (("--out", options.out), ("--recording", options.recording), ("--figure", options.figure)):
        if value is not None:
            raise InputError(name, "", "is of the hoop: the daemon runs no other plant; the gains are printed (--json)")
    linear = linearized(options.plant, options.model, options.at)
    plant = linear.model.plant
    if not plant.inputs:
        raise InputError("--plant", plant.name, "has no input: there is nothing to steer")
    step_s = plant.time_scale_s if options.sample_time_s is None else options.sample_time_s
    try:
        law = _law(linear, options, step_s)
        poles = closed_loop_poles(law.loop)
    except (ValueError, ArithmeticError) as error:
        raise InputError(f"design {options.law}", "", str(error)) from None
    if worst := unstable(poles):
        raise InputError(f"design {options.law}", "", f"the closed loop is unstable: |z| = {abs(worst.z):.4g}")
    return _result(linear, options.law, law, step_s)


def _law(linear: LinearizedPlant, options: DesignOptions, step_s: float) -> LinearLaw:
    model = sampled(linear.system, step_s)
    if not model.nstates:
        raise ValueError("no input moves what a channel reads")
    sizes = _sizes(linear, options)
    states, inputs = (np.array([sizes[n] for n in names]) for names in (model.state_labels, model.input_labels))
    outputs = np.maximum(np.abs(np.asarray(model.C)) @ states, 1e-12)
    gains = quadratic(model, states, inputs) if options.law == "lqg" else placed(model, poles_from(options.poles))
    return with_filter(model, gains, states, outputs)


def _sizes(linear: LinearizedPlant, options: DesignOptions) -> dict[str, float]:
    """What deviations cost the same: usual sizes of the plant, unless told."""
    plant = linear.model.plant
    names = (*plant.states, *(one.name for one in plant.inputs))
    usual = {name: plant.scales.get(name, 1.0) for name in names}
    usual |= {one.name: one.limit for one in plant.inputs if one.name not in plant.scales and one.limit}
    told = read_values("--weights", ",".join(options.weights), names) if options.weights else {}
    for name, value in told.items():
        if not value > 0.0:
            raise InputError("--weights", name, f"must be above 0, not {value:g}")
    return usual | told


def _result(linear: LinearizedPlant, name: str, law: LinearLaw, step_s: float) -> dict[str, Any]:
    plant, (x, u) = linear.model.plant, linear.point
    notes = [f"{effect} is not part of the linear model" for effect in linear.left_out]
    notes.append("no controller file: the daemon runs the hoop alone; u = u0 - K (x - x0), x += M (y - C x)")
    if dropped := [state for state in plant.states if state not in law.model.state_labels]:
        notes.append(f"{', '.join(dropped)}: not seen by a channel or not moved by an input, left out of the law")
    found = margins(law.loop) if law.loop.ninputs == 1 else None
    return {
        "model": linear.model.name,
        "plant": plant.name,
        "law": name,
        "sample_time_s": step_s,
        "operating_point": dict(
            zip((*plant.states, *(one.name for one in plant.inputs)), map(float, (*x, *u)), strict=True)
        ),
        "states": list(law.model.state_labels),
        "inputs": list(law.model.input_labels),
        "channels": list(law.model.output_labels),
        "feedback": np.asarray(law.feedback).tolist(),
        "filter": np.asarray(law.filter).tolist(),
        "closed_loop_poles": [
            {"re": one.z.real, "im": one.z.imag, "natural_rad_s": one.natural_rad_s, "damping": one.damping}
            for one in closed_loop_poles(law.loop)
        ],
        "margins": None if found is None else {
            "phase_deg": _finite(degrees(abs(found.phase_rad))),
            "delay_ms": _finite(1e3 * found.delay_s),
            "gain_up": _finite(found.gain_up),
            "gain_down": _finite(found.gain_down),
            "peak_sensitivity": _finite(found.peak_sensitivity),
        },
        "notes": notes,
    }  # fmt: skip


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
