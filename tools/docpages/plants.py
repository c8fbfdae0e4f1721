"""The pages of the plants that are known by name, one each: what it is, every command with it, the effects that are
looked for at its slots, its file; and the page that lists them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from typing import Any

import yaml

from docpages.markdown import code, sections, table
from hoopd.plants.effects.library import library
from hoopd.plants.registry import FOLDER, REGISTERED, plant_named

INTRODUCTION = """# Plants by name

What `--plant NAME` means. How to write one of your own: [your own plant](../../guides/your_plant.md); the keys of its
file: [plant files](../plant_files.md)."""
HOOP = "a ball in a hoop that a motor turns: the device of this project"


def pages() -> Mapping[str, Callable[[], str]]:
    """Every page of this module by its file."""
    return {"plants.md": page, **{f"plant_{name}.md": partial(page_of, name) for name in REGISTERED}}


def page() -> str:
    """The list."""
    rows = [[f"[{name}](plant_{name}.md)", _description(name)] for name in REGISTERED]
    inside = "\n".join(f"plant_{name}" for name in REGISTERED)
    return sections(
        INTRODUCTION, table(["name", "what it is"], rows), f"```{{toctree}}\n:hidden:\n:maxdepth: 1\n\n{inside}\n```"
    )


def page_of(name: str) -> str:
    """One plant."""
    plant: Any = plant_named(name)
    return sections(
        f"# The plant {name}",
        f"{_description(name)[:1].upper()}{_description(name)[1:]}. What the commands do: "
        "[your own plant](../../guides/your_plant.md).",
        f"## Every command with it\n\n```\n{_commands(name, plant)}\n```",
        "## What it has",
        _parts(plant),
        _parameters(plant),
        "## Effects that are looked for",
        f"Each with its parameters: [the library of effects](effects_library.md). Beside them the grammar of "
        f"[mechanisms](../../explanations/mechanisms.md) is searched.\n\n{_effects(plant)}",
        _file(name),
    )


def _description(name: str) -> str:
    file = FOLDER / f"{name}.yaml"
    return str(yaml.safe_load(file.read_text(encoding="utf-8"))["description"]) if file.is_file() else HOOP


def _commands(name: str, plant: Any) -> str:
    """What is typed; REC.csv has columns of the plant's own names."""
    of, columns = f"--plant {name}", ",".join([*(one.name for one in plant.inputs), *plant.channels])
    lines = [f"hoopd plant show {name} --figure {name}.png"]
    if plant.inputs:
        lines.append(f"hoopd experiment multisine {of} --out test.mcap".replace(" --plant hoop", ""))
    lines += [
        f"hoopd fit REC.csv {of} --columns {columns} --out known.yaml",
        f"hoopd simulate {of} --input REC.csv --columns {columns} --figure run.png",
        f"hoopd linearize {of}",
        f"hoopd diagnose REC.csv {of} --columns {columns} --report found.html --write found.yaml",
        f"hoopd convert REC.csv rec.mcap {of} --columns {columns}",
    ]
    if plant.inputs:
        lines += [f"hoopd identify REC.csv {of} --columns {columns}", f"hoopd design lqr {of}"]
    return "\n".join(lines)


def _parts(plant: Any) -> str:
    rows = [["state", code(one), plant.units.get(one, "")] for one in (*plant.coordinates, *plant.first_order)]
    rows += [["input", code(one.name), _input(one)] for one in plant.inputs]
    rows += [["channel", code(channel), one.unit or ""] for channel, one in plant.channels.items()]
    rows += [["slot", code(slot), one.kind] for slot, one in plant.slots.items()]
    return table(["what", "name", "unit or kind"], rows)


def _parameters(plant: Any) -> str:
    rows = [
        [code(key), f"{value:.6g}", plant.units.get(key, ""), _bounds(plant, key), "yes" if key in plant.free else ""]
        for key, value in plant.values.items()
    ]
    return table(["parameter", "value", "unit", "bounds", "fitted"], rows)


def _effects(plant: Any) -> str:
    by_slot: dict[str, list[str]] = {}
    for effect in library(plant).values():
        by_slot.setdefault(effect.slot, []).append(code(effect.name.partition(".")[2]))
    return table(["slot", "effects"], [[code(slot), ", ".join(names)] for slot, names in by_slot.items()])


def _file(name: str) -> str:
    file = FOLDER / f"{name}.yaml"
    return f"## The file\n\n```yaml\n{file.read_text(encoding='utf-8')}```" if file.is_file() else ""


def _input(one: Any) -> str:
    return one.unit if one.limit is None else f"{one.unit}, at most {one.limit:g}"


def _bounds(plant: Any, key: str) -> str:
    low, high = plant.bounds.get(key, (-inf, inf))
    return "" if (low, high) == (-inf, inf) else f"from {low:g}" if high == inf else f"{low:g} to {high:g}"
