"""The bench in a browser: find a recording, look at it, compare two, start a job, see what it found, write a note."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from dashboard.bench_folder import HOSTILE, lay_out
from dashboard.driven import log_in
from dashboard.served import served
from harness.browser import CHROMIUM, Page, opened
from shell.peers import Ticks, controlled, running

from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.dashboard.work.bench import Bench

JOB_S = 100.0  # a job of the idle class, on a machine that has other work
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
ROWS = "document.querySelectorAll('#recordings tbody tr').length"
THUMBNAILS = "document.querySelectorAll('#recordings svg path').length"
FRAME = "document.querySelector('#viewer-frame')"


def choose(page: Page, name: str) -> None:
    page.click(f"[aria-label='choose {name}']")


def change(page: Page, selector: str, value: str, event: str = "change") -> None:
    page.ask(
        f"(e => {{ e.value = {json.dumps(value)}; e.dispatchEvent(new Event('{event}')); }})"
        f"(document.querySelector({json.dumps(selector)}))"
    )


@contextlib.contextmanager
def at_work(tmp_path: Path) -> Iterator[tuple[Page, Bench]]:
    """The bench, and its page with the recordings shown that are in tmp_path/recordings."""
    folder, settings = lay_out(tmp_path / "recordings"), controlled(tmp_path)
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    bench = Bench(folder, tmp_path / "results")
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate),
        served(Feed([settings.endpoint], {}), operators, bench=bench) as web,
        opened(tmp_path, f"{web.origin}/#work", 1440, 1000) as page,
    ):
        page.wait_for(f"{ROWS} === 4 && {THUMBNAILS} === 6")
        yield page, bench


@pytest.mark.proof
@pytest.mark.realtime  # a job runs in the idle class: beside other tests it gets no processor
def test_from_a_recording_to_a_model_without_a_shell(tmp_path: Path) -> None:
    with at_work(tmp_path) as (page, bench):
        assert HOSTILE in page.text("#recordings") and page.ask("document.querySelector('#recordings img')") is None
        assert "broken.csv" in page.text("#recordings")
        page.type("#recording-tools input", "FIRST csv")
        page.wait_for(f"{ROWS} === 1")
        choose(page, "first.csv")
        change(page, "#recording-tools input", "", "input")
        page.wait_for(f"{ROWS} === 4")
        choose(page, "second.csv")
        page.wait_for("document.querySelector('#recording-tools button').innerText === 'Compare 2'")
        page.click("#recording-tools button")
        page.wait_for(
            f"!document.querySelector('#viewer').hidden && {FRAME}.src.includes('plot?name=first.csv&name=second.csv')"
        )
        assert page.ask("document.querySelector('#job-form button').disabled") is True  # nobody is logged in
        log_in(page)
        page.wait_for("document.querySelector('#job-form button').innerText === 'Start'")
        change(page, "#job-form select", "identify")
        page.type("#job-form [name=orders]", "1,1")
        change(page, "#job-form [name=holdout]", "second.csv")
        page.click("#job-form .primary")
        page.wait_for("document.querySelector('#jobs li').dataset.state === 'done'", JOB_S)
        assert "second.csv (held back)" in page.text("#jobs") and "by operator" in page.text("#jobs")
        page.click("#jobs .row button")
        page.wait_for(f"{FRAME}.src.includes('file?job=1')")
        assert bench.jobs.told()[0]["order"]["holdout"] == ["second.csv"]
        page.click("#recordings tbody tr:has([aria-label='choose first.csv']) td:last-child button:nth-of-type(2)")
        page.type(".remark input", "prbs, good")
        page.click(".remark .primary")
        page.wait_for("[...document.querySelectorAll('.tag')].map(one => one.innerText).join() === 'prbs,good'")
        page.size(390, 844)
        assert page.ask("document.documentElement.scrollWidth - innerWidth") <= 0
        assert page.ask("window.broken") is None and page.errors == []


def test_a_recording_that_comes_takes_neither_the_focus_nor_a_note_half_written(tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    focused = "document.activeElement.getAttribute('aria-label') || document.activeElement.innerText"
    row = "document.activeElement.closest('tr').dataset.row"
    with at_work(tmp_path) as (page, _):
        log_in(page)
        page.ask(
            "document.querySelector('#recordings [data-row=\"second.csv\"]').querySelectorAll('button')[1].click()"
        )
        page.type("textarea", "a strange st")
        shutil.copy(folder / "first.csv", folder / "a new one.csv")
        page.wait_for(f"{ROWS} === 6")  # one is the note's
        assert page.ask(focused) == "Note" and page.ask("document.activeElement.value") == "a strange st"
        page.ask("document.querySelector('#recordings [data-row=\"second.csv\"] button').focus()")
        shutil.copy(folder / "first.csv", folder / "another.csv")
        page.wait_for(f"{ROWS} === 7")
        assert page.ask(focused) == "Plot" and page.ask(row) == "second.csv"


def test_a_server_without_recordings_says_so(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    with (
        running(settings),
        served(Feed([settings.endpoint], {})) as web,
        opened(tmp_path, f"{web.origin}/#work") as page,
    ):
        page.wait_for("document.querySelector('#no-bench').innerText.includes('--recordings')")
        assert page.ask("[...document.querySelectorAll('[data-bench]')].every(one => one.hidden)")
