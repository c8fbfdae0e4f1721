"""The page of the plants that are known by name: what they are, their parameters, channels and slots, their file."""

from __future__ import annotations

from math import inf
from typing import Any

from docpages.markdown import code, sections, table
from hoopd.plants.registry import FOLDER, REGISTERED, plant_named

INTRODUCTION = """# Plants by name

What `--plant NAME` means. How to write one of your own: [your own plant](../../guides/your_plant.md)."""


def page() -> str:
    """The whole page."""
    return sections(INTRODUCTION, *map(_plant, REGISTERED))


def _plant(name: str) -> str:
    plant: Any = plant_named(name)
    units = plant.units
    parameters = [
        [code(key), f"{value:.6g}", units.get(key, ""), _bounds(plant, key), "yes" if key in plant.free else ""]
        for key, value in plant.values.items()
    ]
    moving = [*plant.coordinates, *plant.first_order]
    rows = [["state", code(one), units.get(one, "")] for one in moving]
    rows += [["input", code(one.name), _input(one)] for one in plant.inputs]
    rows += [["channel", code(channel), one.unit or ""] for channel, one in plant.channels.items()]
    rows += [["slot", code(slot), one.kind] for slot, one in plant.slots.items()]
    file = FOLDER / f"{name}.yaml"
    text = f"The file:\n\n```yaml\n{file.read_text(encoding='utf-8')}```" if file.is_file() else ""
    header = ["parameter", "value", "unit", "bounds", "fitted"]
    return sections(f"## {name}", table(["what", "name", "unit or kind"], rows), table(header, parameters), text)


def _input(one: Any) -> str:
    return one.unit if one.limit is None else f"{one.unit}, at most {one.limit:g}"


def _bounds(plant: Any, key: str) -> str:
    low, high = plant.bounds.get(key, (-inf, inf))
    return "" if (low, high) == (-inf, inf) else f"from {low:g}" if high == inf else f"{low:g} to {high:g}"
