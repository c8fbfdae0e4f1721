"""Examples in docstrings run; those of `ident` in tests/ident/test_docstrings.py, of `lab` in tests/test_lab.py."""

from __future__ import annotations

import doctest
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ELSEWHERE = ("ident", "lab")
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "hoopd").rglob("*.py")
    if path.relative_to(ROOT / "hoopd").parts[0] not in ELSEWHERE and ">>> " in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_run(name: str) -> None:
    found = doctest.testmod(import_module(name))
    assert found.attempted and not found.failed
