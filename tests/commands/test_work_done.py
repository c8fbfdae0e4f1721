"""How much of a long command is done, as a bar on a terminal shows it."""

from __future__ import annotations

import re
from io import StringIO
from itertools import pairwise
from pathlib import Path

import pytest
from rich.console import Console

import hoopd
from hoopd.commands.options.shared import shown_progress
from hoopd.commands.work_done import DIAGNOSIS, WorkDone


def test_the_known_steps_of_a_diagnosis_are_steps_that_it_tells() -> None:
    folder = Path(hoopd.__file__).parent
    sources = [*(folder / "diagnose").rglob("*.py"), folder / "commands" / "diagnose.py"]
    told = {text for path in sources for text in re.findall(r"progress\(\"([^\"]+)\"\)", path.read_text())}
    assert set(DIAGNOSIS) <= told
    assert [*DIAGNOSIS.values()] == sorted(DIAGNOSIS.values()) and max(DIAGNOSIS.values()) < 1.0


def test_the_fraction_only_grows_and_never_reaches_what_comes_next() -> None:
    done = WorkDone(DIAGNOSIS)
    steps = ["reading the recordings", "base parameters", *["screening the library", "fitting a.b"] * 20]
    found = [done.at(step) for step in steps]
    assert all(a < b for a, b in pairwise(found))
    assert found[-1] < DIAGNOSIS["screening mechanisms"]
    assert done.at("drawing and writing") == DIAGNOSIS["drawing and writing"]


@pytest.mark.parametrize("terminal", [True, False])
def test_a_bar_with_a_fraction_stands_on_a_terminal_and_nothing_elsewhere(
    terminal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = StringIO()
    monkeypatch.setattr(
        "rich.console.Console", lambda stderr: Console(file=out, force_terminal=terminal, width=100, _environ={})
    )
    with shown_progress(DIAGNOSIS) as progress:
        progress("what no name explains")
    assert (f"{DIAGNOSIS['what no name explains']:.0%}" in out.getvalue()) is terminal
    assert ("what no name explains" in out.getvalue()) is terminal
