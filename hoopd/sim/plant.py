"""The plant of the rig: a model moved through time, and the hand that holds it before a release.

Rules of this file: time is an argument and never runs backwards; a segment between two events is integrated in
steps of at most 1 ms.
"""

from __future__ import annotations

from collections.abc import Callable
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from hoopd.core.records import Vector
from hoopd.plants.found_effects import Found, FoundEffect
from hoopd.plants.hoop.plant import HoopPlant

if TYPE_CHECKING:
    from hoopd.sim.hidden import HiddenPlant

# One call of the model integrates at most this long (its sub-steps are then 1 ms).
SEGMENT_S = 0.02


class RigPlant:
    """State over time; `advance(x, u, h)` is the model's integrator."""

    def __init__(
        self,
        advance: Callable[[Vector, float, float], Vector],
        x0: Vector,
        *,
        held: bool = False,
        hold_s: float = 0.0,
        t: float = 0.0,
    ) -> None:
        """`held`: hands hold ball and hoop at x0 until `hold_s` has passed and the drive gives its first torque."""
        self._advance, self._x, self._t = advance, x0.copy(), t
        self._held, self._release_t = held, t + hold_s

    @property
    def t(self) -> float:
        """How far the plant has come, in s."""
        return self._t

    @property
    def state(self) -> tuple[float, float, float, float]:
        """theta, dtheta, psi, dpsi in rad and rad/s."""
        x = self._x
        return (float(x[0]), float(x[1]), float(x[2]), float(x[3]))

    @property
    def shown(self) -> tuple[float, float, float, float]:
        """The state that a picture taken now shows."""
        return self.state

    def sample(self) -> tuple[float, float, float]:
        """theta, dtheta and no current of its own: the board takes torque over torque constant."""
        return (float(self._x[0]), float(self._x[1]), nan)

    def advance(self, t: float, torque_nm: float) -> None:
        """Integrate up to `t` with the torque held."""
        if self._held and torque_nm != 0.0 and self._t >= self._release_t:
            self._held = False
        if self._held:
            self._t = max(t, self._t)
        while t - self._t > 1e-9:
            h = min(t - self._t, SEGMENT_S)
            self._x = self._advance(self._x, torque_nm, h)
            self._t += h


def make_plant(
    structure: str,
    parameters: dict[str, float],
    x0: list[float],
    held: bool = False,
    hold_s: float = 0.0,
    effects: dict[str, dict[str, float]] | None = None,
) -> RigPlant | HiddenPlant:
    """HoopPlant from plain data: what the board's process is told on its command line; effects by name."""
    if effects:
        from hoopd.sim.hidden import HiddenPlant

        entries = tuple(FoundEffect(name, values) for name, values in effects.items())
        return HiddenPlant(Found(structure, parameters, entries), np.array(x0, float), held=held, hold_s=hold_s)
    model = HoopPlant(structure, parameters)
    return RigPlant(model.advance, np.array(x0, float), held=held, hold_s=hold_s)
