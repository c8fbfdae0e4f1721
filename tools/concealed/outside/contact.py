"""What depends on where ball and hoop touch: in coordinates that are sums of what is measured, or turns of the ball.

Rules of this file: a force is `(p, s) -> (on_theta, on_psi, on_roll)` in N m; what has a potential has it written over
it and gives the forces on both coordinates, so that energy is kept.
"""

from __future__ import annotations

import numpy as np

from concealed.forces import Force, Moment, Parameters
from concealed.plant import Array


def bouc_wen(p: Parameters, s: Moment) -> Force:
    """Hysteresis of the O-rings under the rolling ball: -F z against phi', q z' = r' - (r' + abs(r') sign z)/2 z^2,
    r = theta - psi.

    Source: Y. K. Wen, Method for random vibration of hysteretic systems, Journal of the Engineering Mechanics Division
    ASCE 102 (1976) 249-263, with n = 2, beta = gamma = 1/2.
    """
    z = s.memory["bouc_wen"]
    before = z.copy()
    z[...] = _hysteresis(z, (s.dtheta - s.dpsi) * s.h / p["q"])
    return 0.0, 0.0, -p["F"] * (before + z) / 2


def _hysteresis(z: Array, way: Array) -> Array:
    """z after a way (B,) in one direction, exact: a straight line to 0, then dz = (1 - z^2) dr."""
    back, ahead = np.where(way < 0, -1.0, 1.0), np.abs(way)
    z = back * z
    straight = np.minimum(np.maximum(-z, 0.0), ahead)
    rise = np.tanh(ahead - straight)
    z = z + straight
    return back * np.where(ahead > straight, (z + rise) / (1 + z * rise), z)


def flat_spot(p: Parameters, s: Moment) -> Force:
    """A flat on the ball, which lies lower on it: V = -A exp((cos(phi - q) - 1)/w^2), phi = (Ro/Rb)(theta - psi) the
    contact's place on the ball.

    Source: a conservative force in the ball's own turning; A is m g times the height that is missing.
    """
    off = s.device.ratio * (s.theta - s.psi) - p["q"]
    # -dV/dphi
    return 0.0, 0.0, -p["A"] * np.sin(off) / p["w"] ** 2 * np.exp((np.cos(off) - 1) / p["w"] ** 2)


def magnet(p: Parameters, s: Moment) -> Force:
    """A magnetic spot on the hoop: V = -A exp((cos(psi - theta - q) - 1)/w^2), felt when the ball passes it.

    Source: a conservative force between ball and hoop in their relative angle.
    """
    off = s.psi - s.theta - p["q"]
    pull = -p["A"] * np.sin(off) / p["w"] ** 2 * np.exp((np.cos(off) - 1) / p["w"] ** 2)
    return -pull, pull, 0.0


def rim_magnets(p: Parameters, s: Moment) -> Force:
    """n magnetised places around the hoop: V = -A cos(n (psi - theta) - q).

    Source: a conservative force between ball and hoop in their relative angle, as of the poles of a machine.
    """
    pull = -p["A"] * p["n"] * np.sin(p["n"] * (s.psi - s.theta) - p["q"])
    return -pull, pull, 0.0


def wobble(p: Parameters, s: Moment) -> Force:
    """A hoop skew on its shaft: the lowest point moves with theta, V = -m g (Ro-Rb) cos(psi - e), e = d cos(theta - q).

    Source: gravity in a track that is tilted by an angle which turns with the hoop; exact in V, the track's own motion
    of d theta' left out of the kinetic energy.
    """
    e = p["d"] * np.cos(s.theta - p["q"])
    pull = -s.device.weight * np.sin(s.psi - e)
    # on theta: -dV/de de/dtheta
    return pull * p["d"] * np.sin(s.theta - p["q"]), pull + s.device.weight * np.sin(s.psi), 0.0
