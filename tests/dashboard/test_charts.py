"""The charts in a browser: ten minutes back, zoom, pause, marks, channels that are chosen and kept; another server.

Rules of this file: the device is made up, so that no daemon has to live for ten minutes.
"""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import pytest
from dashboard.served import served
from harness.browser import CHROMIUM, opened

from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Feed
from hoopd.dashboard.history import ROWS

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
ENDPOINT = "tcp/127.0.0.1:1"  # nobody listens there
PERIOD_S = 0.02


class MadeUp:
    """A feed that was never connected, and the devices of names."""

    def __init__(self, *names: str) -> None:
        self.feed = Feed([ENDPOINT], {})
        self.devices = [ShownDevice(name, ENDPOINT) for name in names]
        for device in self.devices:
            self.feed.connections[0].devices[device.name] = device
            device.presence(True)

    def fill(self, rows: int) -> None:
        """So many rows that end now."""
        now = time.time()
        for device in self.devices:
            for k in range(rows):
                t = k * PERIOD_S
                psi = math.sin(t) if k % 2 else None
                message = {
                    "t": t,
                    "mode": "RUNNING",
                    "u": math.cos(t),
                    "psi": psi,
                    "x_hat": [0.0, 0.0, math.sin(t), 0.0],
                }
                device.take("tick", json.dumps(message).encode(), "run", now - (rows - k) * PERIOD_S)


CHARTS = "window.page.charts"
BOX = "document.querySelector('.u-over').getBoundingClientRect()"


@pytest.mark.proof
def test_ten_minutes_are_there_and_can_be_searched(tmp_path: Path) -> None:
    made_up = MadeUp("hoop")
    made_up.fill(ROWS + 500)
    with served(made_up.feed) as web, opened(tmp_path, web.origin) as page:
        page.wait_for("window.page?.device?.ready")
        page.click("#tools .group button:last-child")  # 10 min
        # the made-up device is silent by now: the longer the browser took, the less of it is left
        page.wait_for(f"{CHARTS}.charts[0].data?.[0].length > 0.7 * {ROWS}")
        # every other tick without a picture is no gap, and no number
        drawn = f"{CHARTS}.charts[0].data[1].slice(100, -100)"
        assert page.ask(f"{drawn}.includes(undefined)") and not page.ask(f"{drawn}.includes(null)")
        page.ask("document.querySelector('.u-over').scrollIntoView({block: 'center'})")
        x, y, width, height = page.ask(f"[{BOX}.x, {BOX}.y, {BOX}.width, {BOX}.height]")
        page.drag([(x + width * part, y + height / 2) for part in (0.5, 0.55, 0.6)])
        page.wait_for(f"Math.abs({CHARTS}.span - 60) < 2 && {CHARTS}.end !== null")
        page.wait_for(f"Math.abs({CHARTS}.charts[0].plot.scales.x.max - {CHARTS}.end) < 0.1")
        assert page.ask("[...document.querySelectorAll('#tools button')].some(one => one.innerText === 'Go on')")
        for part in (0.25, 0.75):
            page.drag([(x + width * part, y + height / 2)])
        between = page.wait_for("document.querySelector('.marked').innerText.replace('B − A = ', '').replace(' s', '')")
        assert float(between) == pytest.approx(30.0, abs=2.0)
        end = page.ask(f"{CHARTS}.end")
        page.key("ArrowLeft")
        page.wait_for(f"Math.abs({end} - {CHARTS}.end - 15) < 1")
        page.key("l")
        page.wait_for(f"{CHARTS}.end === null")
        page.key("p")
        page.wait_for(f"{CHARTS}.end !== null")
        assert page.errors == []


def test_channels_are_chosen_and_kept_and_devices_changed_by_a_key(tmp_path: Path) -> None:
    made_up = MadeUp("left", "right")
    made_up.fill(100)
    with served(made_up.feed) as web, opened(tmp_path, web.origin) as page:
        page.wait_for("document.querySelectorAll('#devices button').length === 2")
        page.key("2")
        page.wait_for("document.title.startsWith('right')")
        page.wait_for(f"{CHARTS}.charts.length === 4")
        page.ask("[...document.querySelectorAll('#tools button')].find(one => one.innerText === 'Add chart').click()")
        page.wait_for("document.querySelector('.chart:last-child .menu label') !== null")
        for name in ("mode", "psi"):
            page.ask(
                "[...document.querySelectorAll('.chart:last-child .menu label')]"
                f".find(one => one.querySelector('code').innerText === '{name}').querySelector('input').click()"
            )
        page.open(f"{web.origin}/?again#right@{ENDPOINT}")
        page.wait_for(f"{CHARTS}?.charts.length === 5 && {CHARTS}.charts[4].data")
        assert page.ask(f"{CHARTS}.charts[4].names") == ["mode", "psi"]
        page.wait_for("document.querySelector('.chart:last-child .chips').innerText.includes('RUNNING')")
        page.wait_for("document.querySelector('#mode').innerText.startsWith('RUNNING')")
        assert page.ask("document.title").startswith("right")
        assert page.errors == []


def test_a_server_that_comes_back_is_taken_up_again(tmp_path: Path) -> None:
    made_up = MadeUp("hoop")
    made_up.fill(100)
    with served(made_up.feed) as web, opened(tmp_path, web.origin) as page:
        page.wait_for("document.querySelector('#mode').innerText.startsWith('RUNNING')")
        web.stop()
        page.wait_for("document.querySelector('#link').innerText === 'page offline'")
        page.key(" ", "Space")
        page.wait_for("document.querySelector('#answer').innerText.includes('no answer from this page')")
        other = MadeUp("hoop")
        other.fill(50)
        with served(other.feed, port=web.port):
            page.wait_for("document.querySelector('#link').innerText !== 'page offline'")
            page.wait_for("window.page.device.ready && window.page.device.length === 50")
