"""Draws docs/figures/up.png: a ball thrown onto the inner hoop, as the rig's camera sees it and as the filter does.

python tools/up_picture.py [--out docs/figures/up.png]

Plan, law and filter are those of the shipped model with an inner hoop; the rig's ball bounces with a restitution of
0.2, which nobody is told. It is played once, in lock-step with rendered pictures.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
from math import tau
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from hoopd.commands.options.trajectory import TrajectoryOptions  # noqa: E402
from hoopd.commands.trajectory import planned  # noqa: E402
from hoopd.core.records import TickRecord  # noqa: E402
from hoopd.daemon.app import Options  # noqa: E402
from hoopd.daemon.maneuver import AskedManeuver  # noqa: E402
from hoopd.daemon.maneuver import run as play  # noqa: E402
from hoopd.daemon.recording_target import Where  # noqa: E402
from hoopd.files.shipped import defaults_folder  # noqa: E402
from hoopd.files.trajectory import TrajectoryFile  # noqa: E402
from hoopd.plots import style  # noqa: E402
from hoopd.recording.mcap import read_run  # noqa: E402
from hoopd.sim import truth  # noqa: E402
from hoopd.sim.scene import Scene, SceneSettings  # noqa: E402

OUT = ROOT / "docs" / "figures" / "up.png"
MODEL = defaults_folder() / "models" / "inner_hoop.yaml"
BOUNCES = "sim.effects=[{name: ball.lift_off, parameters: {restitution: 0.2, grip: 0.4}}]"
# Of the ball's centre on the inner hoop in the rig's pictures, and the pictures that are shown: s from the first tick.
INNER_PX, BALL_PX = 182.0 * (0.0445 + 0.0104) / (0.0957 - 0.0104), 23.0
SHOWN_S = (0.3, 0.54, 0.64, 0.7, 0.74, 0.82, 1.1, 3.0)
ESTIMATE_COLOUR = (80, 255, 80)  # B G R
END_S = 2.0


class PlayedUp(NamedTuple):
    """One way up: rows from its first tick, and the rig's own state."""

    rows: list[TickRecord]
    state: truth.Truth
    trajectory: TrajectoryFile


def played() -> PlayedUp:
    """The first attempt."""
    trajectory = planned(TrajectoryOptions(kind="up", model=MODEL)).file
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        folder = Path(name)
        sets = (f"sim.model={MODEL}", f"device.model={MODEL}", f"sim.directory={folder}", "log.level=error", BOUNCES)
        result = play(
            AskedManeuver(trajectory, "up.yaml"),
            Options(sim=True, sets=sets, speed="max"),
            Where(file=folder / "run.mcap"),
        )
        assert result["succeeded"] == 1, result["attempts"]
        began = result["attempts"][0]["began_s"]
        rows = [tick for tick in read_run(folder / "run.mcap").ticks if tick.t >= began]
        return PlayedUp(rows, truth.read(folder / "truth.csv"), trajectory)


def strip(one: PlayedUp) -> list[tuple[float, NDArray[np.uint8]]]:
    """Times and pictures: the ball as it was, the estimate as a cross."""
    scene = Scene(SceneSettings(noise_sigma=0.0, inner_radius=INNER_PX - BALL_PX))
    pictures = []
    for t in SHOWN_S:
        tick = one.rows[round(t / 0.02)]
        row = int(np.argmin(np.abs(one.state.t - tick.t)))
        theta, dtheta, psi, dpsi, distance = (float(column[row]) for column in one.state[1:])
        picture = scene.render(0, (theta, dtheta, psi, dpsi), distance=distance)
        x, y = scene.ball_centre(tick.x_hat[2], tick.distance_hat)
        cv2.drawMarker(picture, (round(x), round(y)), ESTIMATE_COLOUR, cv2.MARKER_CROSS, 26, 3)
        pictures.append((t, np.asarray(picture[..., ::-1], np.uint8)))
    return pictures


def draw(one: PlayedUp) -> Figure:
    """The strip over direction, distance, and how sure the mode is."""
    names = [f"p{k}" for k in range(len(SHOWN_S))]
    panels = ("angle", "distance", "mode")
    figure = style.figure(
        11.0, 5.6, mosaic=[names, *([panel] * len(names) for panel in panels)], height_ratios=(1.35, 1.0, 1.0, 0.7)
    )
    axes = style.named(figure)
    for name, (t, picture) in zip(names, strip(one), strict=True):
        axes[name].imshow(picture[24:456, 24:456])
        axes[name].set_axis_off()
        axes[name].set_title(f"{t:.2f} s", fontsize=style.NOTE_PT)
    zero = one.rows[0].t
    rows = [tick for tick in one.rows if tick.t - zero <= END_S]
    t, state = np.array([tick.t for tick in rows]) - zero, one.state
    plan = np.array(one.trajectory.plan.states)[: len(rows), 2]
    axes["angle"].plot(t[: len(plan)], plan / tau, color=style.GREY, linestyle="--", label="plan")
    for name, column, scale in (("angle", state.psi, tau), ("distance", state.distance, 1.0)):
        axes[name].plot(
            t, np.interp(t + zero, state.t, column) / scale, color=style.VERMILION, label="the rig's own state"
        )
    axes["angle"].plot(
        t, np.array([tick.x_hat[2] for tick in rows]) / tau, color=style.BLUE, label="estimate", linewidth=1.0
    )
    axes["distance"].plot(t, [tick.distance_hat for tick in rows], color=style.BLUE, linewidth=1.0)
    seen = np.array([(tick.psi_t - zero, tick.distance) for tick in rows])
    axes["distance"].plot(*seen.T, ".", color=style.ORANGE, label="pictures")
    for mode, colour in (("rolling", style.GREY), ("air", style.VERMILION), ("inner", style.BLUE)):
        share = [tick.mode_probability if tick.ball_mode == mode else np.nan for tick in rows]
        axes["mode"].plot(t, share, ".", color=colour, label=mode)
    style.labelled(axes["angle"], "", "ball (turns)")
    style.labelled(axes["distance"], "", "distance (track)")
    style.labelled(axes["mode"], "time (s)", "probability")
    for panel in panels:
        style.legend(axes[panel])
        axes[panel].set_xlim(0.0, END_S)
    axes["mode"].set_ylim(0.0, 1.1)
    return figure


def main() -> None:
    """Play, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=OUT)
    out = parser.parse_args().out
    style.save(draw(played()), out)
    print(out)


if __name__ == "__main__":
    main()
