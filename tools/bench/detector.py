"""Times of the detector per 480 x 480 picture and its psi error on synthetic pictures and on the rig's.

Usage: python tools/bench/detector.py [--frames FOLDER] [--repeats N] [--json FILE]
Prints p50 and p99 in ms for tracking, for the full search, and for the full search of a picture without a ball.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness.picture import Image, Look, picture  # noqa: E402

from hoopd.shell.ball_detection import Analyser  # noqa: E402
from hoopd.shell.config import load  # noqa: E402
from hoopd.sim.camera import i420  # noqa: E402
from hoopd.sim.scene import Scene, SceneSettings  # noqa: E402
from hoopd.vision.calibration import PixelToAngle, propose, wrap  # noqa: E402
from hoopd.vision.detector import Detector, DetectorSettings  # noqa: E402

SWING_RAD, SWING_HZ = 1.2, 1.35  # a free swing of the ball: pictures 20 ms apart, up to 10 rad/s


def swing_pictures(count: int) -> tuple[list[Image], NDArray[np.float64]]:
    """Pictures of a free swing with motion blur, and the true psi."""
    t = 0.02 * np.arange(count)
    omega = 2.0 * math.pi * SWING_HZ
    psi, dpsi = SWING_RAD * np.sin(omega * t), SWING_RAD * omega * np.cos(omega * t)
    return [picture(psi=float(p), dpsi=float(d), seed=i) for i, (p, d) in enumerate(zip(psi, dpsi, strict=True))], psi


def percentiles_ms(calls: Sequence[Callable[[], object]], repeats: int, before: Callable[[], None]) -> dict[str, float]:
    """p50 and p99 of the time of one call, in ms."""
    times = []
    for _ in range(repeats):
        for call in calls:
            before()
            start = time.perf_counter_ns()
            call()
            times.append((time.perf_counter_ns() - start) * 1e-6)
    p50, p99 = np.percentile(times, [50, 99])
    return {"p50_ms": round(float(p50), 4), "p99_ms": round(float(p99), 4), "calls": len(times)}


def detect_converted(detector: Detector, i420: Any) -> object:
    """The plain way for a raw frame: the whole picture converted, then searched."""
    return detector.detect(np.asarray(cv2.cvtColor(i420, cv2.COLOR_YUV2BGR_I420), np.uint8))


def nothing() -> None:
    """Between calls of a tracking run nothing happens."""


def bench_pictures(name: str, settings: DetectorSettings, pictures: list[Image], repeats: int) -> dict[str, Any]:
    """Rows for one set of pictures; `tracked` is the share found without a search."""
    height, width = pictures[0].shape[:2]
    raw: list[Any] = [cv2.cvtColor(p, cv2.COLOR_BGR2YUV_I420).reshape(-1) for p in pictures]
    detector = Detector(settings)
    found = [detector.detect(p) for p in pictures * 2]
    tracked = float(np.mean([f is not None and f.tracking for f in found[1:]]))
    bgr = [partial(detector.detect, p) for p in pictures]
    i420 = [partial(detector.detect_i420, r, width, height, width) for r in raw]
    convert = [partial(detect_converted, detector, r.reshape(-1, width)) for r in raw]
    return {
        "pictures": name,
        "tracked": round(tracked, 3),
        "tracking, BGR": percentiles_ms(bgr, repeats, nothing),
        "tracking, I420": percentiles_ms(i420, repeats, nothing),
        "tracking, I420 to BGR and BGR": percentiles_ms(convert, repeats, nothing),
        "search, BGR": percentiles_ms(bgr, repeats, detector.reset),
        "search, I420": percentiles_ms(i420, repeats, detector.reset),
    }


def psi_error_rad(settings: DetectorSettings, pictures: list[Image], psi: NDArray[np.float64]) -> dict[str, float]:
    """RMS and greatest error of psi with the true circle."""
    detector, to_angle = Detector(settings), PixelToAngle(Look().centre)
    errors = []
    for image, truth in zip(pictures, psi, strict=True):
        found = detector.detect(image)
        errors.append(math.nan if found is None else wrap(to_angle(found.x_px, found.y_px) - float(truth)))
    return summary(errors)


def rig_errors_rad(turns: int = 3, count: int = 240) -> list[dict[str, Any]]:
    """psi error of the shipped analysis on the rig's pictures with default noise, over full turns at set speeds."""
    config = load(None, sim=True, overrides=[])
    scene, rows = Scene(SceneSettings()), []
    for speed in (0.0, 3.0, 6.0, 10.0, 20.0):
        for form in ("BGR", "I420, stride 512"):
            eye = Analyser(config.vision, config.faults.minimum_confidence)
            errors = []
            for frame in range(count):
                psi = math.tau * turns * frame / count
                image = scene.render(frame, (0.7 * psi, 0.0, psi, speed))
                if form == "BGR":
                    sample = eye.bgr(frame, 0.0, 0.0, image)
                else:
                    sample = eye.i420(frame, 0.0, 0.0, np.frombuffer(i420(image, 512), np.uint8), (480, 480, 512))
                errors.append(math.remainder(sample.psi - psi, math.tau))
            rows.append({"speed_rad_s": speed, "picture": form, **summary(errors)})
    return rows


def summary(errors: Sequence[float]) -> dict[str, float]:
    """RMS and greatest error, and how many balls were missed."""
    return {
        "rms_rad": float(np.sqrt(np.nanmean(np.square(errors)))),
        "max_rad": float(np.nanmax(np.abs(errors))),
        "missed": int(np.isnan(errors).sum()),
    }


def real_rows(folder: Path, repeats: int) -> list[dict[str, Any]]:
    """One set of rows per real picture, with the settings proposed from it."""
    rows = []
    for path in sorted(folder.glob("*.png")) if folder.is_dir() else []:
        image = np.asarray(cv2.imread(str(path)), np.uint8)
        rows.append(bench_pictures(path.name, propose(image).settings(), [image], repeats * 40))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("HOOPD_SHARED", ROOT.parent / "shared")) / "frames"
    parser.add_argument("--frames", type=Path, default=default)
    parser.add_argument("--repeats", type=int, default=25)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    cv2.setNumThreads(1)  # as the daemon does: the work is too small to share
    pictures, psi = swing_pictures(40)
    settings = propose(picture()).settings()
    exact = dataclasses.replace(settings, ring_centre_px=Look().centre, ring_radius_px=Look().track_radius)
    rows = [bench_pictures("synthetic swing", settings, pictures, options.repeats)]
    rows.append(bench_pictures("synthetic, no ball", settings, [picture(Look(ball=False))], options.repeats * 40))
    rows += real_rows(options.frames, options.repeats)
    error = psi_error_rad(exact, pictures, psi)
    for row in rows:
        print(f"{row['pictures']} (found by tracking: {row['tracked']:.0%})")
        for key, value in row.items():
            if isinstance(value, dict):
                print(
                    f"  {key:32s} p50 {value['p50_ms']:.3f} ms   p99 {value['p99_ms']:.3f} ms   {value['calls']} calls"
                )
    print(f"psi error, synthetic swing to 10 rad/s: rms {error['rms_rad']:.2e} rad, max {error['max_rad']:.2e} rad")
    rig = rig_errors_rad()
    for r in rig:
        print(
            f"psi error, rig's pictures over full turns, ball at {r['speed_rad_s']:4.1f} rad/s, {r['picture']:16s}: "
            f"rms {r['rms_rad']:.2e} rad, max {r['max_rad']:.2e} rad, {r['missed']} missed"
        )
    if options.json is not None:
        options.json.write_text(
            json.dumps({"times": rows, "psi_error": error, "psi_error_rig": rig}, indent=2) + "\n", encoding="utf-8"
        )


if __name__ == "__main__":
    main()
