"""Draws docs/figures/loop.png: a loop as the rig's camera sees it, with the plan, the estimate and the rig's own state.

python tools/maneuver_picture.py [--out docs/figures/loop.png]

The rig has inertias and frictions a tenth off and a dry friction (0.01 N m) that plan and filter know nothing of; plan
and law are those of the shipped model. One loop is played in lock-step with rendered pictures, the first attempt.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
from math import cos, sin, tau
from pathlib import Path
from typing import NamedTuple

import cv2
import msgspec
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from hoopd.commands.options.trajectory import TrajectoryOptions  # noqa: E402
from hoopd.commands.trajectory import planned  # noqa: E402
from hoopd.daemon.app import Options  # noqa: E402
from hoopd.daemon.maneuver import AskedManeuver, recorded_maneuvers  # noqa: E402
from hoopd.daemon.maneuver import run as play  # noqa: E402
from hoopd.daemon.recording_target import Where  # noqa: E402
from hoopd.files.model import Parameter, model_text  # noqa: E402
from hoopd.files.shipped import defaults_folder  # noqa: E402
from hoopd.files.trajectory import TrajectoryFile  # noqa: E402
from hoopd.plants.hoop.maneuver.judgement import RecordedManeuver  # noqa: E402
from hoopd.plants.model_file import load_model  # noqa: E402
from hoopd.plots import style  # noqa: E402
from hoopd.recording.mcap import read_run  # noqa: E402
from hoopd.sim import truth  # noqa: E402
from hoopd.sim.scene import Scene, SceneSettings  # noqa: E402

Array = NDArray[np.float64]
OUT = ROOT / "docs" / "figures" / "loop.png"
NOMINAL = defaults_folder() / "models" / "hoop.yaml"
OFF = {"Ih": 1.1, "Ib": 0.9, "bh": 1.1, "bb": 1.1}
HIDDEN = "sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.01}}]"
PICTURES = 8
PLAN_COLOUR, ESTIMATE_COLOUR = (255, 255, 255), (80, 255, 80)  # B G R


class Played(NamedTuple):
    """A loop, its plan and the rig's own state."""

    run: RecordedManeuver
    trajectory: TrajectoryFile
    state: truth.Truth


def played() -> Played:
    """The first attempt."""
    model = load_model(NOMINAL)
    parameters = {name: Parameter(value=OFF[name] * one.value, unit=one.unit) for name, one in model.parameters.items()}
    trajectory = planned(TrajectoryOptions(kind="loop", model=NOMINAL)).file
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        folder = Path(name)
        (folder / "rig.yaml").write_text(model_text(msgspec.structs.replace(model, parameters=parameters)))
        sets = (f"sim.model={folder / 'rig.yaml'}", f"sim.directory={folder}", "log.level=error", HIDDEN)
        result = play(
            AskedManeuver(trajectory, "loop.yaml"),
            Options(sim=True, sets=sets, speed="max"),
            Where(file=folder / "run.mcap"),
        )
        assert result["succeeded"] == 1, result["attempts"]
        ((run, _),) = recorded_maneuvers(read_run(folder / "run.mcap"))
        return Played(run, trajectory, truth.read(folder / "truth.csv"))


def strip(one: Played) -> list[tuple[float, NDArray[np.uint8]]]:
    """Times and pictures from beginning to end: the ball as it was, the plan as a ring, the estimate as a cross."""
    scene, plan = Scene(SceneSettings(noise_sigma=0.0)), np.array(one.trajectory.plan.states)
    pictures = []
    for share in np.linspace(0.06, 0.97, PICTURES):
        k = round(share * (len(plan) - 1))
        t = float(one.run.t[k])
        row = int(np.argmin(np.abs(one.state.t - t)))
        true = tuple(float(column[row]) for column in one.state[1:5])
        picture = scene.render(k, true)  # type: ignore[arg-type]
        _ring(picture, scene, float(plan[k, 2]) + one.run.bottom)
        x, y = scene.ball_centre(float(one.run.states[k, 2]))
        cv2.drawMarker(picture, (round(x), round(y)), ESTIMATE_COLOUR, cv2.MARKER_CROSS, 26, 3)
        pictures.append((t - float(one.run.t[0]), np.asarray(picture[..., ::-1], np.uint8)))
    return pictures


def _ring(picture: NDArray[np.uint8], scene: Scene, angle: float) -> None:
    s = scene.settings
    at = (round(s.centre[0] - s.track_radius * sin(angle)), round(s.centre[1] + s.track_radius * cos(angle)))
    cv2.circle(picture, at, round(s.ball_radius) + 5, PLAN_COLOUR, 2, cv2.LINE_AA)


def draw(one: Played) -> Figure:
    """The strip over the angle and how far the ball was from where it was planned and thought to be."""
    names = [f"p{k}" for k in range(PICTURES)]
    figure = style.figure(
        11.0, 4.6, mosaic=[names, ["angle"] * PICTURES, ["off"] * PICTURES], height_ratios=(1.35, 1.3, 1.0)
    )
    axes = style.named(figure)
    for name, (t, picture) in zip(names, strip(one), strict=True):
        axes[name].imshow(picture[24:456, 24:456])
        axes[name].set_axis_off()
        axes[name].set_title(f"{t:.2f} s", fontsize=style.NOTE_PT)
    _angle(axes["angle"], axes["off"], one)
    return figure


def _angle(angle: Axes, off: Axes, one: Played) -> None:
    run, zero, bottom = one.run, float(one.run.t[0]), one.run.bottom
    plan = np.array(one.trajectory.plan.states)[:, 2]
    n = len(plan)
    t = run.t[:n] - zero
    true = np.interp(run.t[:n], one.state.t, one.state.psi)
    angle.plot(t, plan / tau, color=style.GREY, linestyle="--", label="plan")
    angle.plot(t, (true - bottom) / tau, color=style.VERMILION, label="the rig's own state")
    angle.plot(t, (run.states[:n, 2] - bottom) / tau, color=style.BLUE, linewidth=1.0, label="estimate")
    angle.plot(run.seen_t[:n] - zero, (run.seen[:n] - bottom) / tau, ".", color=style.ORANGE, label="pictures")
    style.labelled(angle, "", "ball (turns)")
    style.legend(angle)
    off.plot(t, true - bottom - plan, color=style.GREY, label="ball, off the plan")
    off.plot(t, run.states[:n, 2] - true, color=style.BLUE, label="estimate, off the ball")
    style.labelled(off, "time (s)", "rad")
    style.legend(off)
    for one_axes in (angle, off):
        one_axes.set_xlim(0.0, t[-1])


def main() -> None:
    """Play, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=OUT)
    out = parser.parse_args().out
    style.save(draw(played()), out)
    print(out)


if __name__ == "__main__":
    main()
