"""A plan behind the drive's dead zone: it is searched in the torque that is left, and asked for in the one that is.

    tau = u - d sign(u), 0 for |u| < d    so that    u = tau + d sign(tau),   |u| <= limit  as  |tau| <= limit - d

Within the zone nothing that u does is seen, and a search that begins there (at rest it does) has no slope to follow.
Gains are those of tau: beyond the zone both move alike.

Rules of this file: the dead zone alone, the first of all that a drive makes of a demand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.planning import InfeasibleError

Array = NDArray[np.float64]

DEAD_ZONE = "actuator.deadzone"
# A search's zero, N m: a demand across the whole zone for less would be a rattle that moves nothing.
NO_TORQUE_NM = 1e-6


def dead_zone_nm(found: FoundEffects) -> float:
    """The size d of a model's dead zone, N m; zero without one."""
    return sum(one.parameters["d"] for one in found.believed().entries if one.name == DEAD_ZONE)


def behind_dead_zone(found: FoundEffects) -> FoundEffects:
    """The same model driven by the torque behind its dead zone."""
    return found.only(lambda one: one.name != DEAD_ZONE)


def limits_behind(limits: MotionLimits, dead_nm: float) -> MotionLimits:
    """Limits of a plan in the torque behind a dead zone; InfeasibleError where it leaves nothing."""
    left = limits.torque_nm - dead_nm
    if not left > 0.0:
        reason = f"a dead zone of {dead_nm:g} N m leaves nothing of a torque of {limits.torque_nm:g} N m"
        raise InfeasibleError("torque", dead_nm / limits.torque_nm - 1.0, reason)
    return replace(limits, torque_nm=left)


def demanded_torques(torques: Array, dead_nm: float) -> Array:
    """What to ask for, so that torques (n,) are left behind a dead zone, N m.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.plants.hoop.maneuver.dead_zone import demanded_torques
    >>> demanded_torques(np.array([0.0, 0.25, -0.25]), 0.0625).tolist()
    [0.0, 0.3125, -0.3125]
    """
    return torques + np.where(np.abs(torques) > NO_TORQUE_NM, dead_nm * np.sign(torques), 0.0)
