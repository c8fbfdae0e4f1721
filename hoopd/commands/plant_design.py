"""What `hoopd design --plant` designs: a law for any plant at an operating point, its file's content, and its loop.

Rules of this file: from a model and options to checked objects; the mathematics is in `hoopd.design`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import casadi as ca
import control
import numpy as np
from numpy.typing import NDArray

from hoopd.commands.design_options import KINDS, OF_LAWS, poles_from, refuse_of_other_laws
from hoopd.commands.inputs import read_values
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.plant_linear import LinearizedPlant, linearized
from hoopd.design.controller_text import plain
from hoopd.design.linear_law import LinearLaw, placed, quadratic, sampled, with_filter
from hoopd.design.margins import Margins, margins
from hoopd.design.plant_loop import RELEASE_SHARE, PlantLoopRun, closed_loop, ticks_of
from hoopd.design.poles import Pole, closed_loop_poles, unstable
from hoopd.files.plant import LONGEST_SAMPLE_S
from hoopd.files.plant_controller import PlantControllerFile, PlantGains
from hoopd.files.reading import InputError
from hoopd.files.records import between
from hoopd.plants.effects.base import Effect
from hoopd.plants.model_file import LARGEST, SMALLEST
from hoopd.plants.plant_model import PlantModel

Array = NDArray[np.float64]

LAWS = ("lqg", "placement")
# What a law of another plant is asked for; everything else is of the hoop's laws.
ASKED = ("law", "model", "plant", "at", "steer", "out", "poles", "weights", "sample_time_s", "figure", "json_path")
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
    linear = _steered(linear, options.steer)
    step_s = plant.time_scale_s if options.sample_time_s is None else options.sample_time_s
    between("--sample-time", "", step_s, 0.0, LONGEST_SAMPLE_S)
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
    held = {one.name: value for one, value in zip(plant.inputs, linear.point.u, strict=True)}
    loop = closed_loop(plant, file, law, linear.point.x, off, ticks_of(slowest), acting, model.values, held)
    if not loop.is_finite:
        reason = "the plant itself leaves every bound with this law, let go a tenth of the usual sizes away"
        raise InputError(f"design {options.law}", "", reason)
    found = margins(law.loop) if law.loop.ninputs == 1 else None
    return PlantDesign(linear, law, file, loop, poles, found, (*_notes(linear, law), *late))


def _steered(linear: LinearizedPlant, names: Sequence[str]) -> LinearizedPlant:
    """With the inputs alone that the law moves."""
    system, known = linear.system, list(linear.system.input_labels)
    if strange := [name for name in names if name not in known]:
        raise InputError("--steer", strange[0], f"is no input of the plant; known: {', '.join(known)}")
    chosen = [k for k, name in enumerate(known) if not names or name in names]
    less = control.ss(
        system.A, system.B[:, chosen], system.C, system.D[:, chosen], states=system.state_labels,
        inputs=[known[k] for k in chosen], outputs=system.output_labels,
    )  # fmt: skip
    return linear._replace(system=less)


def _refuse_hoops_own(options: DesignOptions) -> None:
    if options.law not in LAWS:
        what = "is a law of the hoop" if options.law in KINDS else "is no law"
        raise InputError("LAW", "", f"{options.law} {what}; of other plants: {', '.join(LAWS)}")
    for one in fields(DesignOptions):
        if one.name not in ASKED and getattr(options, one.name) != one.default:
            raise InputError(option_name(DesignOptions, one.name), "", "is of the hoop's laws")
    refuse_of_other_laws(options, {"poles": OF_LAWS["poles"]})  # weights are of either law here


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
    known = model.known_effects
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
        between("--weights", name, value, SMALLEST, LARGEST)
    return usual | told


def _file(linear: LinearizedPlant, law: LinearLaw, step_s: float, name: str) -> PlantControllerFile:
    model, plant, x, u = linear.model, linear.model.plant, linear.point.x, linear.point.u
    steered, channels = linear.system.input_labels, {c: o.unit for c, o in plant.channels.items()}
    inputs = {one.name: one.unit for one in plant.inputs if one.name in steered}
    held_at = {one.name: float(value) for one, value in zip(plant.inputs, u, strict=True)}
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
        operating_point={**plain({name: held_at[name] for name in inputs}, DIGITS), **plain(read, DIGITS)},
        gains=PlantGains(**{key: plain(np.asarray(one), DIGITS) for key, one in matrices.items()}),
        limits={one.name: one.limit for one in plant.inputs if one.name in inputs and one.limit is not None},
        notes=f"designed as {name}",
    )


def _notes(linear: LinearizedPlant, law: LinearLaw) -> list[str]:
    plant = linear.model.plant
    notes = [*(f"{effect} is not part of the linear model" for effect in linear.left_out), *linear.elsewhere]
    notes.append(
        "the daemon runs the hoop alone: the controller is for a program of your own (docs/guides/your_plant.md)"
    )
    if held := [one.name for one in plant.inputs if one.name not in linear.system.input_labels]:
        notes.append(f"{', '.join(held)}: held, the law does not move it")
    if dropped := [state for state in plant.states if state not in law.model.state_labels]:
        notes.append(f"{', '.join(dropped)}: not seen by a channel or not moved by an input, left out of the law")
    return notes
