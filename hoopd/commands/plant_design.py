"""`hoopd design lqg|placement --plant`: a law for any plant at an operating point, judged on it, and its file.

Rules of this file: from files to a file, a figure and a result; the mathematics is in `hoopd.design`. The file is for a
program of one's own: the daemon runs the hoop alone, and refuses it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from math import degrees, isfinite
from pathlib import Path
from typing import Any

import casadi as ca
import msgspec
import numpy as np
from numpy.typing import NDArray

from hoopd.commands.design_options import poles_from
from hoopd.commands.inputs import read_values
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.output_files import check_results
from hoopd.commands.plant_linear import LinearizedPlant, asked_model, linearized
from hoopd.design.controller_text import plain
from hoopd.design.linear_law import LinearLaw, placed, quadratic, sampled, with_filter
from hoopd.design.margins import Margins, margins
from hoopd.design.plant_loop import RELEASE_SHARE, PlantLoopRun, closed_loop, ticks_of
from hoopd.design.poles import Pole, closed_loop_poles, unstable
from hoopd.files.plant_controller import (
    PlantControllerFile,
    PlantGains,
    parse_plant_controller,
    plant_controller_text,
)
from hoopd.files.reading import InputError
from hoopd.files.shipped import or_shipped, way_to
from hoopd.files.whole_files import replace_file
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.plant_model import PlantModel

Array = NDArray[np.float64]

LAWS = ("lqg", "placement")
# What a law of another plant is asked for; everything else is of the hoop's laws.
ASKED = ("law", "model", "plant", "at", "out", "poles", "weights", "sample_time_s", "figure", "json_path")
HEAD = "Made by `hoopd design {law} --plant`: x += M (y - y0 - C x), u = u0 - K x, x = A x + B (u - u0)."
# Of its largest deviation, how near a signal stays when it has settled.
SETTLED_SHARE = 0.05
# More digits than any sensor has; small machines' last bits do not reach them.
DIGITS = 10


@dataclass(frozen=True)
class PlantDesign:
    """A law for a plant, its file and its closed loop on it."""

    linear: LinearizedPlant
    law: LinearLaw
    file: PlantControllerFile
    run: PlantLoopRun
    poles: list[Pole]
    margins: Margins | None  # of one input
    notes: tuple[str, ...]


def run(options: DesignOptions) -> dict[str, Any]:
    """Gains, filter, poles, margins, the loop; InputError: no such law, nothing to steer, an unstable loop."""
    check_results(options.out, options.figure)
    found = designed(asked_model(options.plant, options.model), options)
    if options.figure is not None:
        from hoopd.plots.style import save

        save(figure_of(found), options.figure)
    if options.out is not None:
        write(found, options.out, options.model)
    paths = {"out": options.out, "figure": options.figure}
    return {**_result(found, options.law), **{key: str(one) for key, one in paths.items() if one is not None}}


def designed(model: PlantModel, options: DesignOptions) -> PlantDesign:
    """The law that is asked for, and its loop; InputError as above. Nothing is written."""
    _refuse_hoops_own(options)
    linear = linearized(model, options.at)
    plant = model.plant
    if not plant.inputs:
        raise InputError("--plant", plant.name, "has no input: there is nothing to steer")
    for one, value in zip(plant.inputs, linear.point.u, strict=True):
        if one.limit is not None and abs(value) > one.limit:
            raise InputError("--at", one.name, f"{value:g} is beyond its limit, {one.limit:g} {one.unit}")
    step_s = plant.time_scale_s if options.sample_time_s is None else options.sample_time_s
    sizes = _sizes(linear, options)
    try:
        law = _law(linear, options, step_s, sizes)
        poles = closed_loop_poles(law.loop)
    except (ValueError, ArithmeticError) as error:
        raise InputError(f"design {options.law}", "", str(error)) from None
    if worst := unstable(poles):
        raise InputError(f"design {options.law}", "", f"the closed loop is unstable: |z| = {abs(worst.z):.4g}")
    file = _file(linear, law, step_s, options.law)
    acting, late = _acting(model)
    moved = [name for name in (*plant.coordinates, *plant.first_order) if name in law.model.state_labels]
    off = {name: RELEASE_SHARE * sizes[name] for name in moved}
    slowest = max((abs(one.z) for one in poles), default=0.0)
    loop = closed_loop(plant, file, law, linear.point.x, off, ticks_of(slowest), acting, model.values)
    if not loop.is_finite:
        reason = "the plant itself leaves every bound with this law, let go a tenth of the usual sizes away"
        raise InputError(f"design {options.law}", "", reason)
    found = margins(law.loop) if law.loop.ninputs == 1 else None
    design = PlantDesign(linear, law, file, loop, poles, found, (*_notes(linear, law), *late))
    return replace(design, notes=(*design.notes, *_unsettled(design)))


def _refuse_hoops_own(options: DesignOptions) -> None:
    if options.law not in LAWS:
        raise InputError("LAW", "", f"{options.law} is a law of the hoop; of other plants: {', '.join(LAWS)}")
    for one in fields(DesignOptions):
        if one.name not in ASKED and getattr(options, one.name) != one.default:
            raise InputError(option_name(DesignOptions, one.name), "", "is of the hoop's laws")


def _law(linear: LinearizedPlant, options: DesignOptions, step_s: float, sizes: Mapping[str, float]) -> LinearLaw:
    model = sampled(linear.system, step_s)
    if not model.nstates:
        raise ValueError("no input moves what a channel reads")
    states, inputs = (np.array([sizes[n] for n in names]) for names in (model.state_labels, model.input_labels))
    outputs = np.maximum(np.abs(np.asarray(model.C)) @ states, 1e-12)
    gains = quadratic(model, states, inputs) if options.law == "lqg" else placed(model, _poles(options, model))
    return with_filter(model, gains, states, outputs)


def _poles(options: DesignOptions, model: Any) -> tuple[complex, ...]:
    poles = poles_from(options.poles)
    if len(poles) != model.nstates:
        states = ", ".join(model.state_labels)
        raise InputError("--poles", "", f"{model.nstates} are needed, in rad/s ({states}), not {len(poles)}")
    return poles


def _acting(model: PlantModel) -> tuple[list[Effect], list[str]]:
    """Effects that the loop's run has, those on forces and drives; of the others that it is without them."""
    known = library(model.plant) if model.effects else {}
    late = [
        one.name
        for one in model.effects
        if not known[one.name].is_simulated
        or any(getattr(known[one.name], part) for part in ("delay", "sensor", "latency", "sensor_lag"))
    ]
    acting = [known[one.name] for one in model.effects if one.name not in late]
    return acting, [f"{name} is not part of the closed loop, either" for name in late]


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


# ---------------------------------------------------------------------------------------------- results


def _file(linear: LinearizedPlant, law: LinearLaw, step_s: float, name: str) -> PlantControllerFile:
    model, plant, x, u = linear.model, linear.model.plant, linear.point.x, linear.point.u
    inputs, channels = ({one.name: one.unit for one in plant.inputs}, {c: o.unit for c, o in plant.channels.items()})
    held: Any = u if len(u) > 1 else float(u.sum())
    point = plant.point(x, model.values, held)
    read = {
        c: float(ca.DM(o.reading(point)) if o.reading else getattr(point, o.state)) for c, o in plant.channels.items()
    }
    matrices = {"feedback": law.feedback, "filter": law.filter, "a": law.model.A, "b": law.model.B, "c": law.model.C}
    return PlantControllerFile(
        schema="hoopd.controller/1",
        name=name,
        plant=getattr(model.file, "plant", plant.name),
        kind="state_feedback",
        sample_time_s=step_s,
        states=list(law.model.state_labels),
        inputs=inputs,
        channels=channels,
        operating_point={**plain(dict(zip(inputs, u.tolist(), strict=True)), DIGITS), **plain(read, DIGITS)},
        gains=PlantGains(**{key: plain(np.asarray(one), DIGITS) for key, one in matrices.items()}),
        limits={one.name: one.limit for one in plant.inputs if one.limit is not None},
        notes=f"designed as {name}",
    )


def write(found: PlantDesign, out: Path, model: Path | None) -> None:
    """The controller's file; plant and model are named from its folder."""
    own, given = found.linear.model, found.file
    plant = given.plant if own.plant_file is None else way_to(own.plant_file, out)
    file = msgspec.structs.replace(
        given, name=out.stem, plant=plant, model="" if model is None else way_to(or_shipped(model), out)
    )
    text = plant_controller_text(file, HEAD.format(law=given.name))
    parse_plant_controller(text, out)
    replace_file(out, text.encode())


def figure_of(found: PlantDesign) -> Any:
    """The loop that is let go, on the plant and on its linear model."""
    from hoopd.plots.plant_loop import draw_plant_loop

    plant, file = found.linear.model.plant, found.file
    return draw_plant_loop(
        found.run.t,
        found.run.nonlinear,
        found.run.linear,
        units={**file.inputs, **file.channels},
        inputs={one.name: one.limit for one in plant.inputs},
        title=f"{found.linear.model.name}: closed loop with {file.name}, let go beside its operating point",
    )


def _result(found: PlantDesign, name: str) -> dict[str, Any]:
    linear, law = found.linear, found.law
    plant, (x, u) = linear.model.plant, linear.point
    return {
        "model": linear.model.name,
        "plant": plant.name,
        "law": name,
        "sample_time_s": found.file.sample_time_s,
        "operating_point": dict(
            zip((*plant.states, *(one.name for one in plant.inputs)), map(float, (*x, *u)), strict=True)
        ),
        "margins": None if found.margins is None else {
            "phase_deg": _finite(degrees(abs(found.margins.phase_rad))),
            "delay_ms": _finite(1e3 * found.margins.delay_s),
            "gain_up": _finite(found.margins.gain_up),
            "gain_down": _finite(found.margins.gain_down),
            "peak_sensitivity": _finite(found.margins.peak_sensitivity),
        },
        "closed_loop": _signals(found),
        "states": list(law.model.state_labels),
        "inputs": list(law.model.input_labels),
        "channels": list(law.model.output_labels),
        "feedback": np.asarray(law.feedback).tolist(),
        "filter": np.asarray(law.filter).tolist(),
        "closed_loop_poles": [
            {"re": one.z.real, "im": one.z.imag, "natural_rad_s": one.natural_rad_s, "damping": one.damping}
            for one in found.poles
        ],
        "notes": list(found.notes),
    }  # fmt: skip


def _signals(found: PlantDesign) -> dict[str, Any]:
    """Of each channel and input of the plant that was let go: where it began, its largest deviation, when it stays."""
    rest, units = found.file.operating_point, {**found.file.channels, **found.file.inputs}
    rows = {}
    for name, values in found.run.nonlinear.items():
        off = np.abs(values - rest[name])
        outside = np.flatnonzero(off > SETTLED_SHARE * off.max(initial=0.0))
        after = int(outside[-1]) + 1 if len(outside) else 0
        rows[name] = {
            "unit": units[name],
            "begins_at": float(values[0]),
            "largest_deviation": float(off.max(initial=0.0)),
            "ends_at": float(values[-1]),
            "settles_s": float(found.run.t[after]) if after < len(values) else None,
        }
    return rows


def _unsettled(design: PlantDesign) -> list[str]:
    """Channels that the plant does not bring back."""
    left = [name for name, one in _signals(design).items() if name in design.file.channels and one["settles_s"] is None]
    return [f"{', '.join(left)}: not settled when the run ends (what the linear model leaves out)"] if left else []


def _notes(linear: LinearizedPlant, law: LinearLaw) -> list[str]:
    plant = linear.model.plant
    notes = [f"{effect} is not part of the linear model" for effect in linear.left_out]
    notes.append(
        "the daemon runs the hoop alone: the controller is for a program of your own (docs/guides/your_plant.md)"
    )
    if dropped := [state for state in plant.states if state not in law.model.state_labels]:
        notes.append(f"{', '.join(dropped)}: not seen by a channel or not moved by an input, left out of the law")
    return notes


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
