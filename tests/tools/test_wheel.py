"""The wheel holds all of the package, and what it installs is the whole program."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "tools"))
        return importlib.import_module("wheel")


@pytest.fixture(scope="module")
def wheel(tool: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tool.build(tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel's files; what it depends on is that of this interpreter."""
    folder = tmp_path_factory.mktemp("installed")
    install = ("install", "--quiet", "--no-deps", "--no-index", "--no-compile", "--target", folder, wheel)
    subprocess.run([sys.executable, "-m", "pip", "--disable-pip-version-check", *install], check=True, timeout=100)
    return folder


def run(installed: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The installed program, from a folder of its own."""
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, str(installed / "bin" / "hoopd"), *words]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=100, check=False
    )


def test_it_has_every_module_the_configuration_and_the_licence(tool: ModuleType, wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    names = set(archive.namelist())
    assert tool.missing(names) == []
    assert tool.missing(names - {"hoopd/_config/hoop.yaml"}) == ["hoopd/_config/hoop.yaml"]
    assert {name.partition("/")[0].partition("-")[0] for name in names} == {"hoopd"}  # and nothing beside it
    (metadata,) = (archive.read(name).decode() for name in names if name.endswith("/METADATA"))
    assert "\nLicense-Expression: Apache-2.0 AND MIT\n" in metadata and "\nLicense-File: LICENSE\n" in metadata
    assert "\nLicense-File: hoopd/dashboard/static/uplot/LICENSE\n" in metadata


def test_what_it_installs_knows_every_command(installed: Path, tmp_path: Path) -> None:
    import typer

    from hoopd.commands.cli import app

    shown = run(installed, tmp_path, "--help")
    assert shown.returncode == 0, shown.stderr
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert [name for name in commands if name not in shown.stdout] == []


RUN = "--sim --speed max --camera direct --duration 2 --record . --json summary.json"
DESIGN = "design lqg --model models/hoop.yaml --out mine.yaml"


def test_what_it_installs_runs_the_rig_with_its_own_files(installed: Path, tmp_path: Path) -> None:
    ran, designed = (run(installed, tmp_path, *words.split()) for words in (RUN, DESIGN))
    assert (ran.returncode, designed.returncode) == (0, 0), ran.stderr + designed.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["ticks"] > 0 and summary["running_s"] > 0.5 and summary["faults"] == {}
    assert (tmp_path / "run-0001.mcap").is_file() and (tmp_path / "mine.yaml").is_file()
