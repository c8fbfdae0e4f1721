"""A calibration proposed in the page: near the truth of the rig's scene, judged, and without any change."""

from __future__ import annotations

from math import nan
from pathlib import Path

import pytest
from dashboard.served import served
from harness.browser import CHROMIUM, opened
from shell.peers import free_endpoint, running, tick, wait_until
from shell.test_live_picture import Camera

from hoopd.core.records import CameraSample
from hoopd.dashboard.feed import Feed
from hoopd.shell import config as configuration
from hoopd.shell.config import Vision
from hoopd.shell.live_picture import LivePicture
from hoopd.shell.pictures import Analysed, Frame
from hoopd.shell.telemetry import TelemetrySettings
from hoopd.sim import parts
from hoopd.sim.camera import Painter

SIDE = 480
ZERO_RAD = 0.02


class Scene:
    """The rig's picture of a ball at rest."""

    def __init__(self) -> None:
        config = configuration.load(None, sim=True, overrides=[])
        told = parts.camera_config(config, 0, ring="", start=0.0)
        self._picture = Painter(told, parts.fault_script(config, 0)).paint(0, 0.0, (0.3, 0.0, ZERO_RAD, 0.0), 0.02)
        self._number = 0

    def __call__(self) -> Analysed:
        """A new picture, the same as the last."""
        self._number += 1
        frame = Frame(self._number, 0.02 * self._number, 0.0, self._picture, "bgr", (SIDE, SIDE, SIDE))
        return Analysed(frame, CameraSample(self._number, frame.t, 0.0, nan, 0.0, nan, nan, 0))


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_values_near_the_truth_are_shown_with_a_word_and_the_text(tmp_path: Path) -> None:
    endpoint, picture = free_endpoint(), LivePicture(Scene(), Vision())
    with (
        running(TelemetrySettings(endpoint=endpoint), picture=picture) as telemetry,
        served(Feed([endpoint], {})) as web,
        opened(tmp_path, web.origin) as page,
    ):
        telemetry.put(tick(1))
        page.wait_for("window.page && page.device")
        page.click("#picture-open")
        page.click("#calibrate")
        page.wait_for("!document.querySelector('#calibrate-proposal').hidden")
        rows = page.ask(
            "[...document.querySelectorAll('#calibrate-rows tr')].map(r => [...r.cells].map(c => c.innerText))"
        )
        values = {name: float(value.replace("\N{MINUS SIGN}", "-")) for name, value, *_ in rows}
        assert abs(values["circle, centre x, px"] - 240.0) < 1.0 and abs(values["circle, radius, px"] - 182.0) < 1.5
        assert abs(values["zero angle, rad"] - ZERO_RAD) < 0.005
        assert all(row[3].startswith("good") for row in rows)
        assert page.text("#calibrate-section").startswith("vision:")
        assert page.errors == []


def test_a_picture_without_a_hoop_gives_the_reason_and_a_stranger_gets_nothing() -> None:
    endpoint, picture = free_endpoint(), LivePicture(Camera(), Vision())
    with (
        running(TelemetrySettings(endpoint=endpoint), picture=picture) as telemetry,
        served(Feed([endpoint], {})) as web,
    ):
        telemetry.put(tick(1))
        assert wait_until(lambda: bool(web.feed.devices))
        answer = web.post(f"/api/calibration?device=hoop@{endpoint}")
        assert answer.json["ok"] is False and "hoop" in answer.json["reason"]
        assert web.post("/api/calibration?device=other").status == 404
        assert web.ask(f"/api/calibration?device=hoop@{endpoint}", "POST", {}).status == 403
