"""What comes late while others have the machine is skipped, and says so; every other failure counts."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import psutil
import pytest
from disturbance import BUSY, LATE, ROOT, Taken, excuse, put_off, taken
from harness.timing import is_late, on_the_clock

PLACE = ("shell/test_made_up.py", 3, "test_late")
SPIN = "import time\nend = time.process_time() + 0.6\nwhile time.process_time() < end: pass"


def report(
    outcome: Literal["passed", "failed"], when: Literal["setup", "call", "teardown"] = "call"
) -> pytest.TestReport:
    return pytest.TestReport("made_up", PLACE, {}, outcome, ">   assert late\nE   assert 0.5 < 0.3", when)


def raised(judge: Callable[[], None]) -> AssertionError:
    with pytest.raises(AssertionError) as caught:
        judge()
    return caught.value


def late() -> None:
    with on_the_clock():
        raise AssertionError("assert 0.5 < 0.3")


def wrong() -> None:
    raise AssertionError("assert 'FAULT' == 'DISARMED'")


def test_only_what_the_clock_judges_is_marked() -> None:
    assert is_late(raised(late)) and not is_late(raised(wrong)) and not is_late(None)


def test_what_is_late_beside_others_is_a_skip_that_tells_of_both() -> None:
    for when in ("setup", "call"):
        made = report("failed", when)
        excuse(made, raised(late), 0.93)
        assert made.skipped
        path, line, told = made.longrepr
        assert (path, line) == PLACE[:2]
        assert "others had 93% of the machine" in told and "assert 0.5 < 0.3" in told


@pytest.mark.parametrize(
    ("judge", "share"), [(late, 0.0), (late, 0.99 * BUSY), (wrong, 1.0)], ids=["alone", "nearly", "wrong"]
)
def test_every_other_failure_counts(judge: Callable[[], None], share: float) -> None:
    made = report("failed")
    excuse(made, raised(judge), share)
    assert made.failed and "assert 0.5 < 0.3" in made.longreprtext


@pytest.mark.parametrize(("judge", "later"), [(late, True), (wrong, False)], ids=["late", "wrong"])
def test_what_is_late_is_asked_again_where_somebody_will(
    judge: Callable[[], None], later: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(LATE, raising=False)
    put_off(alone := report("failed"), raised(judge))
    assert alone.failed
    monkeypatch.setenv(LATE, str(tmp_path / "late.txt"))
    put_off(beside := report("failed"), raised(judge))
    assert beside.skipped == later == (tmp_path / "late.txt").exists()
    assert not later or (tmp_path / "late.txt").read_text() == "made_up\n"


def test_what_passes_passes() -> None:
    fine = report("passed")
    excuse(fine, raised(late), 1.0)
    assert fine.passed


def test_the_share_is_of_all_cores_and_without_our_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(psutil, "cpu_count", lambda: 2)
    assert Taken(12.0, 7.0, 2.0).others_since(Taken(10.0, 3.0, 1.0)) == 0.75
    assert Taken(12.0, 5.0, 2.0).others_since(Taken(10.0, 3.0, 0.0)) == 0.0


def test_what_our_own_processes_take_is_ours(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ROOT, str(os.getpid()))
    before = taken()
    subprocess.run([sys.executable, "-S", "-c", SPIN], check=True, timeout=100)
    after = taken()
    assert after.ours_s - before.ours_s >= 0.55 and after.all_s - before.all_s >= 0.5


def test_without_an_account_nobody_took_anything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(psutil, "cpu_times", lambda: (_ for _ in ()).throw(OSError("no account")))
    assert taken()[1:] == (0.0, 0.0) and taken().others_since(taken()) == 0.0
