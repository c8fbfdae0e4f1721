"""`hoopd linearize --plant` and the linear model that `hoopd design --plant` starts from: any plant at an equilibrium.

Rules of this file: files in, a result record out; the mathematics is in `hoopd.design`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import control
import numpy as np

from hoopd.commands.inputs import read_values
from hoopd.commands.linearize_record import record_of
from hoopd.commands.options.linearize import LinearizeOptions
from hoopd.design.analysis import channel
from hoopd.design.delay import held
from hoopd.design.linear_plant import (
    Equilibrium,
    EquilibriumNotFoundError,
    equilibrium,
    holding_inputs,
    is_there,
    linear_plant,
)
from hoopd.files.reading import InputError
from hoopd.files.shipped import or_shipped
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.model_file import HOOP
from hoopd.plants.plant_model import PlantModel, is_of_another_plant, load_plant_model, nominal_model
from hoopd.plants.scales import usual_sizes

# Of a usual size: no more than rounding. Growth within a usual sample time that no plant has.
NOTHING, MOST_GROWTH = 1e-9, 1e12


class LinearizedPlant(NamedTuple):
    """A plant at its operating point."""

    model: PlantModel
    point: Equilibrium
    system: control.StateSpace
    left_out: tuple[str, ...]  # effects that have no linear model
    elsewhere: tuple[str, ...] = ()  # sentences: states that stay at another place than where they were looked for


def is_other(plant: str | None, model: Path | None) -> bool:
    """Whether a command is asked about another plant than the hoop: by name, or by its model."""
    if plant is not None:
        return plant != HOOP
    return model is not None and is_of_another_plant(or_shipped(model))


def run(options: LinearizeOptions) -> dict[str, Any]:
    """What `hoopd linearize` finds of another plant than the hoop, as plain data."""
    for name, value in (("--psi", options.held_rad), ("--hoop-speed", options.turning_rad_s)):
        if value is not None:
            raise InputError(name, "", "is of the hoop: another plant's operating point is told by --at")
    if options.top:
        raise InputError("--top", "", "is of the hoop: another plant's operating point is told by --at")
    linear = linearized(asked_model(options.plant, options.model), options.at, options.outputs)
    system, sampling = linear.system, (options.sample_time_s, options.delay_samples)
    inputs = linear.model.plant.inputs
    if options.sample_time_s is not None:
        system = held(system, options.sample_time_s, options.delay_samples * options.sample_time_s)
    first = first_input(system)
    notes = [*(f"{name} is not part of the linear model" for name in linear.left_out), *linear.elsewhere]
    if len(inputs) > 1:
        notes.append(f"margins, bandwidth and fractions are those of the input {inputs[0].name}")
    if not inputs:
        notes.append(f"{linear.model.name} has no input: nothing to steer, and no fractions, margins or bandwidth")
    result = record_of(_head(linear), first, sampling, notes, matrices=system, sizes=usual_sizes(linear.model.plant))
    if not inputs:  # python-control's one input stands for none
        result["notes"] = [note for note in result["notes"] if not note.endswith("is not moved by nothing")]
    if options.figure is not None and inputs:
        from hoopd.plots import linear as drawings, style

        draw = drawings.DRAWINGS[options.plot or "overview"]
        one = channel(first, system.output_labels[0])
        title = f"{linear.model.name}: {system.output_labels[0]} / {inputs[0].name}"
        style.save(draw(one, title=title), options.figure)
    elif options.figure is not None:
        raise InputError("--figure", "", f"{linear.model.name} has no input: there is no response to draw")
    return result


def asked_model(plant: str | None, model: Path | None) -> PlantModel:
    """The model of a file, or the plant with its nominal values."""
    return nominal_model(str(plant)) if model is None else load_plant_model(or_shipped(model), plant)


def first_input(system: control.StateSpace) -> control.StateSpace:
    """The same with its first input alone."""
    return control.ss(
        system.A, system.B[:, :1], system.C, system.D[:, :1], system.dt, states=system.state_labels,
        inputs=system.input_labels[:1], outputs=system.output_labels, name=system.name,
    )  # fmt: skip


def linearized(found: PlantModel, at: str, outputs: tuple[str, ...] = ()) -> LinearizedPlant:
    """The linear model of a plant; InputError where a name is unknown or nothing stays."""
    own = found.plant
    names = (*(one.name for one in own.inputs), *own.states)
    told = read_values("--at", at, names) if at else {}
    inputs = {one.name: told.pop(one.name) for one in own.inputs if one.name in told}
    effects, left_out = _effects(found)
    point = _operating_point(found, inputs, told, effects)
    try:
        system = linear_plant(own, point, outputs, effects, found.values)
    except ValueError as error:
        raise InputError("--output", "", str(error)) from None
    if not all(np.isfinite(one).all() for one in (system.A, system.B, system.C, system.D)) or not _is_slow(own, system):
        raise InputError("--at", "", f"{own.name} has no finite derivatives there: another operating point is needed")
    return LinearizedPlant(found, point, system, left_out, _elsewhere(own, point, told))


def _operating_point(
    found: PlantModel, inputs: Mapping[str, float], near: Mapping[str, float], effects: Sequence[Effect]
) -> Equilibrium:
    """Where a plant stays; InputError where that is nowhere, and where states that were asked for need inputs that were
    not named: zero is no wish."""
    own = found.plant
    names = (*(one.name for one in own.inputs), *own.states)
    free = [one.name for one in own.inputs if one.name not in inputs]
    try:
        point = equilibrium(own, inputs, near, effects, found.values)
    except EquilibriumNotFoundError as error:
        if not (free and near):
            raise InputError("--at", "", f"{error}: --at {names[0]}=...,... says where to look") from None
        point = None
    if point is not None and (not free or is_there(own, point, near)):
        return point
    stays = "nowhere near" if point is None else f"at {_values(own, point, near)}, not at"
    asked = ", ".join(f"{name}={value:g}" for name, value in near.items())
    zero = ", ".join(f"{name}=0" for name in free)
    held = _what_holds(found, inputs, near, effects, free)
    raise InputError("--at", "", f"with {zero}, not named here, {own.name} stays {stays} {asked}; {held}")


def _values(plant: Plant, point: Equilibrium, names: Iterable[str]) -> str:
    """States of a point; what is zero to rounding is called so."""
    at = dict(zip(plant.states, point.x, strict=True))
    small = {name: abs(at[name]) < NOTHING * plant.scales.get(name, 1.0) for name in names}
    return ", ".join(f"{name}={0.0 if small[name] else at[name]:.4g}" for name in names)


def _what_holds(
    found: PlantModel, inputs: Mapping[str, float], near: Mapping[str, float], effects: Sequence[Effect],
    free: Sequence[str],
) -> str:  # fmt: skip
    """Which of the inputs that were not named would hold a plant there: one of them, or all together."""
    limits = {one.name: (one.limit, one.unit) for one in found.plant.inputs}
    for some in [[name] for name in free] + [[*free]] * (len(free) > 1):
        wanted = holding_inputs(found.plant, near, some, inputs, effects, found.values)
        if wanted is not None:
            over = [name for name, value in wanted.items() if abs(value) > (limits[name][0] or math.inf)]
            said = ", ".join(f"{name}={value:.6g}" for name, value in wanted.items())
            if over:
                limit, unit = limits[over[0]]
                return f"{said} would hold it, which is beyond its limit of {limit:g} {unit}"
            return f"{said} would hold it: name {'it' if len(wanted) == 1 else 'them'}, too"
    return f"no {' or '.join(free)} holds it there"


def _is_slow(plant: Plant, system: control.StateSpace) -> bool:
    """Whether a usual sample time holds no more than MOST_GROWTH of a state's usual change: beside the root of an empty
    tank all numbers are finite."""
    size = np.array([plant.scales.get(name, 1.0) for name in plant.states])
    rate = np.abs(np.asarray(system.A)) * size * plant.time_scale_s / size[:, None]
    return bool(rate.max(initial=0.0) < MOST_GROWTH)


def _elsewhere(plant: Plant, point: Equilibrium, near: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(
        f"{_values(plant, point, [name]).replace('=', ' stays at ')} with these inputs; the {value:g} of --at said "
        "where to look"
        for name, value in near.items()
        if not is_there(plant, point, {name: value})
    )


def _effects(model: PlantModel) -> tuple[tuple[Effect, ...], tuple[str, ...]]:
    """Effects on forces that are smooth, and the names of all others."""
    known = model.known_effects
    own = [known[one.name] for one in model.effects]
    at_once = [e for e in own if e.force is not None and e.acts_now]
    smooth = tuple(e for e in at_once if e.friction is None and e.lag is None and not e.delay)
    return smooth, tuple(one.name for one in own if one not in smooth)


def _head(linear: LinearizedPlant) -> dict[str, Any]:
    plant, (x, u) = linear.model.plant, linear.point
    values = dict(zip((*plant.states, *(one.name for one in plant.inputs)), map(float, (*x, *u)), strict=True))
    return {
        "model": linear.model.name,
        "plant": plant.name,
        "operating_point": {name: value for name, value in values.items() if math.isfinite(value)},
    }
