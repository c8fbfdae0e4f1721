"""What a planned motion of hoop and ball keeps: torque, hoop speed, the contact's force and its grip, with margins.

Rules of this file: formulas of the limits; how a motion is searched stands in `plants.collocation`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import casadi as ca

from hoopd.plants.collocation import PathLimit
from hoopd.plants.declaration import Plant
from hoopd.plants.hoop.contact import contact_of
from hoopd.plants.hoop.effects.normal_force import signed_normal_force
from hoopd.plants.hoop.effects.slip import holding_force


@dataclass(frozen=True)
class MotionLimits:
    """What a plan keeps.

    Attributes
    ----------
    torque_nm : float
        Largest torque, N m; the rest of the drive's is the tracker's.
    hoop_speed_rad_s : float
        Largest speed of the hoop, rad/s.
    contact : float
        Least force between hoop and ball, in weights of the ball: below zero it would fly.
    grip : float
        Friction coefficient that the contact may need, so that the ball rolls; infinite: it always does.
    lacking : float
        Friction, in weights of the ball, that the contact may lack: what is left where its force ends.
    """

    torque_nm: float
    hoop_speed_rad_s: float
    contact: float
    grip: float = inf
    lacking: float = 0.0

    def __post_init__(self) -> None:
        """ValueError for limits that no motion can keep."""
        for name in ("torque_nm", "hoop_speed_rad_s", "grip"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} must be above zero, not {getattr(self, name):g}")
        if not 0.0 <= self.contact < 1.0:
            raise ValueError(f"contact must be from 0 to below 1 (the ball's weight at rest), not {self.contact:g}")


def path_limits(structure: str, plant: Plant, limits: MotionLimits, p: dict[str, Any], rate: Any) -> list[PathLimit]:
    """The groups of a plan.

    Parameters
    ----------
    structure : str
        rolling, published or entries.
    plant : Plant
        The declared plant.
    limits : MotionLimits
        Their sizes.
    p : dict
        Parameters by name, as CasADi numbers.
    rate : casadi.Function
        (x, u) to dx/dt.
    """
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    pressed = contact_weights(plant, x, p)
    groups = {
        "torque": both_ways(u / limits.torque_nm),
        "hoop speed": both_ways(x[1] / limits.hoop_speed_rad_s),
        "contact force": limits.contact - pressed,
    }
    if limits.grip < inf:
        # |f| <= mu N, in weights of the ball
        needed, held = grip_weights(structure, plant, x, p, rate(x, u)), limits.grip * pressed + limits.lacking
        groups["grip"] = ca.vertcat(needed - held, -needed - held)
    return [PathLimit(name, ca.Function("excess", [x, u], [ca.densify(one)])) for name, one in groups.items()]


def contact_weights(plant: Plant, x: Any, p: dict[str, Any]) -> Any:
    """N / (m g) of a state: 1 at rest at the bottom, below 0 in the air."""
    return signed_normal_force(plant.point(x, p)) / (p["mb"] * p["g"])


def grip_weights(structure: str, plant: Plant, x: Any, p: dict[str, Any], dx: Any) -> Any:
    """Friction force of the contact that keeps the ball rolling, over the ball's weight."""
    s = plant.point(x, p)
    accelerations = {"theta": dx[1], "psi": dx[3]}
    # `slip` is a coordinate of the plant that slips; here it rolls
    force = holding_force(s.replaced(dslip=0.0), contact_of(structure)(s), accelerations)
    return force / (p["mb"] * p["g"])


def both_ways(share: Any) -> Any:
    """By how much a share exceeds one, above and below."""
    return ca.vertcat(share - 1.0, -share - 1.0)
