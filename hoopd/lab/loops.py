"""The closed loop against the nonlinear plant.

Rules of this file: thin over `hoopd.plants.hoop.loop.trial`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.core.records import PICTURE_AGE_S
from hoopd.lab.controllers import Controller, as_controller
from hoopd.lab.models import Model, as_model
from hoopd.lab.pictures import Picture
from hoopd.plants.hoop.loop.closed_loop import ClosedLoopRun, LinearPlant, Scenario, picture_timing
from hoopd.plants.hoop.loop.trial import figures_of, run as closed
from hoopd.plots.loops import draw_runs

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class ClosedLoop:
    """A closed-loop run, one row a tick."""

    run: ClosedLoopRun
    name: str
    torque_limit: float  # N m

    def __repr__(self) -> str:
        return f"ClosedLoop({self.name}, {len(self.t)} ticks, ball within {self.figures['largest_psi_rad']:.3g} rad)"

    @property
    def t(self) -> Array:
        """(n,) s from the release."""
        return self.run.t

    @property
    def states(self) -> Array:
        """True states (n, 4): theta (rad), dtheta (rad/s), psi (rad), dpsi (rad/s)."""
        return self.run.x

    def __getattr__(self, name: str) -> Array:
        """The run's own signals (n,): `psi` (rad) and `dtheta` (rad/s), as they truly were."""
        if name.startswith("_") or name == "run":
            raise AttributeError(name)
        return getattr(self.run, name)  # type: ignore[no-any-return]

    @property
    def u(self) -> Array:
        """Torque (n,) in N m."""
        return self.run.u

    @property
    def figures(self) -> dict[str, Any]:
        """Largest angle and torque, settling times, how the run ends; None: it did not settle."""
        return figures_of(self.run, self.torque_limit)

    def plot(self) -> Picture:
        """Ball angle, hoop speed and torque."""
        return Picture(draw_runs({self.name: self.run}))


def feedback(
    model: Model | str,
    law: Controller | str,
    *,
    psi0: float = 0.0,
    disturbance: float = 0.0,
    delay: float = PICTURE_AGE_S,
    zero_angle: float = 0.0,
    reference: float | Callable[[float], float] = 0.0,
    duration: float = 6.0,
    noise: bool = True,
    linear: bool = False,
    seed: int = 1,
) -> ClosedLoop:
    """Run a law against the nonlinear plant of a model (or its linear model), in the daemon's time-line and limits.

    The law's filter knows the model that the law was designed on, not `model`.

    Parameters
    ----------
    model : Model or str
        The plant, or a model by name or path.
    law : Controller or str
        A design, or a controller by name or path.
    psi0 : float
        Angle in rad at which the ball is let go.
    disturbance : float
        Error in rad on the first picture's angle, which is believed.
    delay : float
        Age in s of a picture at its tick, from 0 to 0.2.
    zero_angle : float
        Angle in rad that the camera adds to every picture.
    reference : float or callable
        Angle in rad that is asked for, or a function of t in s.
    duration : float
        Length in s.
    noise : bool
        Whether the sensors have noise.
    linear : bool
        Whether the plant is linear.
    seed : int
        Of the noise.

    Returns
    -------
    ClosedLoop
        True `states` (n, 4) and torque `u` (n,) at `t` (n,), one row a tick, and the `figures`.

    Raises
    ------
    ValueError
        A number that is out of its range.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> caught = lab.feedback("thesis", "lqg", psi0=0.4, noise=False)
    >>> bool(abs(caught.psi[-1]) < 0.01)
    True
    """
    own = as_controller(law)
    file = own.controller_file
    if not 0.0 <= delay <= 0.2:
        raise ValueError(f"delay must be from 0 to 0.2 s, not {delay:g}")
    if not 0.0 < duration <= 600.0:
        raise ValueError(f"duration must be above 0 and at most 600 s, not {duration:g}")
    for name, value in (("psi0", psi0), ("disturbance", disturbance), ("zero_angle", zero_angle)):
        if not isfinite(value):
            raise ValueError(f"{name} must be a finite angle in rad, not {value}")
    if not callable(reference) and not isfinite(reference):
        raise ValueError(f"reference must be a finite angle in rad or a function of t, not {reference}")
    silence: dict[str, Any] = {} if noise else {"psi_noise_rad": 0.0, "dtheta_noise_rad_s": 0.0, "encoder_counts": 0}
    wanted = reference if callable(reference) else lambda _t: reference
    scenario = Scenario(
        duration_s=duration,
        psi0_rad=psi0,
        period_s=file.sample_time_s,
        angle_offset_rad=zero_angle,
        disturbance_rad=disturbance,
        disturbance_at_s=0.0,
        reference=wanted,
        seed=seed,
        **picture_timing(delay, file.sample_time_s),  # type: ignore[arg-type]
        **silence,
    )
    plant = as_model(model).plant
    true = LinearPlant(plant) if linear else plant
    made = closed(file, own.model.plant, true, scenario, believe=disturbance != 0.0)
    return ClosedLoop(made, own.name, file.limits.torque_nm)
