"""A test on the clock that fails while others have the machine is skipped, and says so; every other failure counts."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest
from disturbance import BUSY, Waited, excuse, waited

PLACE = ("shell/test_made_up.py", 3, "test_late")


def report(
    outcome: Literal["passed", "failed"], when: Literal["setup", "call", "teardown"] = "call"
) -> pytest.TestReport:
    return pytest.TestReport("made_up", PLACE, {}, outcome, ">   assert late\nE   assert 0.5 < 0.3", when)


def test_a_failure_beside_others_is_a_skip_that_tells_of_both() -> None:
    for when in ("setup", "call"):
        late = report("failed", when)
        excuse(late, 0.93)
        assert late.skipped
        path, line, told = late.longrepr
        assert (path, line) == PLACE[:2]
        assert "for 93% of its time somebody waited" in told and "assert 0.5 < 0.3" in told


@pytest.mark.parametrize("share", [0.0, 0.99 * BUSY])
def test_a_failure_on_a_machine_of_its_own_counts(share: float) -> None:
    late = report("failed")
    excuse(late, share)
    assert late.failed and "assert 0.5 < 0.3" in late.longreprtext


def test_what_passes_passes() -> None:
    fine = report("passed")
    excuse(fine, 1.0)
    assert fine.passed


def test_the_share_is_that_of_the_kernels_account(tmp_path: Path) -> None:
    account = tmp_path / "cpu"
    account.write_text("some avg10=0.00 avg60=0.00 avg300=0.00 total=2500000\nfull avg10=0.00 total=7\n")
    assert waited(account).waited_s == 2.5
    assert Waited(12.0, 2.5).share_since(Waited(10.0, 1.0)) == 0.75
    assert waited(tmp_path / "none").waited_s == 0.0
