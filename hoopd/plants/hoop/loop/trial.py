"""A controller file on trial: the closed loop on the nonlinear plant, and what it shows.

Rules of this file: seeded; the law, its filter and its limits are made from the file's content as the daemon makes
them, so that what is judged here is what runs there.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, isfinite, radians
from typing import Any, NamedTuple

import numpy as np

from hoopd.core.estimator import DelayedEkf
from hoopd.files.controller import ControllerFile, controller_of, limiter_of, settings_of
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.loop.closed_loop import (
    WIRE_S,
    ClosedLoopRun,
    LateTorque,
    LinearPlant,
    Moving,
    Scenario,
    picture_timing,
    simulate,
)
from hoopd.plants.hoop.loop.writeback import delays_of, estimator_with, feedforward_of, filter_plant
from hoopd.plants.hoop.plant import HoopPlant

# When the loop is at rest: the ball within 3 degrees, the hoop slower than a turn in six seconds.
BALL_RAD, HOOP_RAD_S = 0.05, 1.0
ZERO_ANGLE_ERROR_RAD = radians(1.0)
OPEN_GATE = 1e12  # the filter's gate would refuse one impossible sample, and nothing would be seen of the law
LAST_S = 1.0  # what counts as the end of a run


class Trial(NamedTuple):
    """Runs of one law."""

    disturbed: (
        ClosedLoopRun  # one picture's angle is wrong by the disturbance (the thesis's test), the filter believes it
    )
    disturbed_linear: ClosedLoopRun  # the same on the linear model
    released: ClosedLoopRun  # the ball let go at the same angle
    released_linear: ClosedLoopRun
    wrong_zero: ClosedLoopRun  # the camera's zero is one degree off


def trial(
    file: ControllerFile,
    plant: HoopPlant,
    disturbance_rad: float,
    delay_s: float,
    duration_s: float = 6.0,
    found: FoundEffects | None = None,
) -> Trial:
    """The runs of a controller file on the plant, with pictures `delay_s` old, noise, quantisation and limits.

    With effects beside the plant the nonlinear runs have them, known to filter and feed-forward as in the daemon; the
    linear ones have their delays.
    """
    found = found or FoundEffects(plant.structure, plant.parameters)
    base = Scenario(
        duration_s=duration_s,
        period_s=file.sample_time_s,
        latency_s=delays_of(found).camera_s,
        **picture_timing(delay_s, file.sample_time_s),  # type: ignore[arg-type]
    )
    disturbed = replace(base, disturbance_rad=disturbance_rad, disturbance_at_s=0.0)
    released = replace(base, psi0_rad=disturbance_rad)
    wrong = replace(base, duration_s=3 * duration_s, angle_offset_rad=ZERO_ANGLE_ERROR_RAD)
    linear, late = LinearPlant(plant), found.only(lambda effect: not effect.acts_now and effect.sensor is None)
    acting = found.only(lambda effect: effect.shift is None and effect.sensor is None)
    true = filter_plant(found) if found else plant
    return Trial(
        run(file, plant, true, disturbed, believe=True, known=acting),
        run(file, plant, linear, disturbed, believe=True, known=late),
        run(file, plant, true, released, known=acting),
        run(file, plant, linear, released, known=late),
        run(file, plant, true, wrong, known=acting),
    )


def run(
    file: ControllerFile,
    model: HoopPlant,
    true: Moving,
    scenario: Scenario,
    *,
    believe: bool = False,
    known: FoundEffects | None = None,
) -> ClosedLoopRun:
    """One run of a controller file whose filter knows `model`; `believe`: the filter refuses no picture; `known`:
    effects beside the model that filter and feed-forward know, and whose delays there are."""
    settings = settings_of(file)
    settings = replace(settings, gate_nis=OPEN_GATE) if believe else settings
    if not known:
        estimator = DelayedEkf(model.step_and_jacobian, settings)
        return simulate(true, controller_of(file), estimator, limiter_of(file), scenario)
    limiter, delay_s = limiter_of(file), delays_of(known).torque_s
    forward = feedforward_of(
        known,
        limiter.torque_nm,
        tick_s=scenario.period_s,
        wire_s=WIRE_S,
        speed_noise_rad_s=settings.r_dtheta**0.5,
    )
    return simulate(
        LateTorque(true, delay_s) if delay_s > 0.0 else true,
        controller_of(file),
        estimator_with(known, settings),
        limiter,
        scenario,
        feedforward=forward,
    )


def figures_of(made: ClosedLoopRun, limit_nm: float) -> dict[str, Any]:
    """What a run shows, in SI units; None: not within the run."""
    end = made.t > made.t[-1] - LAST_S
    return {
        "largest_psi_rad": float(np.abs(made.psi).max()),
        "psi_settled_s": _within(made.settled_s(made.psi, BALL_RAD)),
        "hoop_settled_s": _within(made.settled_s(made.dtheta, HOOP_RAD_S)),
        "largest_torque_nm": float(np.abs(made.u).max()),
        "torque_at_limit": float((np.abs(made.u) >= limit_nm * (1 - 1e-9)).mean()),
        "end_torque_std_nm": float(made.u[end].std()),
        "end_hoop_speed_rad_s": float(made.dtheta[end].mean()),
        "end_psi_rad": float(made.psi[end].mean()),
    }


def at_rest(made: ClosedLoopRun) -> bool:
    """The ball is at rest before the run ends."""
    return isfinite(made.settled_s(made.psi, BALL_RAD))


def nonlinear_difference(made: ClosedLoopRun, linear: ClosedLoopRun) -> float:
    """Largest difference of psi between the nonlinear and the linear run, in rad."""
    return float(np.abs(made.psi - linear.psi).max())


def _within(time_s: float) -> float | None:
    return None if time_s == inf else time_s
