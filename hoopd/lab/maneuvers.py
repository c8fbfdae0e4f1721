"""Planned maneuvers: once round the hoop, out and back, or a throw.

Rules of this file: thin over `hoopd.commands.trajectory`; nothing is planned here.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.commands.options.declaration import from_python
from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.commands.trajectory import plan_on, planned
from hoopd.files.model import model_text
from hoopd.files.reading import InputError
from hoopd.files.trajectory import TrajectoryFile, trajectory_text
from hoopd.files.whole_files import replace_file
from hoopd.lab.models import Model, shipped
from hoopd.lab.pictures import Picture
from hoopd.plants.hoop.maneuver.trajectory import PlannedTrajectory, trajectory_file
from hoopd.plots.maneuver import draw_plan


@dataclass(frozen=True, repr=False)
class PlannedManeuver:
    """A plan with its feedback."""

    plan: PlannedTrajectory
    file: TrajectoryFile

    def __repr__(self) -> str:
        return f"PlannedManeuver({self.file.maneuver} on {self.file.model}: {self.file.seconds:.2f} s)"

    @cached_property
    def t(self) -> NDArray[np.float64]:
        """Times (n + 1,) of the edges of its ticks, s."""
        return self.file.sample_time_s * np.arange(len(self.file.plan.states), dtype=np.float64)

    @property
    def states(self) -> NDArray[np.float64]:
        """States (n + 1, 4): theta (rad), dtheta (rad/s), psi (rad), dpsi (rad/s)."""
        return self.plan.motion.states

    @property
    def torque(self) -> NDArray[np.float64]:
        """Torques (n,), held from each edge to the next, N m."""
        return self.plan.motion.inputs

    @property
    def contact(self) -> NDArray[np.float64]:
        """Force between hoop and ball (n,) at the edges, in weights of the ball."""
        return self.plan.contact

    @property
    def report(self) -> dict[str, Any]:
        """What the plan needs, and how far it may be trusted: what the command shows."""
        return self.file.report

    def plot(self) -> Picture:
        """Torque, speeds, angle and contact."""
        return Picture(draw_plan(self.plan, self.file.name))

    def save(self, path: Path | str) -> Path:
        """Write `hoopd.trajectory/1`, which `hoopd maneuver` plays."""
        if Path(path).suffix not in (".yaml", ".yml"):
            raise InputError(path, "", "must end in .yaml, as hoopd maneuver reads it")
        replace_file(Path(path), trajectory_text(self.file).encode())
        return Path(path)


def trajectory(
    kind: str,
    model: Model | Path | str,
    *,
    seconds: float | None = None,
    angle: float = 1.0,
    flight: float = 0.18,
    hold: float = 3.0,
    turn: int = 1,
    max_torque: float | None = None,
    max_speed: float = 40.0,
    contact: float | None = None,
    grip: float = 0.6,
) -> PlannedManeuver:
    """Plan a maneuver of the ball on a model, with the feedback that keeps it on its way.

    Parameters
    ----------
    kind : str
        loop: once round the hoop; swing: to an angle and back; throw: off the hoop and caught; up: onto the top of an
        inner hoop.
    model : Model, str or Path
        A model, its shipped name, or its file's path; effects in a file are part of the plan.
    seconds : float, optional
        How long it takes; as suits it without.
    angle : float
        swing: how far out, in rad.
    flight : float
        throw: how long the ball is in the air, in s; whole ticks.
    hold : float
        up: how long the ball is held on the top, in s.
    turn : int
        1 or -1: which way round, as the ball's angle counts.
    max_torque : float, optional
        Torque of the plan in N m, the rest is feedback's; 0.45, and 0.6 where nothing can be planned with that.
    max_speed : float
        Hoop speed of the plan in rad/s.
    contact : float, optional
        Least force between hoop and ball, in weights of the ball; 0.5. Not of up.
    grip : float
        Friction coefficient that the contact may need, so that the ball rolls.

    Returns
    -------
    PlannedManeuver
        Its `states`, `torque`, `contact` and `report`; `save` writes it for `hoopd maneuver`.

    Raises
    ------
    InputError
        In one line: unusable arguments, or the limit that stands in the way.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> loop = lab.trajectory("loop", "hoop")
    >>> round(float(loop.states[-1, 2]), 3), loop.report["least_contact"] >= 0.5
    (6.283, True)
    """
    path = Path(model.name) if isinstance(model, Model) else shipped("models", model)
    asked = from_python(
        TrajectoryOptions, kind=kind, model=path, seconds=seconds, angle=angle, flight=flight, hold=hold, turn=turn,
        max_torque=max_torque, max_speed=max_speed, contact=contact, grip=grip,
    )  # fmt: skip
    if not isinstance(model, Model):
        return PlannedManeuver(*planned(asked))
    found, sha256 = plan_on(model.file, asked), hashlib.sha256(model_text(model.file).encode()).hexdigest()
    return PlannedManeuver(found, trajectory_file(found, model.name, sha256, kind))
