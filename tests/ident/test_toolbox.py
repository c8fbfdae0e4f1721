"""The toolbox as its page shows it: every name is there, and the example runs."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import hoopd.ident

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "ident.md"
TABLE = PAGE.read_text(encoding="utf-8").split("## What is there")[1].split("\n## ")[0]
NAMES = sorted(set(re.findall(r"`((?:hoopd|control|scipy|numpy)\.[\w.]+)`", TABLE)))


def found(path: str) -> Any:
    """The object of a dotted name: the longest module in it, then attributes."""
    parts = path.split(".")
    for cut in range(len(parts) - 1, 0, -1):
        try:
            here = import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            here = getattr(here, part)
        return here
    raise AssertionError(path)


@pytest.mark.parametrize("path", NAMES)
def test_every_name_of_the_table_is_there(path: str) -> None:
    assert callable(found(path))


def test_the_table_is_the_whole_toolbox() -> None:
    shown = {path.removeprefix("hoopd.ident.") for path in NAMES if path.startswith("hoopd.ident.")}
    unshown = set(hoopd.ident.__all__) - shown
    assert unshown <= {"IdentificationWarning", "Polynomials", "normalize", "noise_spectrum", "crest_factor", "steps"}
    assert len(NAMES) > 90


def test_the_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    code = re.search(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    exec(compile(code[1], str(PAGE), "exec"), {})
    said = capsys.readouterr().out
    assert "subspace {1: " in said and said.strip().endswith("[]")


def test_a_test_signal_loads_nothing_heavy() -> None:
    program = (
        "import sys; from hoopd.ident import prbs; prbs(5);"
        "print(sorted({'scipy', 'control', 'casadi', 'matplotlib'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[]"
