"""What tests and benches share lies in tools/harness: no tool imports a test, and only the tests of tools a tool.

Tests of tools lie in tests/tools, and beside the pages those of the tools that make pages.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS, TOOLS = ROOT / "tests", ROOT / "tools"
SHARED = ("harness", "concealed")  # the proof is imported as a whole by those who stand beside it


def modules(folder: Path) -> set[str]:
    """Names by which the modules and packages of a folder are imported when it is on the path."""
    return {path.stem for path in folder.iterdir() if path.suffix == ".py" or any(path.glob("*.py"))}


def imported(path: Path) -> Iterator[str]:
    """First parts of what a file imports, at its top or further in."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module.partition(".")[0]


def crossing(files: Iterator[Path], forbidden: set[str]) -> list[str]:
    return [f"{path.relative_to(ROOT)}: {name}" for path in files for name in imported(path) if name in forbidden]


def test_no_tool_imports_a_test() -> None:
    ours = modules(TOOLS) | modules(TOOLS / "bench")
    assert crossing(TOOLS.rglob("*.py"), {"tests", *modules(TESTS)} - ours) == []


def test_only_the_tests_of_tools_import_tools() -> None:
    of_tools = {"tools", *modules(TOOLS), *modules(TOOLS / "bench")} - set(SHARED) - modules(TESTS)
    files = (path for path in TESTS.rglob("*.py") if not {TESTS / "tools", TESTS / "docs"} & {*path.parents})
    assert crossing(files, of_tools) == []
