"""`hoopd plant`: a new plant file from a template, what can be wrong with a plant, and what a plant is.

Rules of this file: options in, a result record and a figure out; the judgements are in `hoopd.plants.plant_check`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from pathlib import Path
from typing import Any

from hoopd.commands.options.plant import PlantOptions
from hoopd.commands.output_files import check_results
from hoopd.files.expressions import NAME
from hoopd.files.plant_template import KINDS, template
from hoopd.files.reading import InputError
from hoopd.files.whole_files import check_target, replace_file
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.library import library
from hoopd.plants.plant_check import Check, checks, free_run
from hoopd.plants.registry import is_text, resolve_plant


def run(options: PlantOptions) -> dict[str, Any]:
    """The result as a record; InputError when anything cannot be used or written."""
    if options.action not in _ACTIONS:
        raise InputError("ACTION", options.action, f"unknown; known: {', '.join(_ACTIONS)}")
    if options.kind not in KINDS:
        raise InputError("--kind", options.kind, f"unknown; known: {', '.join(KINDS)}")
    return _ACTIONS[options.action](options)


def shown(result: Mapping[str, Any]) -> dict[str, Any]:
    """What a person sees of it: what there is none of is left out."""
    return {key: value for key, value in result.items() if value not in ({}, [])}


# ---------------------------------------------------------------------------------------------- actions


def _new(options: PlantOptions) -> dict[str, Any]:
    path = Path(options.plant)
    path = path if path.suffix else Path(f"{path}.yaml")
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(path, "", "a new plant file is a .yaml")
    if not NAME.fullmatch(path.stem):
        raise InputError(path, "", "a plant's name begins with a letter and has letters, digits and _")
    if options.figure is not None:
        raise InputError("--figure", "", "of a plant that is not there yet: it goes with check and show")
    check_target(path, "PLANT")
    if path.exists():
        raise InputError(path, "", "is there already: it is never overwritten")
    replace_file(path, template(options.kind, path.stem, str(path)).encode())
    return {"plant": path.stem, "kind": options.kind, "file": str(path), "next": f"hoopd plant check {path}"}


def _check(options: PlantOptions) -> dict[str, Any]:
    check_results(None, options.figure)
    plant = resolve_plant(options.plant)
    answers = [_units(options.plant), *checks(plant)]
    _draw(plant, options.figure)
    return {
        "plant": plant.name,
        "good": all(one.good is not False for one in answers),
        "checks": {one.name: {"answer": _WORDS[one.good], "reason": one.reason} for one in answers},
        "effects": _effects(plant),
        "notes": _notes(plant),
    }


def _show(options: PlantOptions) -> dict[str, Any]:
    check_results(None, options.figure)
    plant = resolve_plant(options.plant)
    _draw(plant, options.figure)
    return {
        "plant": plant.name,
        "states": {name: {"unit": _unit(plant, name), "usual": plant.scales.get(name)} for name in plant.states},
        "inputs": {
            one.name: {"unit": one.unit, "limit": one.limit, "force_on": one.coordinate} for one in plant.inputs
        },
        "parameters": {
            name: {
                "value": float(value),
                "unit": plant.units.get(name, ""),
                "from": _end(plant, name, 0),
                "to": _end(plant, name, 1),
                "fitted": name in plant.free,
            }
            for name, value in plant.values.items()
        },
        "channels": {
            name: {"reads": one.state or "an expression", "unit": one.unit, "sensor": one.sensor}
            for name, one in plant.channels.items()
        },
        "slots": {
            name: {"kind": one.kind, "coordinate": one.coordinate, "usual_rate": one.speed, "turns": one.turns}
            for name, one in plant.slots.items()
        },
        "effects": _effects(plant),
        "sample_time_s": plant.time_scale_s,
    }


_ACTIONS: dict[str, Callable[[PlantOptions], dict[str, Any]]] = {"new": _new, "check": _check, "show": _show}
_WORDS = {True: "yes", False: "no", None: "does not apply"}


# ---------------------------------------------------------------------------------------------- parts


def _effects(plant: Plant) -> dict[str, list[str]]:
    """Names of the library's effects by slot, without the slot."""
    names = [name.split(".") for name in library(plant)]
    return {slot: [effect for where, effect in names if where == slot] for slot in plant.slots}


def _notes(plant: Plant) -> list[str]:
    notes = []
    if unread := [name for name in (*plant.coordinates, *plant.first_order) if name not in plant.states_read]:
        notes.append(
            f"no channel reads {', '.join(unread)} itself: where parameters can make up for its scale, hold one of them"
        )
    if not plant.free:
        notes.append("no parameter is free: a fit finds the start alone")
    if missing := [one.name for one in plant.inputs if one.limit is None]:
        notes.append(f"no limit is known of {', '.join(missing)}")
    return notes


def _units(text: str) -> Check:
    """Of a file of text the reader has judged them: with a wrong one there is no plant."""
    if is_text(text):
        return Check("units", True, "the same on both sides and in every sum, where all names have one")
    return Check("units", None, "equations in Python are not judged")


def _unit(plant: Plant, state: str) -> str:
    """Unit of a state; where nobody said it, that of its channel, and of a rate what its coordinate's makes it."""
    known = {**{one.state: one.unit for one in plant.channels.values()}, **plant.units}
    return known.get(state) or (f"{known[state[1:]]}/s" if known.get(state[1:]) else "")


def _end(plant: Plant, name: str, end: int) -> float | None:
    """A bound; JSON knows no infinity."""
    bound = plant.bounds.get(name, (-float("inf"), float("inf")))[end]
    return float(bound) if isfinite(bound) else None


def _draw(plant: Plant, figure: Path | None) -> None:
    if figure is None:
        return
    from hoopd.plots.plant import draw_free_run
    from hoopd.plots.style import save

    t, states = free_run(plant)
    units = {name: _unit(plant, name) for name in plant.states}
    save(draw_free_run(plant.name, units, t, states), figure)
