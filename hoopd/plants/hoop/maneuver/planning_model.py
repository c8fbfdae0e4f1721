"""The filter's model as a plan needs it: one smooth rate with exact derivatives, a tick's step, the contact's force.

Rules of this file: no equation is written here; what only makes torque or readings late is not part of it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.contact import contact_of
from hoopd.plants.hoop.effects.inner_hoop import INNER_HOOP
from hoopd.plants.hoop.effects.lift_off import LIFT_OFF
from hoopd.plants.hoop.equations import runge_kutta
from hoopd.plants.hoop.loop.writeback import filter_effects, filter_plant
from hoopd.plants.hoop.maneuver.motion_limits import contact_weights, grip_weights
from hoopd.plants.numeric_plant import FILTER_STEPS

# Width of the smooth form of dry friction, rad/s of the rate that it acts against: a hundredth of a loop's speeds.
FRICTION_WIDTH = 0.5


class PlanningModel:
    """The filter's model as a plan needs it: smooth, with exact derivatives."""

    def __init__(self, found: FoundEffects) -> None:
        self.found = filter_effects(found)
        self.structure = found.structure
        self._plant = filter_plant(found)
        self.declared = self.found.plant if self.found else found.plant
        # of a touch after a flight, where the model has it
        self.lift_off = next((one.parameters for one in found.entries if one.name == LIFT_OFF), {})
        self.inner = tuple(one for one in found.entries if one.name == INNER_HOOP)
        self.parameters = {name: ca.SX(value) for name, value in found.base.items()}

    @property
    def hoop_inertia(self) -> float:
        """Of the hoop without its ball, kg m2."""
        p = {name: float(value) for name, value in self.parameters.items()}
        return float(contact_of(self.structure)(self.declared.point(np.zeros(4), p)).theta_inertia)

    @cached_property
    def rate(self) -> ca.Function:
        """(x, u) -> dx/dt."""
        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        return ca.Function("rate", [x, u], [ca.densify(self._plant.smooth_rate(x, u, FRICTION_WIDTH))])

    @cached_property
    def pressed(self) -> ca.Function:
        """(x, u) -> the contact's force and its friction, both in weights of the ball."""
        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        force = contact_weights(self.declared, x, self.parameters)
        friction = grip_weights(self.structure, self.declared, x, self.parameters, self.rate(x, u))
        return ca.Function("pressed", [x, u], [force, friction])

    def step(self, tick_s: float) -> ca.Function:
        """(x, u) -> state after a tick, its derivatives by x and u."""
        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        after = runge_kutta(lambda y: self.rate(y, u), x, ca.SX(tick_s), 2 * FILTER_STEPS)
        parts = [after, ca.jacobian(after, x), ca.jacobian(after, u)]
        return ca.Function("step", [x, u], [ca.densify(one) for one in parts])


def flying_model(model: PlanningModel) -> FoundEffects:
    """The planning model's plant, with a ball that may leave the hoop."""
    found = model.found
    return replace(found, entries=(*found.entries, FoundEffect(LIFT_OFF, model.lift_off), *model.inner))
