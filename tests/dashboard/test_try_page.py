"""From the page: a test signal played and recorded, two controllers compared, the candidate accepted, rolled back."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any

import pytest
from dashboard.driven import BUSY_S, Driven, driven, log_in
from harness.browser import CHROMIUM
from shell.peers import wait_until

from hoopd.dashboard.work.bench import Bench
from hoopd.files.shipped import defaults_folder
from hoopd.recording.mcap import read_run

TRIES = 12


def arm(rig: Driven) -> None:
    """By the button that the forms show when it has to be."""
    rig.until(
        lambda: wait_until(lambda: rig.page.text("#mode") == "RUNNING", 3.0),
        lambda: rig.page.ask("void document.querySelector('#compare .arm').click()"),
        "the rig does not run",
    )


def filled(rig: Driven, **numbers: float) -> None:
    """Numbers of both forms."""
    for name, value in numbers.items():
        rig.page.ask(f"void (document.querySelector('[data-signal={name}], [data-compare={name}]').value = {value})")


def played(rig: Driven) -> str:
    """A signal, again when a busy machine was late meanwhile; the name of its recording."""
    for _ in range(TRIES):
        arm(rig)
        rig.page.ask("page.experiment.begin()")
        rig.page.wait_for("!['making', 'playing'].includes(page.experiment.told.last?.state)", BUSY_S)
        time.sleep(0.5)  # shown five times a second
        if "played to its end" in (text := rig.page.text("#signal-state")):
            return text.partition("Recorded as ")[2].removesuffix(".")
    raise AssertionError(f"no signal was played: {rig.page.text('#answer')}, {text}")


def compared(rig: Driven) -> str:
    """A comparison, again when a busy machine's faults ended it; its verdict."""
    for _ in range(TRIES):
        arm(rig)
        rig.page.ask("page.compare.begin()")
        rig.page.wait_for("page.compare.last && !page.compare.last.running", BUSY_S)
        time.sleep(0.5)
        if "3 pairs" in (text := rig.page.text("#compare-verdict")):
            return text
    raise AssertionError(f"no comparison came to its end: {text}")


@pytest.mark.proof
@pytest.mark.realtime
@pytest.mark.timeout(300)
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_a_signal_is_played_and_a_candidate_compared_accepted_and_rolled_back(tmp_path: Path) -> None:
    folder = tmp_path / "controllers"
    folder.mkdir()
    for name in ("lqg.yaml", "arx.yaml"):
        shutil.copyfile(defaults_folder() / "controllers" / name, folder / name)
    (tmp_path / "rec").mkdir()
    bench = Bench(tmp_path / "rec", tmp_path / "results", folder)
    with driven(tmp_path, bench, control={"file": str(folder / "lqg.yaml")}, sim={"commands": []}) as rig:
        page = rig.page

        def acting() -> Any:
            return rig.status.get("controller", {})

        log_in(page)
        page.ask("void (location.hash = '#try')")
        page.wait_for("document.querySelectorAll('#candidate option').length === 1")
        assert page.text("#candidate").startswith("arx.yaml")
        filled(rig, duration=2, blocks=6, hold_s=0.5)
        recording = played(rig)
        assert recording.startswith("prbs-") and not list(folder.glob("signal-*"))
        ticks = read_run(tmp_path / "rec" / recording).ticks
        assert 2.0 < ticks[-1].t - ticks[0].t < 3.5
        assert "told apart" in compared(rig)
        assert wait_until(lambda: acting().get("file") == "lqg.yaml" and acting().get("purpose") == "controller")
        page.ask("void document.querySelector('#compare-accept').click()")
        page.wait_for("document.querySelector('#compare-decided').innerText.includes('not better')", BUSY_S)
        assert acting().get("accepted") == "lqg.yaml"
        page.ask("void document.querySelector('#compare-accept').click()")  # a double click reads nothing
        time.sleep(1.0)
        assert acting().get("accepted") == "lqg.yaml"
        page.ask("void document.querySelector('#compare-accept').click()")
        page.wait_for("document.querySelector('#compare-decided').innerText.includes('accepted by operator')", BUSY_S)
        assert wait_until(lambda: acting().get("accepted") == "arx.yaml")
        page.ask("void document.querySelector('#compare-back').click()")
        page.wait_for("document.querySelector('#compare-decided').innerText.includes('rolled back')", BUSY_S)
        assert wait_until(lambda: acting().get("accepted") == "lqg.yaml")
        page.size(390, 844)
        assert page.ask("document.documentElement.scrollWidth - innerWidth") <= 0
        assert page.errors == []
    sent = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
    told = {one["command"] for one in sent}
    assert told >= {"experiment prbs", "experiment over", "compare", "trial", "revert", "comparison"}
    assert told >= {"candidate accepted", "rolled back"} and not told & {"alive"}
    (kept, *_) = sorted((tmp_path / "results" / "comparisons").glob("*.json"), reverse=True)
    assert json.loads(kept.read_text())["decided"] == "rolled back by operator"
