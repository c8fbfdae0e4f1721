"""The flight of a throw: from the hoop, over the axis, to the hoop on the other side, in the ball's own plane.

A ball leaves where the normal force ends, R psi'^2 = -g cos psi: where it leaves says how fast, how long it flies, and
where it lands. What drive and hoop do in the air changes none of it; only how fast the hoop turns when the ball comes.

Rules of this file: geometry of one flight, and what its landing asks of the hoop; nothing is searched but one number.
"""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin, sqrt, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Where a flight over the axis begins, from the highest to the lowest: beyond the first it hardly leaves the hoop, below
# the last the ball falls back on the side that it came from.
HIGHEST_RAD, LOWEST_RAD = pi / 2 + 1.45, pi / 2 + 0.65
BISECTIONS = 60


class PlannedFlight(NamedTuple):
    """A flight of one turning sense (psi rises).

    Attributes
    ----------
    off_rad, off_rad_s : float
        The ball's angle and speed where it leaves the hoop.
    seconds : float
        Until it touches the hoop again.
    on_rad, on_rad_s : float
        Angle where it lands, and its speed along the hoop there, as an angle's.
    across_m_s : float
        Its speed across the hoop where it lands.
    """

    off_rad: float
    off_rad_s: float
    seconds: float
    on_rad: float
    on_rad_s: float
    across_m_s: float


def flight_from(off_rad: float, track_m: float, gravity_m_s2: float) -> PlannedFlight:
    """The flight that begins at an angle.

    Parameters
    ----------
    off_rad : float
        Between `LOWEST_RAD` and `HIGHEST_RAD`.
    track_m, gravity_m_s2 : float
        Ro - Rb, and g.

    Notes
    -----
    A parabola that leaves a circle as the circle's own curve bends meets it again at a known place: of the four angles
    at which it meets the circle three are the same, and all four add up to a whole turn (angles from the horizontal).

    Examples
    --------
    >>> flight = flight_from(pi / 2 + 1.0, 0.085, 9.81)
    >>> round(flight.seconds, 3), round(flight.on_rad / pi, 3)
    (0.185, 1.545)
    """
    rate = sqrt(-gravity_m_s2 * cos(off_rad) / track_m)
    # phi_on = -3 phi_off with phi = psi - pi/2
    on_rad = pi / 2 - 3.0 * (off_rad - pi / 2) + tau
    across, up = track_m * rate * cos(off_rad), track_m * rate * sin(off_rad)
    seconds = track_m * (sin(on_rad) - sin(off_rad)) / across
    fallen = up - gravity_m_s2 * seconds
    along = across * cos(on_rad) + fallen * sin(on_rad)
    return PlannedFlight(off_rad, rate, seconds, on_rad, along / track_m, across * sin(on_rad) - fallen * cos(on_rad))


def flight_of(seconds: float, track_m: float, gravity_m_s2: float) -> PlannedFlight:
    """The flight that takes so long; ValueError where none does."""
    low, high = LOWEST_RAD, HIGHEST_RAD
    longest, shortest = (flight_from(one, track_m, gravity_m_s2).seconds for one in (low, high))
    if not shortest < seconds < longest:
        raise ValueError(f"a flight takes {shortest:.3f} to {longest:.3f} s in this hoop, not {seconds:g}")
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        if flight_from(middle, track_m, gravity_m_s2).seconds > seconds:
            low = middle
        else:
            high = middle
    return flight_from(low, track_m, gravity_m_s2)


def seen_from_the_axis(flight: PlannedFlight, times: Array, track_m: float, gravity_m_s2: float) -> Array:
    """Direction (rad), its rate (rad/s) and distance in shares of the track, (n, 3), at times of a flight."""
    across0, up0 = track_m * sin(flight.off_rad), -track_m * cos(flight.off_rad)
    speed, lift = (track_m * flight.off_rad_s * one for one in (cos(flight.off_rad), sin(flight.off_rad)))
    rows, before = [], flight.off_rad
    for t in np.asarray(times, float):
        x, y = across0 + speed * t, up0 + lift * t - gravity_m_s2 * t * t / 2
        angle = atan2(x, -y)
        before = angle + tau * round((before - angle) / tau)
        # psi' = (x' (-y) + x y') / r^2
        rate = (-speed * y + x * (lift - gravity_m_s2 * t)) / (x * x + y * y)
        rows.append((before, rate, hypot(x, y) / track_m))
    return np.array(rows)
