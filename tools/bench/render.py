"""Times of the rig's camera per 480 x 480 picture: render, planes, and both.

Usage: python tools/bench/render.py [--repeats N] [--json FILE]
Prints p50 and p99 in ms, for a ball at rest and for a fast one (more steps of motion blur), on one core: by the clock
on the wall, and the processor's own time, which other programs disturb less.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from hoopd.sim.camera import i420  # noqa: E402
from hoopd.sim.scene import Scene, SceneSettings  # noqa: E402

SPEEDS_RAD_S = (0.0, 5.0, 20.0)
STRIDE = 480
WARM_UP = 20
LIMIT_MS = 3.0  # aim for the median of one rendered picture


def times_ms(repeats: int, dpsi: float) -> dict[str, list[float]]:
    """Times of rendering and of the conversion to planes."""
    scene = Scene(SceneSettings())
    took: dict[str, list[float]] = {"render": [], "render, cpu": [], "planes": [], "planes, cpu": []}
    for k in range(WARM_UP + repeats):
        marks = [(time.perf_counter(), time.thread_time())]
        picture = scene.render(k, (0.013 * k, 1.0, 0.02 * dpsi * k, dpsi))
        marks.append((time.perf_counter(), time.thread_time()))
        i420(picture, STRIDE)
        marks.append((time.perf_counter(), time.thread_time()))
        if k < WARM_UP:
            continue
        for part, (began, ended) in zip(("render", "planes"), pairwise(marks), strict=True):
            took[part].append(1e3 * (ended[0] - began[0]))
            took[f"{part}, cpu"].append(1e3 * (ended[1] - began[1]))
    return took


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=400)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    rows = []
    for dpsi in SPEEDS_RAD_S:
        for part, values in times_ms(options.repeats, dpsi).items():
            p50, p99 = (float(q) for q in np.percentile(values, [50, 99]))
            rows.append({"speed_rad_s": dpsi, "part": part, "p50_ms": p50, "p99_ms": p99})
            print(f"ball at {dpsi:4.1f} rad/s  {part:11s} p50 {p50:6.2f} ms  p99 {p99:6.2f} ms")
    slowest = max(row["p50_ms"] for row in rows if row["part"] == "render")
    print(f"slowest median of render: {slowest:.2f} ms (aim: below {LIMIT_MS:g} ms)")
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
