"""Completion of commands and options in bash, zsh and fish, as the guide on installing tells."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from samples import sampled

PROGRAM = f'#!/bin/sh\nexec "{sys.executable}" -m hoopd "$@"\n'
# What a shell hands over with the words that were typed so far.
ASKED = {
    "bash": ({"COMP_WORDS": "hoopd di", "COMP_CWORD": "1"}, {"COMP_WORDS": "hoopd diagnose --hold", "COMP_CWORD": "2"}),
    "zsh": ({"_TYPER_COMPLETE_ARGS": "hoopd di"}, {"_TYPER_COMPLETE_ARGS": "hoopd diagnose --hold"}),
    "fish": tuple(
        {"_TYPER_COMPLETE_ARGS": words, "_TYPER_COMPLETE_FISH_ACTION": "get-args"}
        for words in ("hoopd di", "hoopd diagnose --hold")
    ),
}


@pytest.fixture
def program(tmp_path: Path) -> dict[str, str]:
    """An environment in which `hoopd` is this program."""
    path = tmp_path / "hoopd"
    path.write_text(PROGRAM)
    path.chmod(0o755)
    root = str(Path(__file__).resolve().parents[1])
    return {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": root}


def said(environment: dict[str, str], *command: str) -> str:
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("shell", sampled(ASKED, ["bash"]))
def test_commands_and_options_are_offered(program: dict[str, str], shell: str) -> None:
    commands, options = (
        said({**program, "_HOOPD_COMPLETE": f"complete_{shell}", **words}, "hoopd") for words in ASKED[shell]
    )
    assert "diagnose" in commands and "disarm" in commands and "fit" not in commands
    assert "--holdout" in options


@pytest.mark.parametrize("shell", ASKED)
def test_the_script_of_a_shell_names_the_program(program: dict[str, str], shell: str) -> None:
    script = said({**program, "_HOOPD_COMPLETE": f"source_{shell}"}, "hoopd")
    assert "hoopd" in script and f"complete_{shell}" in script


def test_bash_itself_completes_with_it(program: dict[str, str]) -> None:
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash here")
    asked = """
source <(_HOOPD_COMPLETE=source_bash hoopd)
COMP_WORDS=(hoopd dia) COMP_CWORD=1
_hoopd_completion hoopd dia hoopd
printf '%s\\n' "${COMPREPLY[@]}"
"""
    assert said(program, bash, "-euc", asked).split() == ["diagnose"]
