"""The page in a real browser, beside a real daemon and its rig.

Rules of this file: Debian's chromium, headless; one visit to a daemon on the clock, because each costs seconds.
"""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest
from dashboard.served import served
from harness.browser import CHROMIUM, opened
from harness.realrun import Daemon, fifo_granted
from shell.peers import client, free_endpoint, running

from hoopd.dashboard.feed import Feed
from hoopd.shell.telemetry import TelemetrySettings

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
SEEN = "document.querySelector('#mode').innerText"
# A busy machine is late, and its faults may disarm the rig meanwhile: which mode it is in is not the page's doing.
BUSY_S = 40.0
MODE = f"['DISARMED', 'READY', 'RUNNING', 'STOPPING', 'FAULT'].includes({SEEN})"
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
DRAWN = "[...document.querySelectorAll('.u-wrap canvas')].filter(one => one.getContext('2d').getImageData(0, 0, one.width, one.height).data.some(part => part)).length"  # noqa: E501


@pytest.mark.realtime
def test_a_daemon_is_shown_live_stopped_by_a_key_and_waited_for_when_it_is_gone(tmp_path: Path) -> None:
    with Daemon(tmp_path, fifo=fifo_granted()) as daemon, served(Feed([daemon.endpoint], {})) as web:
        daemon.wait_running()
        with opened(tmp_path, web.origin, 1440, 900) as page:
            page.wait_for(f"{MODE} && {DRAWN} === 4", BUSY_S)
            assert re.fullmatch(r"[+−]\d\.\d{3}", page.text(".ball .value")) and "± " in page.text(".ball .more")
            assert page.ask("document.querySelector('.band').getAttribute('d').length > 0")
            assert re.fullmatch(r"\d+\.\d Hz", page.text("#timing dd"))
            # the page's own server, and nobody else
            assert page.requested and all(address.startswith(web.origin) for address in page.requested)
            page.key(" ", "Space")
            page.wait_for("document.querySelector('#answer').dataset.state === 'good'", BUSY_S)
            stopped = time.monotonic()
            assert re.search("hoop disarm: (DISARMED|FAULT)", page.text("#answer"))
            page.wait_for(f"['DISARMED', 'FAULT'].includes({SEEN})", BUSY_S)
            page.size(390, 844)
            assert page.ask(OVERFLOW) <= 0
            daemon.process.kill()
            page.wait_for("document.querySelector('#notice').innerText.includes('no daemon answers')")
            page.wait_for(f"{SEEN}.endsWith(' ?')")
            again = Daemon(tmp_path / "again", config={"telemetry": {"endpoint": daemon.endpoint}})
            with again:
                page.wait_for(f"{MODE} && document.querySelector('#notice').hidden", BUSY_S)
            assert page.errors == []
        run = daemon.result()
    assert {row.torque_nm for row in run.torque.rows if row.t > stopped} <= {0.0}
    assert any(row.torque_nm for row in run.torque.rows if row.t < stopped)


HTML = '<img src=x onerror="window.broken = 1"><script>window.broken = 1</script>'


def test_what_a_device_tells_is_text_and_never_markup(tmp_path: Path) -> None:
    settings = TelemetrySettings(endpoint=free_endpoint())
    told = {"mode": HTML, "event": HTML, "level": HTML, "fields": {HTML: HTML}, "arming": HTML}
    told |= {"t": 1, "faults": [HTML], "causes": {HTML: {"meaning": HTML, "clears": HTML}}, "recorder": {HTML: HTML}}
    with (
        running(settings),
        client(settings.endpoint) as forger,
        served(Feed([settings.endpoint], {})) as web,
        opened(tmp_path, web.origin) as page,
    ):
        token = forger.liveliness().declare_token("hoopd/evil/alive")
        end = time.monotonic() + 10.0
        while "onerror" not in page.text("#events") and time.monotonic() < end:
            for kind in ("tick", "event", "status"):
                forger.put(f"hoopd/evil/{kind}", json.dumps(told))
            page.key("2")
            time.sleep(0.2)
        for place in ("#events", "#mode", "#faults", "#devices", "#camera"):
            assert "<img src=x" in page.text(place)
        token.undeclare()  # type: ignore[no-untyped-call]
        assert page.ask("document.querySelectorAll('img, main script').length") == 0
        assert page.ask("window.broken") is None and page.errors == []
