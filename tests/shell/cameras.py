"""A program in place of rpicam-vid, a capture device with scripted faults, and helpers of the cameras' tests."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from math import nan
from typing import Any

import cv2
import numpy as np

from hoopd.core.records import CameraSample
from hoopd.shell.config import Camera
from hoopd.shell.pictures import Backend, Frame
from hoopd.shell.videodevices import V4l2Backend

W, H = 64, 64

# Writes as rpicam-vid does: pixels, then the metadata whose closing brace stays in the stream's buffer.
FAKE = """
import argparse, os, sys, time
mode = sys.argv[1]
p = argparse.ArgumentParser()
for flag in "width height framerate shutter gain awbgains denoise codec metadata metadata-format t o".split():
    p.add_argument(("-" if len(flag) == 1 else "--") + flag)
p.add_argument("--flush", action="store_true"); p.add_argument("-n", action="store_true")
a = p.parse_args(sys.argv[2:])
assert (a.codec, a.o, a.t, a.n, a.flush, a.metadata_format) == ("yuv420", "-", "0", True, True, "json")
if mode == "error":
    sys.stderr.write("starting\\nERROR: *** no cameras available ***\\n"); sys.exit(1)
if mode == "deaf":
    import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)
stride = 512 if mode == "stride" else int(a.width)
if mode.endswith("pi"):
    stride = -(-int(a.width) // 64) * 64
size = stride * int(a.height) * 3 // 2
meta = open(a.metadata, "w"); meta.write("[\\n"); meta.flush()
count = {"torn": 2, "stall": 4, "deaf": 1}.get(mode, 40)
held = ""
for n in range(count):
    exposure = int(a.shutter)
    stamp = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - 30_000_000
    os.write(1, bytes([n]) * size)
    text = (",\\n" if n else "") + '{\\n    "SensorTimestamp": %d,\\n    "ExposureTime": %d,\\n    "Lux": 4.5\\n' % (
        stamp, exposure)
    if mode != "buffered":
        meta.write(held + text); meta.flush(); held = "}"
    if not (mode.startswith("eager") and n == 0):  # else the second picture waits already
        time.sleep(0.01)
if mode == "torn":
    os.write(1, b"x" * (size // 2)); sys.exit(3)
if mode in ("stall", "deaf"):
    time.sleep(60)
time.sleep(0.05)
"""


class RunTime:
    """Run time since now."""

    def __init__(self) -> None:
        self.t0 = time.monotonic()

    def __call__(self) -> float:
        return time.monotonic() - self.t0


def read(backend: Backend) -> Frame:
    frame = backend.read()
    assert frame is not None
    return frame


def plain(frame: Frame) -> CameraSample:
    return CameraSample(frame.number, frame.t, frame.t_arrival, nan, 0.0, nan, nan)


def until(condition: Callable[[], bool], timeout_s: float = 3.0) -> bool:
    deadline = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return condition()


class FakeCapture:
    """A V4L2 capture whose every read is scripted: (claimed, brightness, stamp in ms)."""

    def __init__(self, script: list[tuple[bool, int, float]], hang: threading.Event | None = None) -> None:
        self.script = script
        self.hang = hang
        self.stamp_ms = 0.0
        self.wanted: dict[int, float] = {}

    def __call__(self, device: str, api: int) -> FakeCapture:
        assert api == cv2.CAP_V4L2
        return self

    def isOpened(self) -> bool:
        return True

    def set(self, key: int, value: float) -> bool:
        self.wanted[key] = value
        return True

    def get(self, key: int) -> float:
        return self.stamp_ms if key == cv2.CAP_PROP_POS_MSEC else self.wanted[key]

    def read(self) -> tuple[bool, Any]:
        if not self.script:
            if self.hang is not None:
                self.hang.wait(5.0)
            return False, None
        claimed, level, self.stamp_ms = self.script.pop(0)
        return claimed, np.full((H, W, 3), level, np.uint8) if claimed else None

    def release(self) -> None:
        self.wanted = {}


def v4l2(capture: FakeCapture, clock: RunTime, device: str = os.devnull) -> V4l2Backend:
    return V4l2Backend(Camera(backend="v4l2", device=device, width_px=W, height_px=H), clock, clock.t0, capture)
