"""Files of corrections (`hoopd.correction/1`): torques beside a planned motion that its attempts have taught.

Rules of this file: everything wrong in a file is one `InputError`; nothing is learned here.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from hoopd.core.tracker import LONGEST_PLAN_TICKS
from hoopd.files.planned_motion import Row, Torque
from hoopd.files.reading import InputError, parse_yaml, read_text, to_struct
from hoopd.files.records import Strict, between
from hoopd.files.trajectory import TrajectoryFile, rounded
from hoopd.files.yaml_text import text_of

SUFFIX = ".correction.yaml"
# Of the torque that the plan keeps: a correction is small beside what it corrects.
LIMIT_SHARE = 0.25


# Of an attempt, what changes from one to the next.
LEARNED = ("tracking", "feedback_nm", "correction_nm")


class LearnedAttempt(Strict, frozen=True):
    """What an attempt was like."""

    recording: str
    correction_nm: float  # the largest that it was played with
    tracking: float  # root of the mean cost of being off the plan; 1: as far as the feedback's weights say
    feedback_nm: float  # root of the mean square of the torque that feedback added
    success: bool


class BestCorrection(Strict, frozen=True):
    """That of the attempt which was nearest to the plan."""

    tracking: float
    torques_nm: list[Torque]


class CorrectionFile(Strict, frozen=True):
    """`hoopd.correction/1`."""

    schema: Literal["hoopd.correction/1"]
    trajectory: str
    trajectory_sha256: str  # of the trajectory file's bytes
    limit_nm: float  # no torque of the correction is larger
    # of the next attempt: nobody has seen them played yet, unless they are the best one's
    torques_nm: Annotated[list[Torque], Meta(min_length=1, max_length=LONGEST_PLAN_TICKS)]
    # of (theta, dtheta, psi, dpsi), a row a tick, what the model left unexplained and what feedback did for a wrong
    # estimate: a mean over the attempts, in which new ones count more
    unexplained: list[Row]
    attempts: list[LearnedAttempt]
    best: BestCorrection | None = None
    untaught: int = 0  # attempts that were played and taught nothing


def correction_beside(trajectory: Path) -> Path:
    """Where the correction of a trajectory file is.

    Examples
    --------
    >>> from pathlib import Path
    >>> from hoopd.files.correction import correction_beside
    >>> correction_beside(Path("plans/loop.yaml")).as_posix()
    'plans/loop.correction.yaml'
    """
    return trajectory.with_name(trajectory.stem + SUFFIX)


def load_correction(path: Path, trajectory: TrajectoryFile, trajectory_sha256: str) -> CorrectionFile:
    """A checked correction of this very trajectory; InputError otherwise."""
    file = to_struct(parse_yaml(read_text(path), path), CorrectionFile, path)
    if file.trajectory_sha256 != trajectory_sha256:
        raise InputError(path, "trajectory_sha256", "was learned on another trajectory: remove it, or give its own")
    between(path, "limit_nm", file.limit_nm, 0.0, LIMIT_SHARE * trajectory.limits.torque_nm + 1e-9)
    torques = {"torques_nm": file.torques_nm} | ({"best.torques_nm": file.best.torques_nm} if file.best else {})
    planned = len(trajectory.plan.torques_nm)
    lengths = {name: len(rows) for name, rows in torques.items()} | {"unexplained": len(file.unexplained)}
    for name, rows in lengths.items():
        if rows != planned:
            raise InputError(path, name, f"has {rows} rows, the plan {planned}")
    for name, values in torques.items():
        for k, torque in enumerate(values):
            if not abs(torque) <= file.limit_nm:
                raise InputError(path, f"{name}[{k}]", f"{torque:g} N m is beyond limit_nm ({file.limit_nm:g})")
    return file


def corrected(trajectory: TrajectoryFile, torques_nm: Sequence[float], limit_nm: float) -> TrajectoryFile:
    """The trajectory as it is played with a correction, which takes no torque beyond the limit in force: other torques,
    the same states."""
    both = zip(trajectory.plan.torques_nm, torques_nm, strict=True)
    # a plan that is itself beyond stays so, to be refused
    bounded = [min(max(limit_nm, one), max(min(-limit_nm, one), rounded(one + more))) for one, more in both]
    plan = msgspec.structs.replace(trajectory.plan, torques_nm=bounded)
    return msgspec.structs.replace(trajectory, plan=plan)


def correction_text(file: CorrectionFile) -> str:
    """As YAML, a tick on a line."""
    return "# Made by hoopd maneuver --learn: attempt again rather than change a number.\n" + text_of(
        msgspec.to_builtins(file), default_flow_style=None, width=118
    )
