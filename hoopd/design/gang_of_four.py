"""The gang of four: what a loop does to its reference, to torque disturbances and to the noise of its angle.

Rules of this file: frequency responses and plain numbers, formed point by point, so that nothing has to cancel.
python-control's `gangof4_response` (0.10) is not used: it evaluates a sampled loop at z = jw instead of e^(jwh).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.design.response import frequency_grid, response

Array = NDArray[Any]

NOISE_POINTS = 4096
SLOWEST_RAD_S = 0.05  # a tenth of the hoop's own mode


class GangOfFour(NamedTuple):
    """Complex responses over w in rad/s."""

    w: Array
    sensitivity: Array  # S = 1/(1 + L)
    complementary: Array  # T = L/(1 + L)
    load: Array  # P S: ball angle per torque disturbance, rad/(N m)
    noise: Array  # C S: torque per noise of the ball angle, N m/rad


def gang_of_four(
    plant: control.StateSpace,
    controller: control.StateSpace,
    loop: control.StateSpace | None = None,
    w: Array | None = None,
) -> GangOfFour:
    """Of plant P and controller C in negative feedback; a loop with more measurements than this one names its L."""
    grid = frequencies(plant, controller) if w is None else w
    p, c = response(plant, grid), response(controller, grid)
    value = p * c if loop is None else response(loop, grid)
    s = 1.0 / (1.0 + value)
    return GangOfFour(grid, s, value * s, p * s, c * s)


def frequencies(plant: control.StateSpace, controller: control.StateSpace) -> Array:
    """Frequencies in rad/s, from SLOWEST_RAD_S up, that miss no resonance of either."""
    grid = np.union1d(frequency_grid(plant), frequency_grid(controller))
    end = np.pi / plant.dt * (1.0 - 1e-9) if plant.isdtime(strict=True) else np.inf
    return grid[(grid >= SLOWEST_RAD_S) & (grid <= end)]


def peaks(gang: GangOfFour) -> dict[str, float]:
    """Largest values over the grid, by name."""
    return {name: float(np.abs(values).max()) for name, values in gang._asdict().items() if name != "w"}


def nyquist_gain(controller: control.StateSpace) -> float:
    """|C| at the Nyquist frequency of a sampled controller, N m/rad: what the fastest noise is multiplied with."""
    return float(abs(response(controller, np.pi / controller.dt)))


def noise_gain(
    plant: control.StateSpace, controller: control.StateSpace, loop: control.StateSpace | None = None
) -> float:
    """Standard deviation of the torque per standard deviation of white noise on the ball angle, N m/rad.

    sqrt(mean |C S|^2) over the frequencies up to Nyquist.
    """
    step = np.pi / controller.dt / NOISE_POINTS
    grid = (np.arange(NOISE_POINTS) + 0.5) * step
    return float(np.sqrt(np.mean(np.abs(gang_of_four(plant, controller, loop, grid).noise) ** 2)))
