"""What a campaign compares with what."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from harness.told_diagnosis import said

from hoopd.learn.campaign import Campaign
from hoopd.learn.choice import ChosenRun


def given(campaign: Campaign, number: int, nats: float, *recordings: str, sha256: tuple[str, ...] = ()) -> None:
    """Recordings that were made by hand, and a law that is named in them and that no simulation tests."""
    told = said(0.92, "untested")
    evidence = msgspec.structs.replace(told.effects[0].evidence, log_likelihood_gain=nats)
    told = msgspec.structs.replace(told, effects=[msgspec.structs.replace(told.effects[0], evidence=evidence)])
    files = campaign.run_files(number)
    campaign.keep(files, ChosenRun(recordings, "was recorded by hand", sha256=sha256), 20.0 * len(recordings))
    files.diagnosis.write_bytes(msgspec.json.encode(told))


def test_what_other_recordings_said_proves_nothing_and_what_fewer_of_the_same_said_does(tmp_path: Path) -> None:
    campaign = Campaign(tmp_path)
    given(campaign, 1, 17.0, "a.csv", "b.csv")
    given(campaign, 2, 60.0, "c.csv", "d.csv")
    given(campaign, 3, 90.0, "c.csv", "d.csv", "e.csv")
    assert [one.belief.settled for one in campaign.runs(0.95)] == [False, False, True]


def test_what_was_fewer_is_told_by_what_files_hold_and_of_the_same_plant(tmp_path: Path) -> None:
    campaign, other, mine = Campaign(tmp_path), "plant of before", "plant"
    given(campaign, 1, 17.0, "a.csv", sha256=("A", other))
    given(campaign, 2, 90.0, "a.csv", "b.csv", sha256=("A", "B", mine))
    given(campaign, 3, 17.0, "c.csv", sha256=("C", mine))
    given(campaign, 4, 90.0, "c.csv", "d.csv", sha256=("changed", "D", mine))
    given(campaign, 5, 90.0, "./c.csv", "e.csv", sha256=("C", "E", mine))
    assert [one.belief.settled for one in campaign.runs(0.95)] == [False, False, False, False, True]


@pytest.mark.parametrize(
    ("sha256", "inputs", "kinds"),
    [
        (("A" * 64, "B" * 64, "C" * 64, "plant"), ("p", "q", "r"), 3),
        (("A" * 64, "B" * 64, "C" * 64), ("p", "p", "r"), 2),
        (("A" * 64 + "@0:10", "A" * 64 + "@10:20", "A" * 64 + "@20:30"), ("p", "q", "r"), 1),
        (("A" * 64, "B" * 64, "C" * 64, "plant"), (), 3),  # nothing drives it
        ((), (), 1),
    ],
)
def test_kinds_of_signal_are_files_that_were_driven_by_something_else(
    sha256: tuple[str, ...], inputs: tuple[str, ...], kinds: int
) -> None:
    assert ChosenRun(("a", "b", "c"), "was recorded by hand", sha256=sha256, inputs=inputs).kinds == kinds
