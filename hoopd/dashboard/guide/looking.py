"""Pictures for a calibration: the next one of a device, or where the ball was in those of two seconds.

Rules of this file: it subscribes while it looks and no longer; what comes is of a stranger and is checked.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import cv2
import msgspec
import numpy as np
import zenoh

from hoopd.dashboard.calibration import NO_PICTURE, PATIENCE_S, POLL_S, About
from hoopd.dashboard.feed import Connection
from hoopd.dashboard.guide.picture_steps import LookedPicture
from hoopd.dashboard.pictures import message_of
from hoopd.files.reading import InputError
from hoopd.shell.session import device_key

REST_S = 2.0
WRONG = "what came is no picture of ours"


class Position(msgspec.Struct):
    """Where the detector found the ball."""

    ball_px: tuple[float, float] | None = None


def next_scene(connection: Connection, device: str) -> LookedPicture:
    """The next picture; InputError when none comes."""
    for head, jpeg in _messages(connection, device, PATIENCE_S):
        try:
            about = msgspec.json.decode(head, type=About)
            image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        except (msgspec.MsgspecError, UnicodeDecodeError, cv2.error):
            raise InputError("picture", "", WRONG) from None
        if image is None:
            raise InputError("picture", "", WRONG)
        return LookedPicture(np.asarray(image, np.uint8), about, about.size_px[0] / image.shape[1])
    raise InputError("picture", "", NO_PICTURE)


def positions(connection: Connection, device: str) -> list[tuple[float, float]]:
    """Where the ball was found, over two seconds; InputError when no picture comes."""
    found, seen = [], 0
    for head, _ in _messages(connection, device, REST_S):
        seen += 1
        try:
            place = msgspec.json.decode(head, type=Position).ball_px
        except (msgspec.MsgspecError, UnicodeDecodeError):
            raise InputError("picture", "", WRONG) from None
        if place is not None and np.isfinite(place).all():
            found.append(place)
    if not seen:
        raise InputError("picture", "", NO_PICTURE)
    return found


def _messages(connection: Connection, device: str, seconds: float) -> Iterator[tuple[bytes, bytes]]:
    session, until = connection.session, time.monotonic() + seconds
    if session is None:
        return
    ring: Any = zenoh.handlers.RingChannel(1)
    try:
        with session.declare_subscriber(device_key(device, "picture", "camera"), ring) as subscriber:
            while time.monotonic() < until:
                if message := message_of(subscriber.try_recv()):
                    head, _, jpeg = message.partition(b"\n")
                    yield head, jpeg
                else:
                    time.sleep(POLL_S)
    except zenoh.ZError:
        raise InputError("picture", "", "the connection went meanwhile") from None
