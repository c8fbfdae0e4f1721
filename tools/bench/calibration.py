"""How often `propose` finds the ball on randomly changed pictures, and how often it claims one where there is none.

Usage: python tools/bench/calibration.py [--frames FOLDER] [--count N] [--seed N] [--json FILE]
Each real picture (a drawn one where they are absent) is mirrored, shifted, turned, darkened, tinted, blurred and made
noisy, all at once; then the same with the ball painted out. A hit lies within 3 px of the centre measured by hand.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness.picture import Image, Look, ball_centre, picture  # noqa: E402

from hoopd.vision.calibration import CalibrationError, propose  # noqa: E402

# measured by hand, +-1.5 px
REAL = {"exp01_meas_pos01": (236.0, 426.0), "exp03_meas_pos01": (235.0, 409.7), "led": (238.5, 423.3)}
HIT_PX = 3.0
BORDERS = (cv2.BORDER_REFLECT_101, cv2.BORDER_REPLICATE, cv2.BORDER_CONSTANT)


def load(folder: Path) -> dict[str, tuple[Image, tuple[float, float]]]:
    """Pictures with the ball's centre."""
    found = {name: (folder / f"{name}.png", centre) for name, centre in REAL.items()}
    real = {n: (np.asarray(cv2.imread(str(p)), np.uint8), c) for n, (p, c) in found.items() if p.exists()}
    return real or {"drawn": (picture(), ball_centre(Look(), 0.0))}


def without_ball(image: Image, centre: tuple[float, float]) -> Image:
    """The picture with the ball painted out."""
    spot = (round(centre[0]), round(centre[1]))
    mask = cv2.circle(np.zeros(image.shape[:2], np.uint8), spot, 34, 255, -1)
    return np.asarray(cv2.inpaint(image, mask, 5, cv2.INPAINT_TELEA), np.uint8)


def changed(
    image: Image, centre: tuple[float, float], rng: np.random.Generator
) -> tuple[Image, tuple[float, float], str]:
    """One random change of place, light, colour and sharpness, the new centre and a description."""
    flip = int(rng.integers(-2, 2))
    out, (x, y) = image, centre
    if flip > -2:
        out = np.asarray(cv2.flip(out, flip), np.uint8)
        x, y = (479.0 - x if flip != 0 else x), (479.0 - y if flip < 1 else y)
    angle, dx, dy = float(rng.uniform(-10, 10)), float(rng.uniform(-30, 30)), float(rng.uniform(-25, 25))
    matrix = cv2.getRotationMatrix2D((239.5, 239.5), angle, 1.0) + np.array([[0, 0, dx], [0, 0, dy]])
    out = np.asarray(cv2.warpAffine(out, matrix, (480, 480), borderMode=BORDERS[rng.integers(3)]), np.uint8)
    x, y = (float(v) for v in matrix @ np.array([x, y, 1.0]))
    light, sigma, blur = float(rng.uniform(0.4, 1.3)), float(rng.uniform(0, 6)), float(rng.uniform(0.3, 1.8))
    tint = rng.uniform(0.85, 1.15, 3)
    level = cv2.GaussianBlur(out.astype(np.float32), (0, 0), blur) * (light * tint) + rng.normal(0, sigma, out.shape)
    text = f"flip {flip} turn {angle:.0f} shift {dx:.0f},{dy:.0f} light {light:.2f} noise {sigma:.1f} blur {blur:.1f}"
    return np.clip(np.rint(level), 0, 255).astype(np.uint8), (x, y), f"{text} tint {tint.round(2)}"


def judge(image: Image, centre: tuple[float, float]) -> tuple[str, float]:
    """Verdict (hit, miss, or the reason for none) and the distance in px."""
    try:
        ball = propose(image).ball
    except CalibrationError as error:
        return str(error).split(":")[0], math.nan
    distance = math.hypot(ball.x_px - centre[0], ball.y_px - centre[1])
    return ("hit" if distance <= HIT_PX else "miss"), distance


def bench(name: str, image: Image, centre: tuple[float, float], count: int, seed: int) -> dict[str, Any]:
    """Counts of verdicts with and without the ball."""
    rng = np.random.default_rng(seed)
    row: dict[str, Any] = {"picture": name, "count": count, "with ball": {}, "ball painted out": {}, "worst_px": 0.0}
    bare = without_ball(image, centre)
    start = time.perf_counter()
    for _ in range(count):
        state = rng.bit_generator.state
        verdict, distance = judge(*(made := changed(image, centre, rng))[:2])
        row["with ball"][verdict] = row["with ball"].get(verdict, 0) + 1
        row["worst_px"] = max(row["worst_px"], 0.0 if math.isnan(distance) else distance)
        if verdict != "hit":
            print(f"  {name}: {verdict}: {made[2]}")
        rng.bit_generator.state = state
        claim = judge(*changed(bare, centre, rng)[:2])[0]
        claim = "false ball" if claim in ("hit", "miss") else claim
        row["ball painted out"][claim] = row["ball painted out"].get(claim, 0) + 1
    row["seconds_each"] = (time.perf_counter() - start) / (2 * count)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("HOOPD_SHARED", ROOT.parent / "shared")) / "frames"
    parser.add_argument("--frames", type=Path, default=default)
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = []
    for name, (image, centre) in load(options.frames).items():
        row = bench(name, image, centre, options.count, options.seed)
        print(
            f"{name}: with ball {row['with ball']}, worst {row['worst_px']:.2f} px; "
            f"ball painted out {row['ball painted out']}; {row['seconds_each']:.2f} s a picture"
        )
        rows.append(row)
    if options.json is not None:
        options.json.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
