"""A calibration proposed from the live picture, beside the one in force, each value with a word whether it is good.

Rules of this file: it looks and writes nothing, neither a file nor to a device; `hoopd.vision` computes; one proposal
at a time, in a thread, so that a STOP never waits for it.
"""

from __future__ import annotations

import asyncio
import time
from typing import Any

import cv2
import msgspec
import numpy as np
import zenoh
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from hoopd.dashboard.feed import Connection, Feed
from hoopd.dashboard.pictures import message_of
from hoopd.files.yaml_text import text_of
from hoopd.shell.session import device_key
from hoopd.vision.calibration import NO_PERSPECTIVE, TILT_NOTE_RAD, CalibrationError, Proposal, propose

PATIENCE_S = 3.0
POLL_S = 0.02
LEAST_COVERAGE = 0.8  # of the hoop's edge: a centre from less leans to the side that was seen
LEAST_GAP = 20.0  # grey levels between ball and ring, as `hoopd calibrate` judges it
NO_PICTURE = "no picture comes: the rig without pictures, an older daemon, or a camera that stands still"


class About(msgspec.Struct):
    """What the picture's attachment says of the calibration in force."""

    size_px: tuple[int, int]
    circle_px: tuple[float, float, float]
    zero_angle_rad: float
    ball_radius_px: float
    threshold: float


class Calibration:
    """The route of a proposal."""

    def __init__(self, feed: Feed) -> None:
        self._feed, self._busy = feed, asyncio.Lock()

    @property
    def routes(self) -> list[Route]:
        """All of them."""
        return [Route("/api/calibration", self.proposed, methods=["POST"])]

    async def proposed(self, request: Request) -> Response:
        """A proposal from the next picture of the device that the address names."""
        device = self._feed.devices.get(request.query_params.get("device", ""))
        if device is None:
            return JSONResponse({"ok": False, "reason": "no such device"}, 404)
        if self._busy.locked():
            return JSONResponse({"ok": False, "reason": "another proposal is being made"}, 429)
        connection, key = self._feed.connection_of(device), device_key(device.name, "picture", "camera")
        async with self._busy:
            return JSONResponse(await asyncio.to_thread(_answer, connection, key))


def _answer(connection: Connection, key: str) -> dict[str, Any]:
    try:
        head, _, jpeg = _next_picture(connection, key).partition(b"\n")
        if not jpeg:
            return {"ok": False, "reason": NO_PICTURE}
        about = msgspec.json.decode(head, type=About)
        picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        if picture is None:
            return {"ok": False, "reason": "what came is no picture of ours"}
        found = propose(np.asarray(picture, np.uint8))
    except CalibrationError as error:
        return {"ok": False, "reason": str(error)}
    except (msgspec.MsgspecError, UnicodeDecodeError, cv2.error):
        return {"ok": False, "reason": "what came is no picture of ours"}
    except zenoh.ZError:
        return {"ok": False, "reason": "the connection went meanwhile"}
    return told(found, about, about.size_px[0] / picture.shape[1])


def _next_picture(connection: Connection, key: str) -> bytes:
    """The next picture with what belongs to it; empty when none comes in time."""
    session, until = connection.session, time.monotonic() + PATIENCE_S
    if session is None:
        return b""
    ring: Any = zenoh.handlers.RingChannel(1)
    with session.declare_subscriber(key, ring) as subscriber:
        while time.monotonic() < until:
            if message := message_of(subscriber.try_recv()):
                return message
            time.sleep(POLL_S)
    return b""


def told(found: Proposal, about: About, scale: float) -> dict[str, Any]:
    """A proposal as the page shows it; `scale`: pixels of the camera in one of the picture that was sent."""
    circle, colour = found.track, found.colour
    x, y = ((value + 0.5) * scale - 0.5 for value in circle[:2])
    radius, ball = circle.radius_px * scale, found.ball.radius_px * scale
    seen = found.hoop_coverage >= LEAST_COVERAGE, f"{found.hoop_coverage:.0%} of the hoop's edge seen"
    apart = colour.gap >= LEAST_GAP, f"ball and ring {colour.gap:.0f} grey levels apart with the weights below"
    still = abs(found.zero_angle_rad) <= TILT_NOTE_RAD, "holds when the ball is at rest and the hoop stands still"
    sure = found.confidence >= 0.5, f"confidence {found.confidence:.2f}"
    rows = [
        _row("circle, centre x", "px", x, about.circle_px[0], seen),
        _row("circle, centre y", "px", y, about.circle_px[1], seen),
        _row("circle, radius", "px", radius, about.circle_px[2], sure),
        _row("zero angle", "rad", found.zero_angle_rad, about.zero_angle_rad, still),
        _row("ball's radius", "px", ball, about.ball_radius_px, sure),
        _row("threshold", "grey", colour.threshold, about.threshold, apart),
    ]
    blue, green, red = colour.weights
    section = {
        "weights": [red, green, blue],
        "threshold": round(colour.threshold, 1),
        "circle_px": {"centre": [round(x, 2), round(y, 2)], "radius": round(radius, 2)},
        "zero_angle_rad": round(found.zero_angle_rad, 5),
        "ball_radius_px": round(ball, 2),
        "band_px": round(found.settings().ring_half_width_px * scale, 1),
    }
    text = text_of({"vision": section}, default_flow_style=None)
    return {"ok": True, "rows": rows, "notes": [n for n in found.notes if n != NO_PERSPECTIVE], "text": text}


def _row(name: str, unit: str, proposed: float, now: float, judged: tuple[bool, str]) -> dict[str, Any]:
    return {"name": name, "unit": unit, "proposed": proposed, "now": now, "good": judged[0], "why": judged[1]}
