"""Which licence a package has by its own word, and whether it is permitted."""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture(autouse=True)
def tools(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(TOOLS))


def tool(name: str) -> ModuleType:
    return importlib.import_module(name)


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        ("MIT", True),
        ("GPL-3.0-only", False),
        ("GPL-3.0-only OR MIT", True),
        ("MIT AND GPL-3.0-only", False),
        ("(GPL-3.0-only OR MIT) AND ISC", True),
        ("GPL-3.0-only OR MIT AND AGPL-3.0-only", False),
        ("ISC WITH LLVM-exception", True),
        ("GPL-3.0-only WITH GCC-exception-3.1", False),
    ],
)
def test_permitted_expressions(text: str, allowed: bool) -> None:
    assert tool("licences").verdict(text, {"MIT", "ISC"}) == ("" if allowed else "not permitted")


@pytest.mark.parametrize(
    ("fields", "classifiers", "licence"),
    [
        ({"License-Expression": "MIT OR Apache-2.0", "License": "BSD"}, [], "MIT OR Apache-2.0"),
        ({"License": "bsd-3-clause"}, ["License :: OSI Approved :: BSD License"], "BSD-3-Clause"),
        ({"License": "Copyright\nall its text"}, ["License :: OSI Approved :: MIT License"], "MIT"),
        ({"License": "BSD"}, [], "LicenseRef-BSD"),
        ({}, ["License :: OSI Approved"], ""),
        # Either, or both? Metadata do not say it.
        ({}, ["License :: OSI Approved :: MIT License", "License :: OSI Approved :: BSD License"], ""),
        ({"License": "see file"}, [], ""),
        ({}, [], ""),
    ],
)
def test_what_a_package_says_of_itself(fields: dict[str, str], classifiers: list[str], licence: str) -> None:
    assert tool("licences").expression(fields, classifiers) == licence


def test_a_package_without_licence_or_with_one_that_is_not_permitted_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    licences, lockfile = tool("licences"), tool("lockfile")
    for name, lines in {
        "silent": "",
        "strict": "License-Expression: AGPL-3.0-only\n",
        "odd": "License-Expression: ?\n",
    }.items():
        (tmp_path / f"{name}-1.0.dist-info").mkdir()
        text = f"Metadata-Version: 2.4\nName: {name}\nVersion: 1.0\n{lines}"
        (tmp_path / f"{name}-1.0.dist-info/METADATA").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))

    def trouble(name: str, version: str = "1.0", **stated: str) -> str:
        return licences.judge(lockfile.Pin(name, version, (64 * "0",)), {"MIT"}, stated).trouble

    assert trouble("silent") == "no clear licence"
    assert trouble("silent", silent="MIT") == ""
    assert trouble("strict") == trouble("strict", strict="MIT") == "not permitted"
    assert trouble("odd") == "not an SPDX expression"
    assert "1.0 is installed" in trouble("silent", "2.0", silent="MIT")
    assert trouble("absent") == "not installed here"


def test_every_dependency_has_a_permitted_licence(tmp_path: Path) -> None:
    command = [sys.executable, TOOLS / "licences.py", "--json", tmp_path / "licences.json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stdout
    listed = json.loads((tmp_path / "licences.json").read_text())
    lockfile = tool("lockfile")
    assert {row["name"] for rows in listed.values() for row in rows} == set(lockfile.versions(lockfile.LOCKS))
