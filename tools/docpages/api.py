"""Pages of the Python interfaces from their docstrings: what is public, how it is called, what its docstring says.

Docstrings are plain text or numpydoc. They are shown by their sections; no reStructuredText is made of them, so that
a formula keeps its lines.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from importlib import import_module
from typing import Any

from docpages.markdown import plain, sections

SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
LAB = """# Python: `hoopd.lab`

The commands of the bench for a notebook. A lesson with it: `docs/lesson.py`."""
IDENT = """# Python: `hoopd.ident`

The identification toolbox: data in, python-control systems out. It knows no plant and no file. What each part is for:
[the toolbox](../ident.md)."""
PLANTS = """# Python: `hoopd.plants`

What a plant is, what an effect is, and what can be done with any of them. A plant of your own as a file needs none of
this."""
OF_ENTRIES = ("Parameters", "Returns", "Raises", "Attributes", "Yields", "Warns", "Other Parameters")
LONGEST = 88  # characters of a call on one line
PLANT_MODULES = {
    "hoopd.plants.declaration": (),
    "hoopd.plants.plant_file": ("load_plant", "parse_plant"),
    "hoopd.plants.registry": ("plant_named", "resolve_plant"),
    "hoopd.plants.plant_check": ("checks",),
    "hoopd.plants.free_run": ("FreeRun",),
    "hoopd.plants.fits.plant_fit": (),
    "hoopd.plants.effects.base": (),
    "hoopd.plants.effects.library": ("library",),
}


def lab() -> str:
    """`hoopd.lab`."""
    return _page(LAB, _public("hoopd.lab"))


def ident() -> str:
    """`hoopd.ident`."""
    return _page(IDENT, _public("hoopd.ident"))


def plants() -> str:
    """The declaration of plants and effects, and the library."""
    found = []
    for name, chosen in PLANT_MODULES.items():
        module = import_module(name)
        own = [key for key, one in vars(module).items() if getattr(one, "__module__", "") == name and key[0] != "_"]
        found += [(key, getattr(module, key)) for key in (chosen or own)]
    return _page(PLANTS, found)


def _public(name: str) -> list[tuple[str, Any]]:
    module = import_module(name)
    return [(key, getattr(module, key)) for key in module.__all__]


def _page(introduction: str, found: Iterable[tuple[str, Any]]) -> str:
    return sections(
        introduction, *(_entry(name, one) for name, one in found if inspect.isroutine(one) or inspect.isclass(one))
    )


def _entry(name: str, one: Any) -> str:
    call = f"```python\nfrom {one.__module__} import {name}\n\n{_call(name, one)}\n```"
    if not inspect.isclass(one):
        return sections(f"## {name}", call, _docstring(one))
    public = [(key, value) for key, value in vars(one).items() if key[0] != "_" and inspect.getdoc(value)]
    methods = [(key, value) for key, value in public if inspect.isfunction(value)]
    values = [f"- `{key}`: {_first(value)}" for key, value in public if isinstance(value, property)]
    calls = [f"```python\n.{_call(key, value)}\n```\n\n{_docstring(value)}" for key, value in methods]
    return sections(f"## {name}", call, _docstring(one), "\n".join(values), *calls)


def _first(one: Any) -> str:
    """The first paragraph of a docstring, on one line."""
    return plain(" ".join((inspect.getdoc(one) or "").split("\n\n")[0].split()))


def _call(name: str, one: Any) -> str:
    """How it is called; one argument a line where a line is too short for all."""
    try:
        signature = inspect.signature(one)
    except (TypeError, ValueError):
        return f"{name}(...)"
    parts = [_argument(argument) for argument in signature.parameters.values() if argument.name != "self"]
    result = "" if inspect.isclass(one) or signature.return_annotation is inspect.Signature.empty else " -> "
    result += _hint(signature.return_annotation) if result else ""
    text = f"{name}({', '.join(parts)}){result}"
    return text if len(text) <= LONGEST else f"{name}(\n{''.join(f'    {part},{chr(10)}' for part in parts)}){result}"


def _argument(one: inspect.Parameter) -> str:
    stars = {one.VAR_POSITIONAL: "*", one.VAR_KEYWORD: "**"}.get(one.kind, "")
    hint = "" if one.annotation is one.empty else f": {_hint(one.annotation)}"
    default = repr(one.default)
    told = "" if one.default is one.empty else f" = {'...' if default.startswith('<') else default}"
    return f"{stars}{one.name}{hint}{told}"


def _hint(hint: Any) -> str:
    """An annotation as it stands in the source."""
    return str(getattr(hint, "__forward_arg__", hint if isinstance(hint, str) else getattr(hint, "__name__", hint)))


def _docstring(one: Any) -> str:
    """Its first part as text, its sections below their names, its examples as code."""
    first, *rest = SECTION.split(inspect.getdoc(one) or "")
    parts = [_text(first)]
    for name, body in zip(rest[::2], rest[1::2], strict=True):
        parts += [f"*{name}*", _entries(body) if name in OF_ENTRIES else _text(body)]
    return sections(*parts)


def _entries(body: str) -> str:
    """Entries `name : type` with their meaning below, as a list."""
    listed: list[str] = []
    for line in filter(str.strip, body.strip("\n").splitlines()):
        if line.startswith(" ") and listed:
            listed[-1] += f" {plain(line.strip())}"
        else:
            name, _, kind = line.partition(" : ")
            listed.append(f"- `{name.strip()}`" + (f" ({plain(kind.strip())})" if kind else "") + ":")
    return "\n".join(one.removesuffix(":") if one.endswith(":") else one for one in listed)


def _text(body: str) -> str:
    """Paragraphs; one with its own indentation or an example keeps its lines."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", body.strip("\n")):
        lines = paragraph.splitlines()
        kept = any(line.startswith((" ", ">>>")) for line in lines)
        language = "pycon" if paragraph.startswith(">>>") else "text"
        parts.append(f"```{language}\n{paragraph}\n```" if kept else plain(paragraph))
    return "\n\n".join(part for part in parts if part.strip())
