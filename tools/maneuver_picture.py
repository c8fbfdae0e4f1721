"""Draws docs/figures/loop.png or up.png: a maneuver as the rig's camera sees it, with plan, estimate and the truth.

python tools/maneuver_picture.py loop|up [--out FILE]

Plan, law and filter are those of a shipped model, and the rig is another: for `loop` its inertias and frictions are a
tenth off and it has a dry friction (0.01 N m), for `up` its ball bounces with a restitution of 0.2; nobody is told. It
is played once, in lock-step with rendered pictures: the first attempt.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from math import tau
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
from hoopd.core.records import TickRecord  # noqa: E402
from hoopd.daemon.app import Options  # noqa: E402
from hoopd.daemon.maneuver import AskedManeuver, run as play  # noqa: E402
from hoopd.daemon.recording_target import Where  # noqa: E402
from hoopd.files.model import Parameter, model_text  # noqa: E402
from hoopd.files.shipped import defaults_folder  # noqa: E402
from hoopd.plants.model_file import load_model  # noqa: E402
from hoopd.plots import style  # noqa: E402
from hoopd.recording.mcap import read_run  # noqa: E402
from hoopd.sim import truth  # noqa: E402
from hoopd.sim.scene import Scene, SceneSettings  # noqa: E402

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
FIGURES, MODELS = ROOT / "docs" / "figures", defaults_folder() / "models"
TICK_S = 0.02
PLAN_COLOUR, ESTIMATE_COLOUR = (255, 255, 255), (80, 255, 80)  # B G R
# Of the ball's centre on the inner hoop in the rig's pictures.
INNER_PX, BALL_PX = 182.0 * (0.0445 + 0.0104) / (0.0957 - 0.0104), 23.0


class Played(NamedTuple):
    """One maneuver: its rows from the first tick on, the rig's own state, and psi of the plan by tick."""

    rows: list[TickRecord]
    state: truth.Truth
    plan: Array

    @property
    def bottom(self) -> float:
        """The bottom from which it began, rad."""
        return float(tau * np.round(self.rows[0].x_hat[2] / tau))

    def true(self, rows: Sequence[TickRecord], name: str) -> Array:
        """A column of the rig's state at the times of these rows."""
        return np.asarray(np.interp([one.t for one in rows], self.state.t, getattr(self.state, name)))


class Shown(NamedTuple):
    """What is played, and what is drawn of it."""

    model: str
    hidden: str  # `sim.effects`
    times_s: Sequence[float]  # of the pictures, from the first tick on
    end_s: float  # of the panels
    panels: Mapping[str, Callable[[Axes, Played, list[TickRecord]], None]]
    heights: tuple[float, ...]  # of the panels; a strip of pictures has 1.35
    size_inch: tuple[float, float]
    off: Mapping[str, float] = {}  # factors of the rig's parameters
    inner_px: float = 0.0
    ring: bool = False  # around the ball of the plan


def played(kind: str) -> Played:
    """The first attempt."""
    shown, model_path = SHOWN[kind], MODELS / SHOWN[kind].model
    model = load_model(model_path)
    parameters = {
        name: Parameter(value=shown.off.get(name, 1.0) * one.value, unit=one.unit)
        for name, one in model.parameters.items()
    }
    trajectory = planned(TrajectoryOptions(kind=kind, model=model_path)).file
    with tempfile.TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        folder = Path(name)
        (folder / "rig.yaml").write_text(model_text(msgspec.structs.replace(model, parameters=parameters)))
        told = (f"sim.model={folder / 'rig.yaml'}", f"device.model={model_path}", f"sim.directory={folder}")
        result = play(
            AskedManeuver(trajectory, f"{kind}.yaml"),
            Options(sim=True, sets=(*told, "log.level=error", f"sim.effects=[{shown.hidden}]"), speed="max"),
            Where(file=folder / "run.mcap"),
        )
        assert result["succeeded"] == 1, result["attempts"]
        began = result["attempts"][0]["began_s"]
        rows = [tick for tick in read_run(folder / "run.mcap").ticks if tick.t >= began]
        return Played(rows, truth.read(folder / "truth.csv"), np.array(trajectory.plan.states)[:, 2])


def strip(kind: str, one: Played) -> list[tuple[float, Picture]]:
    """Times and pictures: the ball as it was, the estimate as a cross, the plan as a ring."""
    shown = SHOWN[kind]
    inner = shown.inner_px - BALL_PX if shown.inner_px else 0.0
    scene = Scene(SceneSettings(noise_sigma=0.0, inner_radius=inner))
    return [(t, _picture(scene, one, round(t / TICK_S), ring=shown.ring)) for t in shown.times_s]


def _picture(scene: Scene, one: Played, k: int, *, ring: bool) -> Picture:
    tick = one.rows[k]
    row = int(np.argmin(np.abs(one.state.t - tick.t)))
    theta, dtheta, psi, dpsi, distance = (float(column[row]) for column in one.state[1:])
    picture = scene.render(k, (theta, dtheta, psi, dpsi), distance=distance)
    if ring:
        x, y = scene.ball_centre(float(one.plan[k]) + one.bottom)
        cv2.circle(picture, (round(x), round(y)), round(scene.settings.ball_radius) + 5, PLAN_COLOUR, 2, cv2.LINE_AA)
    x, y = scene.ball_centre(tick.x_hat[2], tick.distance_hat if tick.ball_mode else 1.0)
    cv2.drawMarker(picture, (round(x), round(y)), ESTIMATE_COLOUR, cv2.MARKER_CROSS, 26, 3)
    return np.asarray(picture[..., ::-1], np.uint8)


def draw(kind: str, one: Played) -> Figure:
    """The strip of pictures over the panels."""
    shown = SHOWN[kind]
    names = [f"p{k}" for k in range(len(shown.times_s))]
    mosaic = [names, *([panel] * len(names) for panel in shown.panels)]
    axes = style.named(figure := style.figure(*shown.size_inch, mosaic=mosaic, height_ratios=(1.35, *shown.heights)))
    for name, (t, picture) in zip(names, strip(kind, one), strict=True):
        axes[name].imshow(picture[24:456, 24:456])
        axes[name].set_axis_off()
        axes[name].set_title(f"{t:.2f} s", fontsize=style.NOTE_PT)
    rows = [tick for tick in one.rows if tick.t - one.rows[0].t <= shown.end_s]
    for name, panel in shown.panels.items():
        panel(axes[name], one, rows)
        style.legend(axes[name])
        axes[name].set_xlim(0.0, shown.end_s)
        style.labelled(axes[name], "time (s)" if name == list(shown.panels)[-1] else "", LABELS[name])
    return figure


# ------------------------------------------------------------------------------------------ panels


def _times(one: Played, rows: list[TickRecord]) -> Array:
    return np.array([tick.t for tick in rows]) - one.rows[0].t


def _angle(axes: Axes, one: Played, rows: list[TickRecord]) -> None:
    t, plan = _times(one, rows), one.plan[: len(rows)]
    axes.plot(t[: len(plan)], plan / tau, color=style.GREY, linestyle="--", label="plan")
    true, estimate = one.true(rows, "psi"), np.array([tick.x_hat[2] for tick in rows])
    axes.plot(t, (true - one.bottom) / tau, color=style.VERMILION, label="the rig's own state")
    axes.plot(t, (estimate - one.bottom) / tau, color=style.BLUE, linewidth=1.0, label="estimate")
    seen = np.array([(tick.psi_t - one.rows[0].t, (tick.psi - one.bottom) / tau) for tick in rows])
    axes.plot(*seen.T, ".", color=style.ORANGE, label="pictures")


def _off(axes: Axes, one: Played, rows: list[TickRecord]) -> None:
    t, true, n = _times(one, rows), one.true(rows, "psi"), min(len(rows), len(one.plan))
    axes.plot(t[:n], true[:n] - one.bottom - one.plan[:n], color=style.GREY, label="ball, off the plan")
    axes.plot(t, [tick.x_hat[2] for tick in rows] - true, color=style.BLUE, label="estimate, off the ball")


def _distance(axes: Axes, one: Played, rows: list[TickRecord]) -> None:
    t = _times(one, rows)
    axes.plot(t, one.true(rows, "distance"), color=style.VERMILION, label="the rig's own state")
    axes.plot(t, [tick.distance_hat for tick in rows], color=style.BLUE, linewidth=1.0, label="estimate")
    seen = np.array([(tick.psi_t - one.rows[0].t, tick.distance) for tick in rows])
    axes.plot(*seen.T, ".", color=style.ORANGE, label="pictures")


def _mode(axes: Axes, one: Played, rows: list[TickRecord]) -> None:
    for mode, colour in (("rolling", style.GREY), ("air", style.VERMILION), ("inner", style.BLUE)):
        share = [tick.mode_probability if tick.ball_mode == mode else np.nan for tick in rows]
        axes.plot(_times(one, rows), share, ".", color=colour, label=mode)
    axes.set_ylim(0.0, 1.1)


LABELS = {"angle": "ball (turns)", "off": "rad", "distance": "distance (track)", "mode": "probability"}
SHOWN = {
    "loop": Shown(
        model="hoop.yaml",
        hidden="{name: hoop.coulomb_friction, parameters: {Fc: 0.01}}",
        times_s=tuple(np.linspace(0.08, 1.32, 8).tolist()),
        end_s=1.36,
        panels={"angle": _angle, "off": _off},
        heights=(1.3, 1.0),
        size_inch=(11.0, 4.6),
        off={"Ih": 1.1, "Ib": 0.9, "bh": 1.1, "bb": 1.1},
        ring=True,
    ),
    "up": Shown(
        model="inner_hoop.yaml",
        hidden="{name: ball.lift_off, parameters: {restitution: 0.2, grip: 0.4}}",
        times_s=(0.3, 0.54, 0.64, 0.7, 0.74, 0.82, 1.1, 3.0),
        end_s=2.0,
        panels={"angle": _angle, "distance": _distance, "mode": _mode},
        heights=(1.0, 1.0, 0.7),
        size_inch=(11.0, 5.6),
        inner_px=INNER_PX,
    ),
}


def main() -> None:
    """Play, draw and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=tuple(SHOWN))
    parser.add_argument("--out", type=Path, help="without, the picture of this kind in the documentation")
    options = parser.parse_args()
    out = options.out or FIGURES / f"{options.kind}.png"
    style.save(draw(options.kind, played(options.kind)), out)
    print(out)


if __name__ == "__main__":
    main()
