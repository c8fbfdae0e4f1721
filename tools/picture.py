"""Draws docs/figures/rig.png: two noiseless pictures of the rig's camera with what the detector sees in them."""

from __future__ import annotations

import argparse
from math import cos, sin
from pathlib import Path

import cv2
import numpy as np

from hoopd.shell.ball_detection import Analyser
from hoopd.shell.config import load
from hoopd.sim.scene import Scene, SceneSettings

STATES = ((0.35, 4.0, 0.4, 2.0), (1.1, -6.0, -1.0, -9.0))
OUT = Path(__file__).resolve().parents[1] / "docs" / "figures" / "rig.png"


def main() -> None:
    """Write the page's picture, or a plain one of the ball at rest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plain", type=Path, help="write one picture as the rig's camera takes it, ball at rest")
    plain = parser.parse_args().plain
    if plain is not None:
        cv2.imwrite(str(plain), Scene(SceneSettings()).render(0, (0.35, 0.0, 0.0, 0.0)))
        return
    config = load(None, sim=True, overrides=[])
    scene, analyser = Scene(SceneSettings(noise_sigma=0.0)), Analyser(config.vision, 0.3)
    pictures = [marked(scene, analyser, number, state) for number, state in enumerate(STATES)]
    cv2.imwrite(str(OUT), np.hstack(pictures), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(OUT)


def marked(scene: Scene, analyser: Analyser, number: int, state: tuple[float, float, float, float]) -> np.ndarray:
    """One picture with circle, zero direction and detected ball."""
    picture = scene.render(number, state)
    sample = analyser.bgr(number, 0.0, 0.0, picture)
    s = scene.settings
    centre = (round(s.centre[0]), round(s.centre[1]))
    cv2.circle(picture, centre, round(s.track_radius), (120, 200, 255), 1, cv2.LINE_AA)
    cv2.line(picture, centre, (centre[0], round(centre[1] + s.track_radius)), (120, 200, 255), 1, cv2.LINE_AA)
    end = (round(s.centre[0] - s.track_radius * sin(sample.psi)), round(s.centre[1] + s.track_radius * cos(sample.psi)))
    cv2.line(picture, centre, end, (80, 255, 80), 1, cv2.LINE_AA)
    cv2.drawMarker(picture, (round(sample.x_px), round(sample.y_px)), (80, 255, 80), cv2.MARKER_CROSS, 20, 2)
    cv2.putText(picture, f"psi {sample.psi:+.3f} rad", (12, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.65, (80, 255, 80), 2)
    return picture


if __name__ == "__main__":
    main()
