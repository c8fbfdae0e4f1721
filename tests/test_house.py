"""The house: where the hoop's own words may stand, how many modules lie at its top, what an old name still leads to."""

from __future__ import annotations

import ast
import importlib
import re
import warnings
from collections import Counter
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

from hoopd import moved

ROOT = Path(__file__).parents[1] / "hoopd"
# The hoop's angles are named where the device is: its plant, its tick, its rig, its pictures, its daemon.
OF_THE_HOOP = ("plants/hoop/", "core/", "sim/", "vision/", "daemon/", "commands/calibrate.py")


@cache
def parsed() -> dict[Path, ast.Module]:
    """Every module of the house."""
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in ROOT.rglob("*.py")}


def identifiers(module: ast.Module) -> Iterator[str]:
    """Every name of a module: variables, attributes, arguments, keywords, functions and classes."""
    for node in ast.walk(module):
        for part in ("id", "attr", "arg", "name"):
            if isinstance(name := getattr(node, part, None), str):
                yield name


def test_only_the_hoop_names_the_hoops_angles() -> None:
    found = {
        path.relative_to(ROOT).as_posix()
        for path, module in parsed().items()
        if {"theta", "psi"} & set(identifiers(module))
    }
    assert not {name for name in found if not name.startswith(OF_THE_HOOP)}


# Where the drive's limit is a number: the hoop's own, the daemon's safety limit, the drive that sizes are meant for.
OF_THE_LIMIT = {"plants/hoop/parameters.py", "core/limits.py", "plants/effects/usual_sizes.py"}
# The same numbers, and no torque: a share, a radius of a drawing, a ring about a ball, widths of lines.
NO_TORQUE = ("diagnose/quality/turns.py", "vision/", "plots/", "ident/")


def test_the_drives_limit_is_typed_where_it_is_decided() -> None:
    """Everything else reads it from the plant, from a model file or from `core.limits`."""
    found = {
        path.relative_to(ROOT).as_posix()
        for path, module in parsed().items()
        for node in ast.walk(module)
        if isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value in (0.7, 1.4)
    }
    assert {name for name in found if not name.startswith(NO_TORQUE)} == OF_THE_LIMIT


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph = grimp.build_graph("hoopd", exclude_type_checking_imports=True)
    order = TopologicalSorter({name: graph.find_modules_directly_imported_by(name) for name in graph.modules})
    order.prepare()  # CycleError names the circle


# What a law is to the tick, and what the lab hands a user under that name.
TWO_MEANINGS = {"Controller"}


def test_a_public_class_has_a_name_of_its_own() -> None:
    places = Counter(
        node.name
        for module in parsed().values()
        for node in module.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert {name for name, count in places.items() if count > 1} <= TWO_MEANINGS


def test_few_modules_lie_at_the_top() -> None:
    assert len(list(ROOT.glob("*.py"))) <= 6


@pytest.mark.parametrize("old", sorted(moved.MOVED))
def test_an_old_name_leads_to_where_its_module_is(old: str) -> None:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        moved_module = importlib.reload(importlib.import_module(f"hoopd.{old}"))
    assert any(issubclass(one.category, DeprecationWarning) and "is now" in str(one.message) for one in said)
    for target in moved.MOVED[old].split():
        names = [name for name in vars(importlib.import_module(f"hoopd.{target}")) if not name.startswith("_")]
        assert not names or hasattr(moved_module, names[-1])


def test_what_the_pages_of_the_last_version_showed_still_runs() -> None:
    with pytest.warns(DeprecationWarning, match="hoopd.physics.effects.base is now hoopd.plants.effects.base"):
        space: dict[str, object] = {}
        exec("from hoopd.physics.effects import base\nfrom hoopd.physics.effects.base import Effect", space)
        importlib.reload(importlib.import_module("hoopd.physics.effects.base"))
    assert space["Effect"] is importlib.import_module("hoopd.plants.effects.base").Effect


def test_an_unknown_name_is_no_module() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"hoopd\.nothing"):
        importlib.import_module("hoopd.nothing")
    with pytest.raises(ImportError, match="nowhere"):
        exec("from hoopd.modelfiles import nowhere", {})


def test_a_class_that_was_renamed_is_found_under_its_old_module() -> None:
    for place in moved.RENAMED.values():
        target, _, name = place.rpartition(".")
        assert hasattr(importlib.import_module(f"hoopd.{target}"), name), place
    with pytest.warns(DeprecationWarning, match="Found is now hoopd.plants.found_effects.FoundEffects"):
        found = importlib.import_module("hoopd.physics.found").Found
    assert found is importlib.import_module("hoopd.plants.found_effects").FoundEffects


def test_a_docstring_names_files_that_are_there() -> None:
    """`channel_course.py` in a text leads somewhere: modules move, and what tells of them stays behind."""
    folders = (ROOT, *(ROOT.parent / name for name in ("tools", "tests", "docs")))
    known = {path.name for folder in folders for path in folder.rglob("*.py")}
    wrong = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in sorted(ROOT.rglob("*.py"))
        for name in re.findall(r"(?<![\w/<-])([a-z]\w*\.py)\b", path.read_text(encoding="utf-8"))
        if name not in known
    ]
    assert wrong == []
