"""Files of planned motions (`hoopd.trajectory/1`): the plan, what it keeps, and on which model it was made.

Rules of this file: everything wrong in a file is one `InputError`; nothing is planned here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import msgspec

from hoopd.core.limits import TORQUE_LIMIT_NM
from hoopd.files.controller import ControllerFile
from hoopd.files.planned_motion import PlannedMotionEntry, flight_doubt, tracker_of
from hoopd.files.reading import InputError, parse_yaml, read_text, to_struct
from hoopd.files.records import Strict, between
from hoopd.files.yaml_text import text_of

DIGITS = 9


class KeptLimits(Strict, frozen=True):
    """What the plan keeps."""

    torque_nm: float
    hoop_speed_rad_s: float
    contact: float  # least force between hoop and ball, in weights of the ball
    grip: float | None = None  # friction coefficient that it may need; none: it was not asked for


class TrajectoryFile(Strict, frozen=True):
    """`hoopd.trajectory/1`."""

    schema: Literal["hoopd.trajectory/1"]
    name: str
    maneuver: Literal["loop", "swing", "throw", "up"]
    model: str
    model_sha256: str  # of the model file's bytes
    sample_time_s: float
    turn: int  # 1 or -1: which way round
    limits: KeptLimits
    plan: PlannedMotionEntry
    report: dict[str, Any] = msgspec.field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return self.sample_time_s * len(self.plan.torques_nm)


def load_trajectory(path: Path) -> TrajectoryFile:
    """A checked trajectory; InputError otherwise."""
    return parse_trajectory(read_text(path), path)


def parse_trajectory(text: str, path: object) -> TrajectoryFile:
    """A checked trajectory from its file's text; `path` is what a message calls it."""
    file = to_struct(parse_yaml(text, path), TrajectoryFile, path)
    between(path, "sample_time_s", file.sample_time_s, 0.0, 1.0)
    between(path, "limits.torque_nm", file.limits.torque_nm, 0.0, TORQUE_LIMIT_NM)
    if file.turn not in (1, -1):
        raise InputError(path, "turn", f"must be 1 or -1, not {file.turn}")
    try:
        tracker_of(file.plan)
    except ValueError as error:
        raise InputError(path, "plan", str(error)) from None
    if doubt := flight_doubt(file.plan, file.sample_time_s):
        raise InputError(path, "plan", doubt)
    return file


def trajectory_text(file: TrajectoryFile) -> str:
    """As YAML, a tick on a line."""
    plain = msgspec.to_builtins(file)
    return "# Made by hoopd trajectory: plan again rather than change a number.\n" + text_of(
        plain, default_flow_style=None, width=118
    )


def rounded(values: Any) -> Any:
    """Numbers, or lists of them, with as many digits as a plan needs."""
    if isinstance(values, list | tuple):
        return [rounded(one) for one in values]
    return float(f"{float(values):.{DIGITS}g}")


def short(value: float) -> float:
    """Four digits: what a person compares."""
    return float(f"{float(value):.4g}")


def maneuver_controller(file: TrajectoryFile, base: ControllerFile) -> ControllerFile:
    """The controller that plays a trajectory in a daemon whose ball is held by `base`: its filter, model and limits."""
    return ControllerFile(
        schema="hoopd.controller/1",
        name=file.name,
        kind="maneuver",
        gains=msgspec.to_builtins(file.plan),
        estimator=base.estimator,
        limits=base.limits,
        model=base.model,
        sample_time_s=file.sample_time_s,
        notes=f"{file.maneuver} planned on {file.model}: plays once, from rest at the bottom",
    )
