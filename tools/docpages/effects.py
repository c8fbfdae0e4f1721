"""The page of the library of effects: every declaration with its parameters, and what it tells."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from docpages.markdown import code, sections, table
from hoopd.files.shipped import defaults_folder
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.model_file import load_model
from hoopd.plants.registry import plant_named

INTRODUCTION = """# The library of effects

Every effect that `hoopd diagnose` knows of the hoop, by the slot at which it acts, with its parameters: the value at
which the effect vanishes, the range that a search stays in, and how the parameter enters. *amplitude*:
proportionally; *phase*: of an amplitude; *shape*: it is tried on a grid. Equations: [effects](../effects.md). Of
another plant the same effects are known wherever a slot of it fits; those of stores stand below as the tanks
and the circuit have them."""
ENDS = {
    "screen": "",
    "quality": "the recording alone",
    "base": "the parameters",
    "switch": "on or off",
    "scan": "a search of its own",
}


def page() -> str:
    """The whole page."""
    shipped = load_model(defaults_folder() / "models" / "hoop.yaml")
    stores = [effect for name in ("tanks", "circuit") for effect in library(plant_named(name)).values()]
    found: dict[str, list[Any]] = {}
    for effect in library(hoop_plant(shipped.structure, shipped.values())).values():
        found.setdefault(effect.slot, []).append(effect)
    for effect in stores:
        if effect.slot.endswith("store") and effect.slot != "h2_store":  # the second tank is as the first one
            found.setdefault(effect.slot, []).append(effect)
    parts = [part for slot, effects in found.items() for part in (f"## {slot}", *map(_effect, effects))]
    return sections(INTRODUCTION, *parts)


def _effect(effect: Any) -> str:
    rows = [
        [code(one.name), one.unit, _number(one.neutral), f"{_number(one.low)} to {_number(one.high)}", _role(one)]
        for one in effect.parameters
    ]
    parameters = table(["parameter", "unit", "vanishes at", "range", "enters as"], rows) if rows else ""
    told = "\n".join(f"- *{name}:* {text}" for name, text in _told(effect) if text)
    statement = effect.statement[:1].upper() + effect.statement[1:] + "." if effect.statement else ""
    return sections(f"### {effect.name}", statement, parameters, told)


def _told(effect: Any) -> Iterator[tuple[str, str]]:
    yield "what gives it away", effect.signature
    yield "sign", effect.sign
    yield "found by", ENDS.get(effect.found_by, effect.found_by)
    yield "never told apart from", ", ".join(map(code, effect.same_as))
    yield "told apart by rich data only from", ", ".join(map(code, effect.near))
    yield "contains", ", ".join(map(code, effect.contains))
    yield "experiment that shows it", effect.best_experiment
    yield "written back", effect.write_back


def _role(one: Any) -> str:
    more = ", of each recording" if one.per_recording else ""
    return f"{one.role}{', only the values of its grid' if one.discrete else ''}{more}"


def _number(value: float) -> str:
    return f"{value:.4g}"
