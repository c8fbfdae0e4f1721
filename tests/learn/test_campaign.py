"""What a campaign compares with what."""

from __future__ import annotations

from pathlib import Path

import msgspec
from harness.told_diagnosis import said

from hoopd.learn.campaign import Campaign
from hoopd.learn.choice import ChosenRun


def given(campaign: Campaign, number: int, nats: float, *recordings: str) -> None:
    """Recordings that were made by hand, and a law that is named in them and that no simulation tests."""
    told = said(0.92, "untested")
    evidence = msgspec.structs.replace(told.effects[0].evidence, log_likelihood_gain=nats)
    told = msgspec.structs.replace(told, effects=[msgspec.structs.replace(told.effects[0], evidence=evidence)])
    files = campaign.run_files(number)
    campaign.keep(files, ChosenRun(recordings, "was recorded by hand"), 20.0 * len(recordings))
    files.diagnosis.write_bytes(msgspec.json.encode(told))


def test_what_other_recordings_said_proves_nothing_and_what_fewer_of_the_same_said_does(tmp_path: Path) -> None:
    campaign = Campaign(tmp_path)
    given(campaign, 1, 17.0, "a.csv", "b.csv")
    given(campaign, 2, 60.0, "c.csv", "d.csv")
    given(campaign, 3, 90.0, "c.csv", "d.csv", "e.csv")
    assert [one.belief.settled for one in campaign.runs(0.95)] == [False, False, True]
