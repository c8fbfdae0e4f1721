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

from docpages.markdown import sections

SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
LAB = """# Python: `hoopd.lab`

The commands of the bench for a notebook. A lesson with it: `docs/lesson.py`."""
IDENT = """# Python: `hoopd.ident`

The identification toolbox: data in, python-control systems out. It knows no plant and no file. What each part is for:
[the toolbox](../ident.md)."""
PLANTS = """# Python: `hoopd.plants`

What a plant is, what an effect is, and what can be done with any of them. A plant of your own as a file needs none of
this."""
PLANT_MODULES = {
    "hoopd.plants.declaration": (),
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
    parts = [
        f"## {name}",
        f"```python\nfrom {one.__module__} import {name}\n\n{name}{_signature(one)}\n```",
        _docstring(one),
    ]
    if inspect.isclass(one):
        methods = [
            (key, value)
            for key, value in vars(one).items()
            if key[0] != "_" and (inspect.isfunction(value) or isinstance(value, property)) and inspect.getdoc(value)
        ]
        parts += [
            f"**{key}{'' if isinstance(value, property) else _signature(value)}**\n\n{_docstring(value)}"
            for key, value in methods
        ]
    return sections(*parts)


def _signature(one: Any) -> str:
    try:
        text = str(inspect.signature(one))
    except (TypeError, ValueError):
        return "(...)"
    text = text.replace("(self, ", "(").replace("(self)", "()")
    return re.sub(r"<(?:factory|object|function|class)[^>]*>", "...", text.replace("'", ""))


def _docstring(one: Any) -> str:
    """Its first part as text, its sections below their names, its examples as code."""
    first, *rest = SECTION.split(inspect.getdoc(one) or "")
    parts = [_text(first)]
    for name, body in zip(rest[::2], rest[1::2], strict=True):
        parts += [f"*{name}*", _text(body)]
    return sections(*parts)


def _text(body: str) -> str:
    """Paragraphs; one with its own indentation, an example or an entry of a section keeps its lines."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", body.strip("\n")):
        lines = paragraph.splitlines()
        kept = any(line.startswith((" ", ">>>")) for line in lines)
        parts.append(f"```text\n{paragraph}\n```" if kept else paragraph)
    return "\n\n".join(part for part in parts if part.strip())
