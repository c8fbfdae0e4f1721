"""What a closed loop costs on true states, by the yardstick of `hoopd compare`, over its last minute.

Rules of this file: truth in, numbers out; nothing that the daemon believed counts but the reference it was given.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.rigrun import RigRun
from hoopd.design.yardstick import BlockFigures, TickSample, held_speed
from hoopd.files.controller import load_controller
from hoopd.files.shipped import defaults_folder
from hoopd.heal.cost_promise import summed

JUDGED_S = 60.0
USUAL = defaults_folder() / "controllers" / "lqg.yaml"


def figures_of(t: Any, dtheta: Any, ball: Any, u: Any, wanted: Any, held_by: Path = USUAL) -> BlockFigures:
    """Cost and the ball's error; columns (n,) in s, rad/s, rad, N m and rad, the last of them the references.

    `held_by`: the law that knows how the hoop has to turn for a reference; the ball's error does without.
    """
    held = held_speed(load_controller(held_by).gains)
    part = t >= t[-1] - JUDGED_S
    columns = zip(*(one[part].tolist() for one in (t, u, dtheta, ball, wanted)), strict=True)
    rows = (TickSample(now, True, torque, speed, angle, now, wish) for now, torque, speed, angle, wish in columns)
    return summed(rows, held)


def figures_of_run(run: RigRun, held_by: Path = USUAL) -> BlockFigures:
    """Of a run of the daemon on the rig."""
    return figures_of(run.t, run.dtheta, run.psi, run.u, run.reference, held_by)
