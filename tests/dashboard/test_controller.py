"""Gains of the acting controller, set in the page beside a daemon with its rig.

Rules of this file: Debian's chromium, headless; what holds is what the daemon
tells, not what the page shows.
"""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import Any

import pytest
from dashboard.driven import TRIES, driven, log_in
from harness.browser import CHROMIUM, Page
from shell.peers import wait_until

from hoopd.core.controllers import Lqg, LqgGains, TransferFunctionController
from hoopd.dashboard.feed import Feed

FIELD = "document.querySelector('[data-gain=k_psi]')"
LOCKED = "[...document.querySelectorAll('#controller button, #controller input')].every(one => one.disabled)"


def tunables(feed: Feed) -> Any:
    """What the daemon itself told last."""
    return next(iter(feed.devices.values())).status["tunables"]


def set_while_running(page: Page, wanted: str) -> None:
    """Set the gain in RUNNING: a busy machine's faults disarm the rig meanwhile, then it is armed and set anew."""
    for _ in range(TRIES):
        if page.text("#mode") != "RUNNING":
            page.click("#arm")
            time.sleep(1.0)
            continue
        page.ask(f"{FIELD}.select()")
        page.type("[data-gain=k_psi]", wanted)
        page.key("Enter")
        page.wait_for(f"document.querySelector('#answer').innerText.includes('tune k_psi {wanted}: ')")
        if page.text("#answer").find(": RUNNING") > 0:
            return
        page.wait_for("!document.querySelector('#undo').disabled")
        page.click("#undo")
        page.wait_for("document.querySelector('#undo').disabled")
    raise AssertionError("the rig does not run")


@pytest.mark.realtime
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_gains_are_set_and_taken_back_while_it_runs_and_only_after_a_login(tmp_path: Path) -> None:
    with driven(tmp_path) as rig:
        web, page = rig.web, rig.page
        page.wait_for(f"{FIELD}?.value && !document.querySelector('#login').hidden", 40)
        before = tunables(web.feed)["k_psi"]["value"]
        wanted = round(before * 1.1, 4)
        assert page.ask(LOCKED)
        log_in(page)
        page.wait_for(f"!{FIELD}.disabled")
        page.ask(f"{FIELD}.select()")
        page.type("[data-gain=k_psi]", "99")
        page.key("Enter")  # beyond the limit: not even sent
        set_while_running(page, str(wanted))
        assert wait_until(lambda: math.isclose(tunables(web.feed)["k_psi"]["value"], wanted))
        page.wait_for("!document.querySelector('#undo').disabled")
        page.click("#undo")
        assert wait_until(lambda: tunables(web.feed)["k_psi"]["value"] == before)
        page.wait_for("document.querySelector('#undo').disabled")
        sent = [json.loads(line) for line in (tmp_path / "audit.jsonl").read_text().splitlines()]
        told = [one for one in sent if one["command"] == "tune"]
        assert {(one["who"], one["key"], one["value"], one["ok"]) for one in told} == {
            ("operator", "k_psi", wanted, True),
            ("operator", "k_psi", before, True),
        }
        assert told[-2]["mode"] == "RUNNING"
        assert page.errors == []


LAWS = [
    Lqg(LqgGains(0.01, 0.5, 0.1)),
    TransferFunctionController([1.0], [1.0]),
]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_a_law_tells_each_number_that_it_lets_be_set(law: Any) -> None:
    for name, value in law.tunables.items():
        assert law.tune(name, value + 0.25) and law.tunables[name] == value + 0.25
