"""What a public name does is said where it stands: each parameter with its type, what comes back, an example that runs.

A public name is held to it by being public.
"""

from __future__ import annotations

import dataclasses
import doctest
import inspect
import io
import re
from importlib import import_module
from typing import Any

import numpy as np
import pytest

from hoopd import ident, lab, plots

# A heading, and dashes under it.
HEADING = re.compile(r"^([A-Z]\w+)\n-{3,}$", re.MULTILINE)
# "name : type", or several names of one type; the text stands indented below.
ENTRY = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*) : (\S.*)\n((?:[ ]{4}.*\n?|\n)*)", re.MULTILINE)

# What a plant is declared, found, loaded and run by, by module; this list only grows.
PLANTS = {
    "declaration": "Input Channel Slot Plant",
    "plant_file": "load_plant parse_plant",
    "registry": "plant_named resolve_plant",
    "layout": "layout_of",
    "free_run": "run readings",
    "held_input": "node_axis mean_inputs mean_torque",
    "compiled": "zero_order_hold",
    "plant_model": "load_plant_model nominal_model",
    "effects.library": "library",
    "effects.vocabulary": "known_effects",
    "effects.grammar.mechanisms": "mechanisms",
    "relative_degree": "relative_degrees",
}
DOCUMENTED = (
    {f"ident.{name}": getattr(ident, name) for name in ident.__all__}
    | {f"plots.{name}": getattr(plots, name) for name in plots.__all__}
    | {
        f"plants.{module}.{name}": getattr(import_module(f"hoopd.plants.{module}"), name)
        for module, names in PLANTS.items()
        for name in names.split()
    }
)
# This list grows, too. The examples of the lab, some of which run the daemon, are run by tests/test_lab.py.
FUNCTIONS = """
    controller daemon design diagnose experiment feedback fit fit_plant linearize load model plant plot save simulate
    simulate_plant
"""
LAB = {f"lab.{name}": getattr(lab, name) for name in FUNCTIONS.split()}


def sections(text: str) -> dict[str, str]:
    """The sections of a numpydoc docstring by heading; what stands before the first one is ""."""
    parts = HEADING.split(inspect.cleandoc(text))
    return {"": parts[0]} | {name: body.strip("\n") for name, body in zip(parts[1::2], parts[2::2], strict=True)}


def entries(section: str) -> dict[str, str]:
    """The text of each name of a section of parameters."""
    return {
        name.strip("* "): body.strip() for names, _, body in ENTRY.findall(section + "\n") for name in names.split(",")
    }


def parameters(thing: Any) -> list[str]:
    """What the caller gives, or the fields of a record."""
    if dataclasses.is_dataclass(thing):
        return [field.name for field in dataclasses.fields(thing) if not field.name.startswith("_")]
    return [name for name in inspect.signature(thing).parameters if name != "self"]


def is_warning(thing: Any) -> bool:
    return inspect.isclass(thing) and issubclass(thing, Warning)


@pytest.mark.parametrize("name", sorted(DOCUMENTED | LAB))
def test_the_docstring_is_whole(name: str) -> None:
    thing = (DOCUMENTED | LAB)[name]
    text = inspect.getdoc(thing) or ""
    first = text.split("\n\n")[0]
    assert first and first[0].isupper() and first.endswith("."), f"{name}: the summary is a sentence, not {first!r}"
    if is_warning(thing):
        return
    found = sections(text)
    told = entries(found.get("Parameters", "")) | entries(found.get("Attributes", ""))
    wanted = parameters(thing)
    assert [one for one in wanted if one not in told] == [], f"{name}: parameters without a type and a line"
    assert set(told) <= set(wanted) or inspect.isclass(thing), f"{name}: told of and not there"
    assert all(told.values()), f"{name}: a parameter has a name and a type, and no text"
    if not inspect.isclass(thing) and inspect.signature(thing).return_annotation not in (None, "None"):
        assert entries(found.get("Returns", "")) or re.match(r"\S.*\n {4}\S", found.get("Returns", "")), (
            f"{name}: what comes back has a type and a line"
        )
    assert ">>> " in found.get("Examples", ""), f"{name}: no example"


@pytest.mark.parametrize("name", sorted(DOCUMENTED))
def test_the_example_runs(name: str) -> None:
    state = np.random.get_state()
    test = doctest.DocTestParser().get_doctest(inspect.getdoc(DOCUMENTED[name]) or "", {}, name, None, 0)
    said = io.StringIO()
    outcome = doctest.DocTestRunner(verbose=False).run(test, out=said.write)
    assert outcome.failed == 0, said.getvalue()
    assert len(test.examples) >= 2 or is_warning(DOCUMENTED[name])
    after = np.random.get_state()
    assert all(np.array_equal(a, b) for a, b in zip(state, after, strict=True)), "seeded generators only"
