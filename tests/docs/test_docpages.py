"""Pages that are made from the code hold all that the code knows: commands, options, keys, effects, fields, names."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import typer

import hoopd.ident
import hoopd.lab
from hoopd.commands.cli import app
from hoopd.core.layout import DEFAULT_LAYOUT
from hoopd.files.model import ModelFile
from hoopd.plants.registry import REGISTERED
from hoopd.recording import schemas
from hoopd.shell.config import Config
from tests.shellblocks import parse

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        from docpages import written
    finally:
        sys.path.remove(str(ROOT / "tools"))
    folder = tmp_path_factory.mktemp("pages")
    (folder / "old.md").write_text("of a page that is no more")
    first = {path: path.stat().st_mtime_ns for path in written(folder)}
    assert {path: path.stat().st_mtime_ns for path in written(folder)} == first  # nothing changed: nothing written
    assert set(folder.iterdir()) == set(first)
    return {path.name: path.read_text() for path in first}


def test_every_command_and_option_is_told(pages: dict[str, str]) -> None:
    program: Any = typer.main.get_command(app)
    page = pages["command_line.md"]
    for name, command in {"": program, **program.commands}.items():
        section = page.partition(f"## hoopd {name}".rstrip() + "\n")[2].partition("\n## ")[0].partition("\n### ")[0]
        options = [one for one in command.params if one.param_type_name == "option"]
        assert section and [one.opts for one in options if f"| `{one.opts[0]}`" not in section] == [], name


def test_an_option_tells_what_it_takes(pages: dict[str, str]) -> None:
    experiment = pages["command_line.md"].partition("### hoopd experiment\n")[2].partition("\n### ")[0]
    assert "| `--seed` | `WHOLE NUMBER` from 0 | `0` |" in experiment and "| `--sim` |  |  |" in experiment
    assert "hoopd experiment KIND [OPTIONS]" in experiment


@pytest.mark.parametrize(("page", "record"), [("configuration.md", Config), ("files.md", ModelFile)])
def test_every_key_is_told_with_its_default(pages: dict[str, str], page: str, record: type) -> None:
    told = pages[page]
    for name, hint in get_type_hints(record).items():
        inner = list(get_type_hints(hint)) if page == "configuration.md" else []
        keys = [key for key in inner if not key.startswith("_")] or [name]
        assert [key for key in keys if f"| `{key}` |" not in told] == [], name


def test_a_key_has_its_range_default_and_comment(pages: dict[str, str]) -> None:
    told = pages["configuration.md"]
    assert "| `baud` | whole number from 1200 to 4e+06 | 115200 |  |" in told
    assert "| `weights` | list of 3: number from -1000 to 1000 | [1, -0.5, -0.5] | of R, G, B |" in told
    assert "## `vision.circle_px`" in told and "| `ball_mass_kg` | number | required |" in pages["files.md"]


def test_every_effect_of_the_library_is_told(pages: dict[str, str]) -> None:
    told = pages["effects_library.md"]
    listed = (ROOT / "docs" / "reference" / "effects.md").read_text().partition("| name |")[2].partition("\n\n")[0]
    names = [row.split("|")[1].strip() for row in listed.splitlines()[2:]]
    assert len(names) > 25 and [name for name in names if f"### {name}\n" not in told] == []
    assert "| `Fc` | N m | 0 |" in told


def test_a_docstring_is_shown_by_its_sections(pages: dict[str, str]) -> None:
    told = pages["python_ident.md"].partition("\n## arx\n")[2].partition("\n## ")[0]
    assert "- `na` (int): Coefficients of A after the leading 1." in told
    assert "- `ValueError`: " in told and "```pycon\n>>> import numpy as np" in told


def test_a_text_means_what_it_says(pages: dict[str, str]) -> None:
    plain = sys.modules["docpages.markdown"].plain
    assert plain("a * b * c in [0, 1](open) for `x * y`, $5") == "a \\* b \\* c in \\[0, 1\\](open) for `x * y`, \\$5"


def test_every_plant_that_has_a_name_is_told(pages: dict[str, str]) -> None:
    listed = pages["plants.md"]
    assert [name for name in REGISTERED if f"[{name}](plant_{name}.md)" not in listed] == []
    told = pages["plant_pendulum.md"]
    assert "| `J` | 0.0002 | kg m2 | 1e-06 to 0.01 | yes |" in told and "schema: hoopd.plant/1" in told
    assert "coulomb_friction" in told and "hoopd experiment" not in told  # it has no input


@pytest.mark.parametrize("name", REGISTERED)
def test_every_command_that_a_plants_page_shows_is_understood(pages: dict[str, str], name: str) -> None:
    block = pages[f"plant_{name}.md"].partition("```\n")[2].partition("```")[0]
    lines = [line.split() for line in block.splitlines()]
    assert len(lines) >= 6 and {line[0] for line in lines} == {"hoopd"}
    for line in lines:
        parse(line[1:])


def test_every_room_and_import_is_drawn(pages: dict[str, str]) -> None:
    told = pages["imports.md"]
    rooms = {path.parent.name for path in (ROOT / "hoopd").glob("*/__init__.py")}
    assert rooms and [room for room in rooms if f">{room}</text>" not in told or f"| `{room}` |" not in told] == []
    assert "<title>commands imports plants: " in told and "arrows that run back up or sideways: none;" in told


def test_a_circle_of_imports_is_found(pages: dict[str, str]) -> None:
    imports = sys.modules["docpages.imports"]
    graph = {"a": ["b"], "b": ["c", "d"], "c": ["a"], "d": [], "e": ["a"]}
    assert imports.circles(graph) == [["a", "b", "c"]]
    back = imports.drawing([["a"], ["b"]], {("b", "a"): 1})
    assert "#d00000" in back and "#d00000" not in imports.drawing([["a"], ["b"]], {("a", "b"): 1})


def test_every_field_of_messages_and_frames_is_told(pages: dict[str, str]) -> None:
    told = pages["messages.md"]
    fields = [(name, one.meaning) for table in schemas.RECORDS.values() for name, one in table.items()]
    assert [name for name, meaning in fields if f"`{name}`" not in told or meaning not in told] == []
    assert f"### Answer: {DEFAULT_LAYOUT.answer.length} bytes" in told and "| 16 | board_ms | u16 |" in told


@pytest.mark.parametrize(("page", "module"), [("python_lab.md", hoopd.lab), ("python_ident.md", hoopd.ident)])
def test_every_public_name_is_told(pages: dict[str, str], page: str, module: Any) -> None:
    callables = [name for name in module.__all__ if callable(getattr(module, name))]
    assert callables and [name for name in callables if f"\n## {name}\n" not in pages[page]] == []
