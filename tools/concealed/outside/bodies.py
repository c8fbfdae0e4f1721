"""Bodies that nobody sees: a part that is loose within a gap, and one that hangs on a spring.

Rules of this file: a force is `(p, s) -> (on_theta, on_psi, on_roll)` in N m; the body's angle against the hoop and its
own speed are in `s.memory`; drift, kick, drift like the hoop; the hoop feels the opposite of what the body feels.
"""

from __future__ import annotations

import numpy as np

from concealed.forces import Force, Moment, Parameters
from concealed.plant import Array

# The stop of a loose part: a stiff spring, and damping that grows with how far it is pressed in (no jump at a touch).
STOP_RAD_S, STOP_DAMPING_S = 150.0, 0.3
DRAG_S = 2.0  # s: what the loose part's bearing takes to drag it along


def play(p: Parameters, s: Moment) -> Force:
    """A part of inertia J, loose within +-b rad on the hoop: it coasts through the gap and hits the stops.

    J v' = -J w^2 o (1 + 0.3 s abs(o)') at a stop (o: how far into it, never pulled), -J (v - theta')/2 s everywhere.
    Source: M. Nordin, P.-O. Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38 (2002)
    1633-1649; the stop by K. H. Hunt, F. R. E. Crossley, Journal of Applied Mechanics 42 (1975) 440-445.
    """
    return _felt(p, s, "play", _stop(p, s))


def _stop(p: Parameters, s: Moment) -> Array:
    """Acceleration of the loose part (B,) at the middle of the step."""
    gap, slip = _middle(s, "play")
    into = gap - np.minimum(np.maximum(gap, -p["b"]), p["b"])
    closing = np.maximum(1.0 + STOP_DAMPING_S * slip * np.sign(into), 0.0)
    return -(STOP_RAD_S**2) * into * closing - slip / DRAG_S


def appendage(p: Parameters, s: Moment) -> Force:
    """A mass on an elastic arm: J v' = -J (w^2 r + 2 zeta w r'), r its angle against the hoop, r' = v - theta'.

    Source: the dynamic absorber, J. P. Den Hartog, Mechanical Vibrations, 4th edition, McGraw-Hill 1956, chapter 3.
    """
    turned, slip = _middle(s, "appendage")
    return _felt(p, s, "appendage", -(p["w"] ** 2) * turned - 2 * p["zeta"] * p["w"] * slip)


def _middle(s: Moment, name: str) -> tuple[Array, Array]:
    """Angle against the hoop at the middle of the step, and relative speed there."""
    slip = s.memory[f"{name}.speed"] - s.dtheta
    return s.memory[f"{name}.angle"] + s.h / 2 * slip, slip


def _felt(p: Parameters, s: Moment, name: str, acceleration: Array) -> Force:
    """Moves the body and gives what the hoop feels."""
    angle, speed = s.memory[f"{name}.angle"], s.memory[f"{name}.speed"]
    before = speed - s.dtheta
    speed += s.h * acceleration
    angle += s.h / 2 * (before + speed - s.dtheta)
    return -p["J"] * acceleration, 0.0, 0.0
