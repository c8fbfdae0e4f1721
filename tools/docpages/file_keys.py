"""The pages of configuration keys and of typed files, from their records: key, type with range, default, comment.

What stands behind a field on its line in the source is its meaning here.
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

from docpages.markdown import code, sections, table
from hoopd.core.health import Thresholds
from hoopd.core.ticksettings import TickSettings
from hoopd.files import controller, excitation, identified, model, plant, plant_controller
from hoopd.shell import config

NAMES = {float: "number", int: "whole number", str: "text", bool: "yes or no", Any: "anything"}
HEADER = ["key", "type", "default", "meaning"]
FIELD = re.compile(r"^    (\w+): .*?(?:  # (.*))?$")
LEADING = re.compile(r"^    # (.*)$")
CONFIGURATION = """# Configuration keys

Layers, later ones win: the shipped `hoop.yaml`, with `--sim` the shipped `sim.yaml`, the file of `--config`, each
`--set SECTION.KEY=VALUE`. A number is in the unit that its key ends in (`_s`, `_rad`, `_nm`, `_px` ...), or carries
one: `20 ms`, `1 deg`, `0.7 N m`. An unknown key, a wrong unit or a value out of range is one line with file and key,
and exit code 2. Defaults are those of the program; what the shipped files set goes over them."""
FILES = """# Files

Every file that the program reads or writes as YAML: its keys, types and defaults. A key without a default is
required. An unknown key, a wrong type or a number out of range is one line with file and key, and exit code 2. A
parameter carries its unit and is refused with another one."""


def configuration() -> str:
    """All sections of the configuration, nested ones below theirs."""
    parts = [_record(f"## {name}", hint, name) for name, hint in get_type_hints(config.Config).items()]
    return sections(CONFIGURATION, *parts)


def files() -> str:
    """The records of the files, each with those that stand in it."""
    parts = [
        _record("## Model: `hoopd.model/1`", model.ModelFile),
        _record("### of another plant", model.PlantModelFile),
        _record("## Plant: `hoopd.plant/1`", plant.PlantFile),
        _record("## Controller: `hoopd.controller/1`", controller.ControllerFile),
        _record("### `gains` of kind `excitation`", excitation.ExcitationEntry),
        _record("### of another plant", plant_controller.PlantControllerFile),
        _record("## Identified model: `hoopd.identified/1`", identified.IdentifiedFile),
    ]
    return sections(FILES, *parts)


def _record(heading: str, record: type, path: str = "") -> str:
    told = " ".join((inspect.getdoc(record) or "").split())
    comments, hints, nested, rows = _comments(record), get_type_hints(record, include_extras=True), [], []
    for name, default in _fields(record):
        inner = [one for one in _records_in(hints[name]) if one is not record]
        rows.append([code(name), _type(hints[name]), _default(default), comments.get(name, "")])
        below = "." if get_origin(hints[name]) is None else "[]."
        nested += [(f"{path}{'.' if path else ''}{name}", below, one) for one in inner]
    level = "#" * (heading.split(" ", maxsplit=1)[0].count("#") + 1)
    parts = [_record(f"{level} `{key}`", one, key) for key, _, one in nested]
    return sections(heading, told, table(HEADER, rows), *parts)


def _fields(record: type) -> Iterator[tuple[str, Any]]:
    """Name and default of every key; `...` where one is required."""
    if isinstance(record, type) and issubclass(record, msgspec.Struct):
        for field in msgspec.structs.fields(record):
            made = field.default_factory is not msgspec.NODEFAULT
            yield field.name, field.default_factory() if made else ... if field.required else field.default
    else:
        defaults = record()
        yield from ((name, getattr(defaults, name)) for name in get_type_hints(record) if not name.startswith("_"))


def _comments(record: type) -> dict[str, str]:
    """What the source says of each field: behind it, or in the lines of comment above it."""
    found, above = {}, []
    for line in inspect.getsource(record).splitlines():
        if match := FIELD.match(line):
            found[match[1]] = " ".join([*above, match[2] or ""]).strip()
            above = []
        elif match := LEADING.match(line):
            above.append(match[1])
        else:
            above = []
    return found


def _records_in(hint: Any) -> list[type]:
    """Records that a type is made of."""
    if isinstance(hint, type) and (issubclass(hint, msgspec.Struct) or hint in (TickSettings, Thresholds)):
        return [hint]
    return [one for part in get_args(hint) for one in _records_in(part)]


def _type(hint: Any) -> str:
    origin, parts = get_origin(hint), get_args(hint)
    if origin is None:
        return NAMES.get(hint, "section")
    if origin is Annotated:
        return " ".join([_type(parts[0]), *filter(None, map(_bounds, parts[1:]))])
    if origin is Literal:
        return ", ".join(map(code, parts))
    if origin in (Union, types.UnionType):
        return " or ".join("nothing" if part is type(None) else _type(part) for part in parts)
    return _type_of_many(origin, parts)


def _type_of_many(origin: Any, parts: tuple[Any, ...]) -> str:
    if origin is dict:
        return f"{_type(parts[1])} by name"
    if origin is tuple and ... not in parts:
        return f"list of {len(parts)}: {', '.join(dict.fromkeys(map(_type, parts)))}"
    return f"list of {_type(parts[0])}"


def _bounds(meta: Any) -> str:
    low, high = getattr(meta, "ge", None), getattr(meta, "le", None)
    above, below = getattr(meta, "gt", None), getattr(meta, "lt", None)
    words = [f"from {low:g}" if low is not None else f"above {above:g}" if above is not None else ""]
    words += [f"to {high:g}" if high is not None else f"below {below:g}" if below is not None else ""]
    return " ".join(word for word in words if word)


def _default(value: Any) -> str:
    if value is ...:
        return "required"
    if isinstance(value, msgspec.Struct | TickSettings | Thresholds):
        return "see below"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, list | tuple) and value:
        return f"[{', '.join(map(_default, value))}]"
    return "" if value is None else str(value) or "empty" if isinstance(value, str | int) else "empty"
