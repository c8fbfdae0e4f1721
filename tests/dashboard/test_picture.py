"""The live picture in a browser: asked for while its panel is open, moving, and gone with it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import cv2
import numpy as np
import pytest
import zenoh
from dashboard.served import served
from harness.browser import CHROMIUM, opened
from shell.peers import free_endpoint, running, tick, wait_until
from shell.test_live_picture import Camera

from hoopd.dashboard.feed import Feed
from hoopd.dashboard.pictures import message_of
from hoopd.shell.config import Vision
from hoopd.shell.live_picture import LivePicture
from hoopd.shell.telemetry import TelemetrySettings

PIXEL = "[...document.querySelector('#picture-canvas').getContext('2d').getImageData({}, {}, 1, 1).data]"


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed (Debian's package of that name)")
def test_the_picture_moves_while_its_panel_is_open_and_ends_with_it(tmp_path: Path) -> None:
    endpoint, picture = free_endpoint(), LivePicture(Camera(), Vision())
    with (
        running(TelemetrySettings(endpoint=endpoint), picture=picture) as telemetry,
        served(Feed([endpoint], {})) as web,
        opened(tmp_path, web.origin) as page,
    ):
        telemetry.put(tick(1))
        page.wait_for("window.page && page.device")
        assert picture.encoded == 0
        page.click("#picture-open")
        page.wait_for("page.picture.shown >= 3")
        red, green, _, _ = page.ask(PIXEL.format(230, 430))  # inside the ball, beside its marks
        assert red > 150 > green
        assert "ball at 240.0, 422.0 px" in page.text("#picture-text")
        page.click("[data-picture=threshold]")
        page.wait_for(f"Math.min(...{PIXEL.format(230, 430)}) > 200 && {PIXEL.format(20, 20)}[0] < 40")
        page.click("#picture-open")
        assert wait_until(lambda: not any(one.matching_status.matching for one in picture._publishers.values()))
        assert page.errors == []


def told(jpeg: bytes, about: bytes) -> bytes:
    """What of a message of the daemon's reaches a decoder."""
    sample = SimpleNamespace(payload=zenoh.ZBytes(jpeg), attachment=zenoh.ZBytes(about))
    return message_of(cast(zenoh.Sample, sample))


def test_a_picture_that_would_be_large_once_decoded_reaches_no_decoder() -> None:
    small, large = (cv2.imencode(".jpg", np.zeros((side, side), np.uint8))[1].tobytes() for side in (480, 496))
    about = b'{"size_px":[480,480]}'
    assert told(small, about) == about + b"\n" + small
    assert told(large, about) == b""
    place = small.index(b"\xff\xc0") + 5
    assert told(small[:place] + b"\xff\xdc\xff\xdc" + small[place + 4 :], about) == b""  # 65500 px square, 13 GB
    for other in (b'{"size_px":[480,60000]}', b'{"size_px":[0,480]}', b'{"size_px":"480"}', b"{}", b"\xff"):
        assert told(small, other) == b""
