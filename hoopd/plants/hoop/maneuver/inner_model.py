"""The planning model of a ball on the inner hoop: one smooth rate, a tick's step, what presses and holds it.

Rules of this file: no equation is written here.
"""

from __future__ import annotations

from functools import cached_property
from math import inf
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.collocation import PathLimit
from hoopd.plants.effects.base import Point
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.contact import contact_of
from hoopd.plants.hoop.effects.contact_modes import INNER, ContactModes
from hoopd.plants.hoop.effects.inner_hoop import RADIUS, inner_contact, inner_normal_force
from hoopd.plants.hoop.equations import runge_kutta
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits, both_ways
from hoopd.plants.hoop.maneuver.planning_model import FRICTION_WIDTH, PlanningModel, flying_model
from hoopd.plants.numeric_plant import FILTER_STEPS
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

# At rest on its top.
TOP = np.array([0.0, 0.0, np.pi, 0.0])


class InnerModel:
    """Hoop and ball while it rolls on the inner hoop."""

    def __init__(self, model: PlanningModel) -> None:
        """ValueError for a model without an inner hoop."""
        self.found: FoundEffects = flying_model(model)
        modes = ContactModes(self.found.plant, self.found.effects())
        if modes.inner is None:
            raise ValueError("the model has no inner hoop: device.inner says its radius")
        self.modes, self.structure = modes, model.structure
        self._composite = modes.hybrid.modes[INNER]
        self._p = {name: ca.SX(value) for name, value in zip(modes.hybrid.names, self.vector, strict=True)}

    @property
    def vector(self) -> Array:
        """Parameters of all modes."""
        return self.modes.hybrid.vector(self.found.values)

    @property
    def track_m(self) -> float:
        """Radius of the path of the ball's centre."""
        return float(self.found.values[RADIUS] + self.found.values["Rb"])

    @property
    def spin_inertia(self) -> float:
        """Of the ball, kg m2."""
        at_rest = self.modes.rolling.plant.point(np.zeros(self.modes.rolling.nx), self.found.values)
        return float(contact_of(self.structure)(at_rest).spin_inertia)

    @cached_property
    def rate(self) -> ca.Function:
        """(x, u) -> dx/dt."""
        return self._rate_with(self._composite)

    @cached_property
    def _feedback_rate(self) -> ca.Function:
        """The same of a ball that rolls freely: at rest the smooth form of its dry friction is a damping that no ball
        has, on which a law that holds it on the top would rely."""
        c, contact = self._composite, self.modes.through_contact
        free = [one for one in c.effects if one.name not in contact]
        return self._rate_with(Composite(c.declared, free))

    def _rate_with(self, composite: Composite) -> ca.Function:
        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        rate = composite.smooth_rate_expression(x, u, 0.0, self._p, FRICTION_WIDTH)
        return ca.Function("rate", [x, u], [ca.densify(rate)])

    def step(self, tick_s: float) -> ca.Function:
        """(x, u) -> state after a tick, its derivatives by x and u, for feedback."""
        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        after = runge_kutta(lambda y: self._feedback_rate(y, u), x, ca.SX(tick_s), 2 * FILTER_STEPS)
        return ca.Function(
            "step", [x, u], [ca.densify(one) for one in (after, ca.jacobian(after, x), ca.jacobian(after, u))]
        )

    @cached_property
    def pressed(self) -> ca.Function:
        """(x, u) -> the contact's force and its friction, both in weights of the ball."""
        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        return ca.Function("pressed", [x, u], [self._weights(x), self._grip(x, u)])

    def limits(self, kept: MotionLimits) -> list[PathLimit]:
        """The groups of a plan."""
        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        force = self._weights(x)
        groups = {
            "torque": both_ways(u / kept.torque_nm),
            "hoop speed": both_ways(x[1] / kept.hoop_speed_rad_s),
            "contact force": kept.contact - force,
        }
        if kept.grip < inf:
            needed = self._grip(x, u)
            groups["grip"] = ca.vertcat(needed - kept.grip * force, -needed - kept.grip * force)
        return [PathLimit(name, ca.Function("excess", [x, u], [ca.densify(one)])) for name, one in groups.items()]

    def _weights(self, x: Any) -> Any:
        """N / (m g)."""
        return inner_normal_force(self._point(x)) / (self._p["mb"] * self._p["g"])

    def _grip(self, x: Any, u: Any) -> Any:
        """Friction that keeps the ball rolling, over its weight: Ib w' = -Rb f - bb phi'."""
        s, p, dx = self._point(x), self._p, self.rate(x, u)
        c = inner_contact(contact_of(self.structure))(s)
        turning = c.spin_inertia * (c.by_theta * dx[1] + c.by_psi * dx[3])
        rolling = c.damping * p[RADIUS] / p["Rb"] * (s.dpsi - s.dtheta)
        return -(turning + rolling) / p["Rb"] / (p["mb"] * p["g"])

    def _point(self, x: Any) -> Point:
        return self._composite.plant.point(x, self._p)
