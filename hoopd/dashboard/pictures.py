"""The live picture on its way to a browser: a WebSocket that is open as long as somebody looks.

Rules of this file: nothing is subscribed to without a browser that takes it; of several pictures the newest alone is
sent, and a browser that is slow misses the others. What it sends is not read. A picture that would be larger than ours,
once decoded, goes to no decoder: neither a browser's nor the calibration's.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from typing import Annotated, Any

import msgspec
import zenoh
from msgspec import Meta
from starlette.websockets import WebSocket, WebSocketDisconnect

from hoopd.dashboard.device import ShownDevice
from hoopd.dashboard.feed import Connection, Feed
from hoopd.dashboard.live import BUSY, STALLED_S
from hoopd.shell.live_picture import LONGEST_PX
from hoopd.shell.session import device_key
from hoopd.vision.jpeg_size import jpeg_size

VIEWS = ("camera", "threshold")
LOOKERS = 8
POLL_S = 0.02
JPEG_BYTES = 1_000_000  # a picture of ours has some thirty thousand
ABOUT_BYTES = 4096
CameraSide = Annotated[int, Meta(ge=1, le=4096)]  # px; no camera of a configuration is larger
UNKNOWN = 1008  # RFC 6455, 7.4.1: policy violation


class CameraSize(msgspec.Struct):
    """What the attachment says of the camera's own picture, on which the page draws."""

    size_px: tuple[CameraSide, CameraSide]


class Pictures:
    """All browsers that look at a picture."""

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self.lookers = 0

    async def serve(self, socket: WebSocket) -> None:
        """One browser, until it goes: binary messages, each a line of JSON about the picture and then the JPEG."""
        device = self._feed.devices.get(socket.query_params.get("device", ""))
        view = socket.query_params.get("view", VIEWS[0])
        if device is None or view not in VIEWS:
            await socket.close(UNKNOWN, "no such device" if device is None else "no such view")
            return
        if self.lookers >= LOOKERS:
            await socket.close(BUSY, f"{LOOKERS} look already")
            return
        self.lookers += 1
        try:
            await socket.accept()
            with contextlib.suppress(WebSocketDisconnect, TimeoutError, RuntimeError, zenoh.ZError):
                await self._show(socket, device, view)
        finally:
            self.lookers -= 1

    async def _show(self, socket: WebSocket, device: ShownDevice, view: str) -> None:
        key, connection = device_key(device.name, "picture", view), self._feed.connection_of(device)
        gone = asyncio.ensure_future(_gone(socket))
        try:
            while not gone.done():
                session = connection.session
                if session is not None:
                    await _relay(socket, connection, session, key, gone)
                await asyncio.wait([gone], timeout=POLL_S * 10)
        finally:
            gone.cancel()
            with contextlib.suppress(RuntimeError, WebSocketDisconnect):
                await asyncio.wait_for(socket.close(), 1.0)


async def _relay(
    socket: WebSocket, connection: Connection, session: zenoh.Session, key: str, gone: asyncio.Future[None]
) -> None:
    """Pictures of one session, for as long as it and the browser last."""
    ring: Any = zenoh.handlers.RingChannel(1)
    subscriber: Any = await asyncio.to_thread(session.declare_subscriber, key, ring)
    try:
        while not gone.done() and connection.session is session:
            message = message_of(subscriber.try_recv())
            if message:
                began = time.monotonic()
                await asyncio.wait_for(socket.send_bytes(message), STALLED_S)
                await asyncio.wait([gone], timeout=max(0.0, POLL_S - (time.monotonic() - began)))
            else:
                await asyncio.wait([gone], timeout=POLL_S)
    finally:
        with contextlib.suppress(zenoh.ZError):
            await asyncio.to_thread(subscriber.undeclare)


def message_of(sample: zenoh.Sample | None) -> bytes:
    """What a browser gets of a sample; empty for none, and for one that is none of ours."""
    if sample is None or sample.attachment is None:
        return b""
    if len(sample.payload) > JPEG_BYTES or len(sample.attachment) > ABOUT_BYTES:
        return b""
    about, jpeg = sample.attachment.to_bytes(), sample.payload.to_bytes()
    return about + b"\n" + jpeg if b"\n" not in about and _fits(about, jpeg) else b""


def _fits(about: bytes, jpeg: bytes) -> bool:
    """Whether both pictures, the one that is decoded and the camera's that is drawn, are of a size that ours have."""
    size = jpeg_size(jpeg)
    if size is None or max(size) > LONGEST_PX:
        return False
    try:
        msgspec.json.decode(about, type=CameraSize)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return False
    return True


async def _gone(socket: WebSocket) -> None:
    """Until the browser hangs up."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await socket.receive_bytes()
