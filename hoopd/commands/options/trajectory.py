"""Options of `hoopd trajectory`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import figure_option, json_option, model_option


def kind_argument() -> Any:
    """Which maneuver."""
    return argument(
        "loop: once round the hoop; swing: to an angle and back; throw: off the hoop and caught; "
        "up: onto the top of an inner hoop.",
        metavar="KIND",
    )


def torque_option() -> Any:
    """What the plan may ask of the drive."""
    return option(
        "--max-torque",
        min=0.001,
        text="Torque of the plan in N m, the rest is feedback's; 0.45, and 0.6 where nothing can be planned with that.",
    )


def speed_limit_option() -> Any:
    """How fast the hoop may turn."""
    return option("--max-speed", min=0.1, text="Hoop speed of the plan in rad/s.", default=40.0)


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions:
    """Plan a maneuver of the ball on a model, with the feedback that keeps it on its way."""

    kind: str = kind_argument()
    model: Path = model_option()
    out: Path | None = option("--out", text="Write the trajectory (.yaml).", metavar="TRAJECTORY", python=False)
    law: Path | None = option(
        "--law", text="Write it as a controller that a running daemon plays once (.yaml).", metavar="FILE", python=False
    )
    controller: Path | None = option(
        "--controller",
        text="With --law: the daemon's controller, whose filter and limits it takes over; controllers/lqg.yaml.",
        metavar="CONTROLLER",
        python=False,
    )
    seconds: float | None = option("--seconds", text="How long it takes; as suits it without.")
    angle_rad: float = option("--angle", text="swing: how far out, in rad.", default=1.0)
    flight_s: float = option(
        "--flight", text="throw: how long the ball is in the air, in s; whole ticks, 0.06 to 0.22.", default=0.18
    )
    hold_s: float = option("--hold", text="up: how long the ball is held on the top, in s; 1 to 8.", default=3.0)
    turn: int = option("--turn", text="1 or -1: which way round, as the angle counts.", default=1)
    torque_nm: float | None = torque_option()
    hoop_speed_rad_s: float = speed_limit_option()
    contact: float | None = option(
        "--contact",
        text="Least force between hoop and ball, in weights of the ball (below 0 it flies); 0.5. Not of up.",
    )
    grip: float = option(
        "--grip", min=0.01, text="Friction coefficient that the contact may need, so that the ball rolls.", default=0.6
    )
    figure: Path | None = figure_option("Draw the plan (.png, .svg or .pdf).")
    json_path: Path | None = json_option()
