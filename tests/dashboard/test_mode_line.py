"""The mode and the faults behind it: on every view, in every hint, and in the page's own words."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest
from dashboard.driven import log_in
from dashboard.served import served
from harness.browser import CHROMIUM, Page, opened
from shell.peers import client, controlled, running

from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.work.bench import Bench

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
LINE = "document.querySelector('#mode-line')"
BOTTOM = f"{LINE}.getBoundingClientRect().bottom"
TITLE_TOP = "document.querySelector('#viewer-title').getBoundingClientRect().top"
CAUSE = {"meaning": "no good answer of the board for 60 ms", "clears": "first its cause, then `hoopd clear`"}
DRIFT = {
    "meaning": "the device does not move: run `hoopd diagnose`",
    "clears": "it is over: `hoopd clear` or `hoopd arm`",
}
IN_FAULT = {"mode": "FAULT", "because": ["link_lost"], "faults": ["link_lost", "model_drift"], "arming": "link_lost"}
SAYS = "link_lost (no good answer of the board for 60 ms; clears: first its cause, then “Clear faults”)"


class Told:
    """A device that says what it is told to, until the page has shown it."""

    def __init__(self, page: Page, forger: Any) -> None:
        self._page, self._forger = page, forger

    def until(self, shown: str, **status: Any) -> None:
        self._until(shown, status["mode"], "status", status)

    def changed(self, shown: str, mode: str, was: str, because: list[str]) -> None:
        """As in the first second of a mode, of which no status tells yet."""
        fields = {"mode": mode, "was": was, "because": because}
        self._until(shown, mode, "event", {"t": 1.0, "event": "mode", "level": "info", "fields": fields})

    def _until(self, shown: str, mode: str, kind: str, content: Any) -> None:
        end = time.monotonic() + 20.0
        while not self._page.ask(shown):
            assert time.monotonic() < end, (shown, self._page.text("body"))
            self._forger.put(f"hoopd/hoop/{kind}", json.dumps(content))
            self._forger.put("hoopd/hoop/tick", json.dumps({"t": time.monotonic(), "mode": mode}))
            time.sleep(0.1)


def test_the_fault_and_what_clears_it_stand_on_every_view_and_in_the_hints(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    for name in ("recordings", "controllers"):
        (tmp_path / name).mkdir()
    bench = Bench(tmp_path / "recordings", tmp_path / "results", tmp_path / "controllers")
    with (
        running(settings),
        client(settings.endpoint) as forger,
        served(Feed([settings.endpoint], {}), operators, bench=bench) as web,
        opened(tmp_path, web.origin) as page,
    ):
        token, told = forger.liveliness().declare_token("hoopd/hoop/alive"), Told(page, forger)
        in_fault = {**IN_FAULT, "causes": {"link_lost": CAUSE, "model_drift": DRIFT}}
        told.until("window.page?.device && document.querySelector('#mode').innerText === 'FAULT'", **in_fault)
        told.until(
            f"document.querySelector('#mode-detail').innerText === {json.dumps(f'drive off: {SAYS}')}", **in_fault
        )
        assert page.ask(f"{LINE}.hidden") and "hoopd clear" not in page.text("main")
        told.until("document.querySelector('#faults').innerText.includes('run a job “diagnose” (Work)')", **in_fault)
        log_in(page)
        whole = f"FAULT\ndrive off: {SAYS}\nClear faults"
        for view in ("calibrate", "work", "try"):
            page.ask(f"void (location.hash = '#{view}')")
            told.until(f"!{LINE}.hidden && {LINE}.innerText === {json.dumps(whole)}", **in_fault)
        for place in ("#signal-hint", "#compare-hint"):
            hint = "Arm it first: the mode is FAULT (link_lost)."
            told.until(f"document.querySelector('{place}').innerText === '{hint}'", **in_fault)
        over = {"mode": "DISARMED", "because": ["camera_lost"], "faults": [], "causes": {}, "arming": "possible"}
        told.until(
            f"{LINE}.innerText.includes('DISARMED') && {LINE}.innerText.includes('camera_lost (is over)')", **over
        )
        words = f"{LINE}.querySelector('span').innerText"
        told.changed(f"{words} === 'drive on, the controller acts'", "RUNNING", "DISARMED", [])
        told.changed(f"{words} === 'drive off: link_lost'", "FAULT", "RUNNING", ["link_lost"])
        many = {f"fault_{number}": CAUSE for number in range(8)}
        full = {"mode": "FAULT", "because": [*many], "faults": [*many], "causes": many, "arming": "possible"}
        page.ask("void (location.hash = '#work')")
        for width, height in ((1280, 900), (844, 390), (390, 844)):
            page.size(width, height)
            told.until(f"{words}.includes('fault_7 (no good') && {BOTTOM} > 40", **full)
            assert page.ask("document.documentElement.scrollWidth - innerWidth") <= 0
            assert page.ask(BOTTOM) <= 0.3 * height + 1 and page.ask(f"{LINE}.scrollHeight - {LINE}.clientHeight") <= 0
            page.ask("void page.work.open('a report', 'about:blank')")
            shown = f"(document.querySelector('#viewer').scrollIntoView(), {TITLE_TOP} - {BOTTOM})"
            told.until(f"(gap => gap >= 0 && gap < 60)({shown})", **full)
        token.undeclare()  # type: ignore[no-untyped-call]
        assert page.errors == []
