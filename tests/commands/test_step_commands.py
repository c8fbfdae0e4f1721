"""A command as a step of a longer work: its words are kept, its end is told, and what never ends is ended."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import pytest

from hoopd.commands.step_commands import StepError, run_step

SLEEPS = (sys.executable, "-c", "import time; time.sleep(60)")


def test_a_step_that_fails_is_told_by_its_own_last_line(tmp_path: Path) -> None:
    with pytest.raises(StepError, match=r"^hoopd convert: .*nothing\.mcap"):
        run_step(["convert", tmp_path / "nothing.mcap", tmp_path / "out.csv"], tmp_path / "log")
    assert "nothing.mcap" in (tmp_path / "log").read_text("utf-8")


def test_a_step_that_is_not_done_in_time_is_ended(tmp_path: Path) -> None:
    began = time.monotonic()
    with pytest.raises(StepError, match=r"^hoopd diagnose: not done after 1 s, ended$"):
        run_step(["diagnose"], tmp_path / "log", prefix=SLEEPS, limit_s=1.0)
    assert time.monotonic() - began < 30.0
