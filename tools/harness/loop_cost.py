"""What a closed loop costs on true states, by the yardstick of `hoopd compare`, over its last minute.

Rules of this file: truth in, a number out; nothing that the daemon believed counts but the reference it was given.
"""

from __future__ import annotations

from typing import Any

from harness.rigrun import RigRun
from hoopd.design.yardstick import TickSample, held_speed
from hoopd.files.controller import load_controller
from hoopd.files.shipped import defaults_folder
from hoopd.heal.cost_promise import figure, summed

JUDGED_S = 60.0


def cost_of(t: Any, dtheta: Any, ball: Any, u: Any, wanted: Any) -> float:
    """The ball's error, rad rms; columns (n,) in s, rad/s, rad, N m and rad, the last of them the references."""
    held = held_speed(load_controller(defaults_folder() / "controllers" / "lqg.yaml").gains)
    part = t >= t[-1] - JUDGED_S
    columns = zip(*(one[part].tolist() for one in (t, u, dtheta, ball, wanted)), strict=True)
    rows = (TickSample(now, True, torque, speed, angle, now, wish) for now, torque, speed, angle, wish in columns)
    return figure(summed(rows, held), "ball")


def cost_of_run(run: RigRun) -> float:
    """Of a run of the daemon on the rig."""
    return cost_of(run.t, run.dtheta, run.psi, run.u, run.reference)
