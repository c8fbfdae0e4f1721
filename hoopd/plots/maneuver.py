"""A planned maneuver, and one that was played: angles, speeds, torque and the force that keeps the ball on the hoop.

Rules of this file: draws records and recordings; what a plan is worth was computed elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import tau
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from hoopd.files.trajectory import TrajectoryFile
from hoopd.plots import style

if TYPE_CHECKING:
    from hoopd.plants.hoop.maneuver.judgement import RecordedManeuver
    from hoopd.plants.hoop.maneuver.trajectory import PlannedTrajectory

Array = NDArray[np.float64]

AFTER_S = 1.5  # that is shown behind a plan
PLAN: dict[str, Any] = {"color": style.GREY, "linestyle": "--", "linewidth": 1.2}


def draw_plan(planned: PlannedTrajectory, name: str) -> Figure:
    """Torque, hoop speed, ball angle and contact of a plan, with the limits it keeps."""
    motion, limits = planned.motion, planned.question.limits
    t = motion.tick_s * np.arange(len(motion.states))
    figure = style.figure(7.5, 8.0, rows=4, title=f"Plan: {name}", sharex=True)
    torque, speed, angle, contact = figure.axes
    torque.stairs(motion.inputs, t, baseline=None, color=style.BLUE)
    _limits(torque, (limits.torque_nm, -limits.torque_nm))
    speed.plot(t, motion.states[:, 1])
    _limits(speed, (limits.hoop_speed_rad_s, -limits.hoop_speed_rad_s))
    angle.plot(t, motion.states[:, 2] / tau)
    contact.plot(t[:-1], planned.contact, label="force of the contact")
    contact.plot(t[:-1], planned.grip, label="friction coefficient needed")
    _limits(contact, (limits.contact, limits.grip))
    style.legend(contact)
    _words(figure.axes, ("torque (N m)", "hoop speed (rad/s)", "ball (turns)", "weights of the ball,\ncoefficient"))
    return figure


def draw_maneuver(runs: Sequence[RecordedManeuver], trajectory: TrajectoryFile) -> Figure:
    """Every maneuver of a recording over the plan: torque, hoop speed, ball angle, and how far the ball was off."""
    figure = style.figure(7.5, 8.0, rows=4, title=f"Maneuver: {trajectory.name}", sharex=True)
    torque, speed, angle, off = figure.axes
    plan: Array = np.array(trajectory.plan.states)
    t = np.arange(len(plan), dtype=np.float64) * trajectory.sample_time_s
    for run in runs:
        _attempt(figure.axes, run, t, plan)
    torque.stairs(trajectory.plan.torques_nm, t, baseline=None, **PLAN)
    speed.plot(t, plan[:, 1], **PLAN)
    angle.plot(t, plan[:, 2] / tau, label="plan", **PLAN)
    off.axhline(0.0, color=style.GREY, linewidth=0.6)
    style.legend(angle)
    figure.axes[-1].set_xlim(0.0, t[-1] + AFTER_S)
    _words(figure.axes, ("torque (N m)", "hoop speed (rad/s)", "ball (turns)", "off the plan (rad)"))
    return figure


def _attempt(axes: Sequence[Axes], run: RecordedManeuver, planned_t: Array, planned: Array) -> None:
    torque, speed, angle, off = axes
    shown = run.t <= run.t[0] + planned_t[-1] + AFTER_S
    t, states, first = run.t[shown] - run.t[0], run.states[shown], not angle.lines
    names = ("estimate", "camera") if first else (None, None)
    torque.step(t, run.torques[shown], where="post", color=style.BLUE, linewidth=0.9)
    speed.plot(t, states[:, 1], color=style.BLUE, linewidth=0.9)
    angle.plot(t, (states[:, 2] - run.bottom) / tau, color=style.BLUE, linewidth=0.9, label=names[0])
    seen_t, seen = run.seen_t[shown] - run.t[0], (run.seen[shown] - run.bottom) / tau
    angle.plot(seen_t, seen, ".", color=style.ORANGE, markersize=3, label=names[1])
    end, plan = planned_t[-1], planned[:, 2]
    estimate = states[t <= end, 2] - run.bottom - np.interp(t[t <= end], planned_t, plan)
    off.plot(t[t <= end], estimate, color=style.BLUE, linewidth=0.9)
    looked = seen_t <= end
    camera = tau * seen[looked] - np.interp(seen_t[looked], planned_t, plan)
    off.plot(seen_t[looked], camera, ".", color=style.ORANGE, markersize=3)


def _limits(axes: Axes, values: Sequence[float]) -> None:
    for value in values:
        axes.axhline(value, color=style.GREY, linestyle="--", linewidth=0.9)


def _words(axes: Sequence[Axes], words: Sequence[str]) -> None:
    for one, label in zip(axes, words, strict=True):
        one.set_ylabel(label)
    axes[-1].set_xlabel("time (s)")
