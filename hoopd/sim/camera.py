"""The rig's camera as a program of its own that behaves like `rpicam-vid`: `python -m hoopd.sim.camera ...`.

Rules of this file: raw I420 pictures on standard output, metadata as JSON at the path of --metadata, on absolute
deadlines; a picture shows the plant at the middle of its exposure and comes out `delay_s` later; the program ends
with its parent, on SIGTERM and when nobody reads. Flags without meaning here are taken and ignored.
"""

from __future__ import annotations

import argparse
import ctypes
import signal
import sys
import time
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import msgspec
import numpy as np

from hoopd import uncaught_errors
from hoopd.shell.service import raise_thread_priority
from hoopd.sim import lies
from hoopd.sim.faults import FaultScript, fault_from_table
from hoopd.sim.scene import Image, Scene, SceneSettings
from hoopd.sim.statering import StateRingReader

_PR_SET_PDEATHSIG = 1
# Rendering takes 2 to 3 ms here and 6 ms on a small computer; it begins this long before a picture is due.
RENDER_S = 0.008
# A false red object lies off the track of the ball, at this place (share of the picture) and with the ball's radius.
FALSE_AT = (0.5, 0.42)


class CameraConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the rig tells its camera beside the flags of rpicam-vid: JSON with these keys."""

    ring: str  # path of the board's state ring
    start: float  # monotonic time of run time zero
    phase_s: float  # middle of the exposure after the tick's deadline
    delay_s: float
    scene: dict[str, Any] = {}  # fields of SceneSettings
    angle_offset_rad: float = 0.0
    disturbance_at_s: float = 0.0
    disturbance_rad: float = 0.0
    faults: list[dict[str, Any]] = []
    seed: int = 0


@dataclass(frozen=True)
class Format:
    """What the flags of rpicam-vid say about a picture."""

    width: int
    height: int
    fps: float
    exposure_s: float
    stride: int


class Painter:
    """The picture of one instant, faults included; serves the process and lock-step alike."""

    def __init__(self, config: CameraConfig, script: FaultScript) -> None:
        self.settings = SceneSettings(**config.scene)
        self._config, self._script, self._scene = config, script, Scene(self.settings)
        self._frozen: Image | None = None

    def paint(
        self, frame: int, t: float, state: tuple[float, float, float, float], frame_s: float, distance: float = 1.0
    ) -> Image:
        """BGR picture taken at run time `t`; `distance`: of the ball from the axis, in shares of its track's radius."""
        if self._script.active(t, "pictures_frozen") is None:
            self._frozen = None
            return self._paint(frame, t, state, frame_s, distance)
        if self._frozen is None:
            self._frozen = self._paint(frame, t, state, frame_s, distance)
        return self._frozen

    def _paint(self, frame: int, t: float, state: lies.State, frame_s: float, distance: float) -> Image:
        config = self._config
        if self._script.active(t, "black_pictures"):
            return np.zeros((self.settings.height, self.settings.width, 3), np.uint8)
        theta, dtheta, psi, dpsi = lies.seen_state(self._script, t, state)
        psi += config.angle_offset_rad
        if config.disturbance_at_s <= t < config.disturbance_at_s + frame_s:
            psi += config.disturbance_rad
        painted = lies.painted_psi(self._script, t)
        picture = self._scene.render(
            frame,
            (theta, dtheta, psi, dpsi),
            ball=painted is None and self._script.active(t, "ball_gone") is None,
            red_object=self._false_object(t),
            distance=distance,
        )
        if painted is not None:
            self._scene.paint_ball(picture, painted)
        return picture

    def _false_object(self, t: float) -> tuple[float, float, float] | None:
        if self._script.active(t, "false_red_object") is None:
            return None
        s = self.settings
        return FALSE_AT[0] * s.width, FALSE_AT[1] * s.height, s.ball_radius


def i420(picture: Image, stride: int) -> bytes:
    """Planes Y, U, V of a BGR picture with rows of `stride` bytes (U and V: half of it), as a camera delivers them.

    Chroma is the mean of 2 x 2 pixels; OpenCV's own conversion takes the upper left one, half a pixel off.
    """
    height, width = picture.shape[:2]
    mean = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    blocks = cv2.resize(mean, (width, height), interpolation=cv2.INTER_NEAREST)
    y = cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)[:height]
    chroma = cv2.cvtColor(blocks, cv2.COLOR_BGR2YUV_I420)[height:].reshape(2, height // 2, width // 2)
    if stride == width:
        return y.tobytes() + chroma.tobytes()
    wide = np.zeros((height, stride), np.uint8)
    wide[:, :width] = y
    narrow = np.zeros((2, height // 2, stride // 2), np.uint8)
    narrow[:, :, : width // 2] = chroma
    return wide.tobytes() + narrow.tobytes()


class Program:
    """Pictures at their times."""

    def __init__(self, config: CameraConfig, form: Format, pictures: BinaryIO, metadata: BinaryIO | None) -> None:
        self._config, self._form = config, form
        self._script = FaultScript([fault_from_table(row) for row in config.faults], config.seed)
        scene = {**config.scene, "width": form.width, "height": form.height, "exposure_s": form.exposure_s}
        self._painter = Painter(msgspec.structs.replace(config, scene=scene), self._script)
        self._ring = StateRingReader(Path(config.ring))
        self._pictures, self._metadata = pictures, metadata
        self._boot_offset_s = time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic()
        self._sent = 0

    def run(self) -> None:
        """Take pictures until nobody reads."""
        frame_s = 1.0 / self._form.fps
        frame = ceil((time.monotonic() - self._config.start) / frame_s)
        while True:
            self._take(frame, frame_s)
            behind = (time.monotonic() - self._config.start - self._config.delay_s) / frame_s
            frame = max(frame + 1, int(behind))  # a sensor does not wait for a slow reader

    def _take(self, frame: int, frame_s: float) -> None:
        t = frame * frame_s + self._config.phase_s
        late = self._script.active(t, "late_pictures")
        due = self._config.start + t + self._config.delay_s + (float(late["delay_s"]) if late else 0.0)
        _sleep_until(max(due - RENDER_S, self._config.start + t + 0.003))
        state = self._ring.at(self._config.start + t - lies.age_s(self._script, t))
        if state is None or self._script.active(t, "camera_stall"):
            return
        seen = (state.theta, state.dtheta, state.psi, state.dpsi)
        picture = self._painter.paint(frame, t, seen, frame_s, state.distance)
        data = i420(picture, self._form.stride)
        _sleep_until(due)
        self._send(t, data)

    def _send(self, t: float, data: bytes) -> None:
        self._pictures.write(data)
        self._pictures.flush()
        if self._metadata is not None:
            # As rpicam-vid does: after the pixels, and a record's brace comes only with the next record.
            # The stamp of a real sensor is the first row's readout: the end of its exposure, on the boot clock.
            readout = self._config.start + t + self._form.exposure_s / 2 + self._boot_offset_s
            row = {"SensorTimestamp": round(1e9 * readout), "ExposureTime": round(1e6 * self._form.exposure_s)}
            values = ",\n".join(f'    "{key}": {value}' for key, value in row.items())
            self._metadata.write(("},\n{\n" if self._sent else "[\n{\n").encode() + values.encode() + b"\n")
            self._metadata.flush()
        self._sent += 1


def _sleep_until(t: float) -> None:
    time.sleep(max(0.0, t - time.monotonic()))


def main(arguments: list[str] | None = None) -> int:
    """Command line; exit code 2 and one line for a wrong configuration."""
    parser = argparse.ArgumentParser(prog="hoopd.sim.camera", description=__doc__, allow_abbrev=False)
    parser.add_argument("--rig", type=Path, required=True, help="JSON file, keys of CameraConfig")
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--height", type=int, default=480)
    parser.add_argument("--framerate", type=float, default=50.0)
    parser.add_argument("--shutter", type=float, default=5000.0, help="us")
    parser.add_argument("--stride", type=int, default=0, help="bytes of a row; 0: the width")
    parser.add_argument("--metadata", type=Path)
    parser.add_argument("--fifo", type=int, default=0, metavar="N", help="ask for this real-time priority (0: none)")
    options, _ = parser.parse_known_args(arguments)
    form = Format(
        options.width, options.height, options.framerate, options.shutter * 1e-6, options.stride or options.width
    )
    _end_with_parent()
    cv2.setNumThreads(1)
    if options.fifo:
        raise_thread_priority(options.fifo)  # refused: the daemon was granted more than its rig
    try:
        config = msgspec.json.decode(options.rig.read_bytes(), type=CameraConfig)
        metadata = options.metadata.open("wb") if options.metadata else None
        Program(config, form, sys.stdout.buffer, metadata).run()
    except BrokenPipeError:
        return 0
    except (OSError, ValueError, TypeError, msgspec.MsgspecError) as error:
        sys.stderr.write(f"{options.rig}: {error}\n")
        return 2
    return 0


def _end_with_parent() -> None:
    """SIGTERM ends the program at once, and comes when the parent dies; the terminal is the daemon's business."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


if __name__ == "__main__":
    uncaught_errors.watch()
    sys.exit(main())
