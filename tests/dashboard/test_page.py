"""The page in a real browser, beside a real daemon and its rig.

Rules of this file: Debian's chromium, headless; one visit to a daemon on the clock, because each costs seconds.
"""

from __future__ import annotations

import itertools
import json
import re
import threading
import time
from pathlib import Path

import pytest
from dashboard.served import served
from harness.browser import CHROMIUM, opened
from harness.realrun import Daemon, fifo_granted
from shell.peers import Ticks, client, controlled, free_endpoint, running, tick, wait_until

from hoopd.core.records import Command
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.operators import Operators
from hoopd.shell.telemetry import Telemetry, TelemetrySettings

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
SEEN = "document.querySelector('#mode').innerText"
# A busy machine is late, and its faults may disarm the rig meanwhile: which mode it is in is not the page's doing.
BUSY_S = 40.0
MODE = f"['DISARMED', 'READY', 'RUNNING', 'STOPPING', 'FAULT'].includes({SEEN})"
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
DRAWN = "[...document.querySelectorAll('.u-wrap canvas')].filter(one => one.getContext('2d').getImageData(0, 0, one.width, one.height).data.some(part => part)).length"  # noqa: E501


class Ticking:
    """A telemetry that tells ticks, some fifty a second, until the block ends."""

    def __init__(self, telemetry: Telemetry) -> None:
        self._telemetry, self._over = telemetry, threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        for k in itertools.count():
            if self._over.wait(0.02):
                return
            self._telemetry.put(tick(k))


@pytest.mark.realtime
def test_a_daemon_is_shown_live_stopped_by_a_key_and_waited_for_when_it_is_gone(tmp_path: Path) -> None:
    with Daemon(tmp_path, fifo=fifo_granted()) as daemon, served(Feed([daemon.endpoint], {})) as web:
        daemon.wait_running()
        with opened(tmp_path, web.origin, 1440, 900) as page:
            page.wait_for(f"{MODE} && {DRAWN} === 4", BUSY_S)
            page.wait_for(r"/^[+−]\d\.\d{3}$/.test(document.querySelector('.ball .value').innerText)")
            page.wait_for("document.querySelector('.ball .more').innerText.includes('± ')")
            page.wait_for("document.querySelector('.band').getAttribute('d').length > 0")
            page.wait_for(r"/^\d+\.\d Hz$/.test(document.querySelector('#timing dd').innerText)")
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


HANDLE = "(() => { const b = document.querySelector('.handle circle').getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"  # noqa: E501
OF_THE_PAGE = "document.body.classList.contains('may-drive')"


def test_who_logs_in_drives_and_who_does_not_may_only_look(tmp_path: Path) -> None:
    settings = controlled(tmp_path)
    operators = Operators({settings.endpoint: (settings.control_endpoint, settings.control_zenoh)})
    with (
        running(settings) as telemetry,
        Ticks(telemetry.gate) as ticks,
        Ticking(telemetry),
        served(Feed([settings.endpoint], {}), operators) as web,
        opened(tmp_path, web.origin) as page,
    ):
        page.wait_for(
            "!document.querySelector('#login').hidden && document.querySelector('.handle').hasAttribute('transform')"
        )
        assert page.ask("[...document.querySelectorAll('#drive button')].every(one => one.disabled)")
        page.click("#login")
        page.type("input[name=user]", "operator")
        page.type("input[name=password]", "wrong turn")  # a space is no STOP here
        page.key("Enter")
        page.wait_for("document.querySelector('#credentials-wrong').innerText.includes('no daemon lets this user in')")
        page.type("input[name=password]", "turn")
        page.key("Enter")
        page.wait_for(OF_THE_PAGE)
        assert ticks.take() == ()
        page.click("#arm")
        page.wait_for("document.querySelector('#answer').innerText.includes('arm: READY')")
        x, y = page.ask(HANDLE)
        page.drag([(x, y), (x - 10, y), (x - 30, y)])  # to the left: positive
        page.wait_for("document.querySelector('#answer').innerText.includes('reference: RUNNING')")
        page.key("ArrowRight")  # the target keeps the focus
        page.key("ArrowRight")
        assert wait_until(lambda: len(ticks.taken) == 3)
        arm, dragged, stepped = ticks.take()
        assert arm == Command("arm") and dragged.name == stepped.name == "reference"
        assert 0.1 < dragged.value <= 0.5 and stepped.value == pytest.approx(-0.02)  # from what the device tells
        page.click("#brake")
        page.wait_for("document.querySelector('#answer').innerText.includes('stop: STOPPING')")
        operators.close()  # as if it had lasted for too long
        page.click("#arm")
        page.wait_for(f"!{OF_THE_PAGE}")
        page.key(" ", "Space")
        page.wait_for("document.querySelector('#answer').innerText.includes('disarm: DISARMED')")
        assert ticks.take() == (Command("stop"), Command("disarm"))


HTML = '<img src=x onerror="window.broken = 1"><script>window.broken = 1</script>'


def test_what_a_device_tells_is_text_and_never_markup(tmp_path: Path) -> None:
    settings = TelemetrySettings(endpoint=free_endpoint())
    told = {"mode": HTML, "event": HTML, "level": HTML, "fields": {HTML: HTML}, "arming": HTML}
    told |= {"t": 1, "faults": [HTML], "causes": {HTML: {"meaning": HTML, "clears": HTML}}, "recorder": {HTML: HTML}}
    told["controller"] = {"file": HTML, "sha256": HTML, "purpose": "trial", "accepted": HTML, "next": HTML}
    told["tunables"] = {HTML: {"value": 1.0, "low": 0.0, "high": 2.0}, "bad": None, "worse": {"value": HTML}}
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
        for place in ("#events", "#mode", "#faults", "#devices", "#camera", "#gains"):
            page.wait_for(f"document.querySelector('{place}').innerText.includes('<img src=x')")
        token.undeclare()  # type: ignore[no-untyped-call]
        assert page.ask("document.querySelectorAll('img, main script').length") == 0
        assert page.ask("window.broken") is None and page.errors == []
