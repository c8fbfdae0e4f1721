"""The judge of the races tells the rig's own arm from those that operators sent."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[2] / "tools" / "bench"))

from racing.judge import Taken, armed_by_nobody


def rows(*commands: tuple[float, str]) -> list[Taken]:
    return [Taken(t, t, tuple(names.split())) for t, names in commands]


@pytest.mark.parametrize("slack_s", [0.0, 0.1])
def test_one_arm_by_itself_before_all_that_switches_off_is_nobodys_fault(slack_s: float) -> None:
    taken = rows((1.46, "arm"), (1.54, "arm"), (1.62, "arm clear disarm"))
    assert armed_by_nobody([1.489, 1.514], taken, slack_s) == []


@pytest.mark.parametrize("slack_s", [0.0, 0.1])
def test_one_after_it_and_a_second_one_are_wrong(slack_s: float) -> None:
    assert len(armed_by_nobody([], rows((1.0, "disarm"), (1.4, "arm")), slack_s)) == 1
    assert len(armed_by_nobody([1.2], rows((1.0, "disarm"), (1.4, "arm"), (1.6, "arm")), slack_s)) == 1
    assert len(armed_by_nobody([], rows((1.0, "arm"), (1.4, "arm")), slack_s)) == 1
