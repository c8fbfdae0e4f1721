"""Friction that the library lacks: presliding, running in, ageing at rest, a ratchet, a loaded bearing, eddy currents.

Rules of this file: `dahl`, `eddy_brake` are forces `(p, s) -> (on_theta, on_psi, on_roll)` in N m; the others are
limits in N m of dry friction against theta', which an impulse may not pass. What is remembered lies in `s.memory`.
"""

from __future__ import annotations

import numpy as np

from concealed.forces import Force, Moment, Parameters
from concealed.plant import Array

AGED_S = 0.1  # of contact: the unit of the logarithm


def mean_decay(x: Array) -> Array:
    """(1 - exp(-x))/x, the mean of exp(-x s) for s in 0 to 1; 1 at x = 0."""
    small = x < 1e-9
    return np.where(small, 1.0, -np.expm1(-x) / np.where(small, 1.0, x))


def dahl(p: Parameters, s: Moment) -> Force:
    """Presliding friction -F y, q y' = theta' - abs(theta') y: full only after a way of some q since the reversal.

    Source: P. R. Dahl, A solid friction model, TOR-0158(3107-18)-1, Aerospace Corporation, 1968.
    """
    y = s.memory["dahl"]
    way = np.abs(s.dtheta) * s.h / p["q"]
    # y -> sign(theta') exponentially in the way; the mean over the step acts
    left = y - np.sign(s.dtheta)
    mean = np.sign(s.dtheta) + left * mean_decay(way)
    y += left * np.expm1(-way)
    return -p["F"] * mean, 0.0, 0.0


def eddy_brake(p: Parameters, s: Moment) -> Force:
    """Eddy-current brake -2 A x/(1 + x^2), x = theta'/w0: drag that is largest at w0 and falls beyond it.

    Source: J. H. Wouterse, Critical torque and speed of eddy current brake with widely separated soft iron poles,
    IEE Proceedings B 138 (1991) 153-158.
    """
    x = s.dtheta / p["w0"]
    return -p["A"] * 2 * x / (1 + x**2), 0.0, 0.0


def running_in(p: Parameters, s: Moment) -> Array:
    """Coulomb friction that wears off, F exp(-E/(F L)) with the dissipated energy E' = F exp(-E/(F L)) abs(theta').

    With the way X it is F/(1 + X/L). Source: wear in proportion to the dissipated energy, J. F. Archard, Contact and
    rubbing of flat surfaces, Journal of Applied Physics 24 (1953) 981-988.
    """
    worn = s.memory["running_in"]  # E/(F L)
    limit = p["F"] * np.exp(-worn)
    # exp(worn) grows by the way/L: exact while the speed is constant
    worn += np.log1p(np.exp(-worn) * np.abs(s.dtheta) * s.h / p["L"])
    return limit


def dwell(p: Parameters, s: Moment) -> Array:
    """Friction that grows with the age of the contact, F log(1 + a/0.1 s), a' = 1 - abs(theta') a/L.

    Source: the ageing law of rate-and-state friction, J. H. Dieterich, Journal of Geophysical Research 84 (1979)
    2161-2168; A. Ruina, same journal 88 (1983) 10359-10370.
    """
    age_s = s.memory["dwell"]
    way = np.abs(s.dtheta) * s.h / p["L"]
    limit = p["F"] * np.log1p(age_s / AGED_S)
    # exact while the speed is constant
    age_s += age_s * np.expm1(-way) + s.h * mean_decay(way)
    return limit


def ratchet(p: Parameters, s: Moment) -> Array:
    """A pawl that drags in one direction and at one place: F max(0, 1 - (d/w)^2) where theta' has its direction, d
    the angle between theta and q.

    Source: a one-sided contact with Coulomb friction, whose normal force is the pawl's spring.
    """
    off = (np.mod(s.theta - p["q"] + np.pi, 2 * np.pi) - np.pi) / p["w"]
    return p["F"] * np.maximum(0.0, 1.0 - off**2) * (s.dtheta * p["direction"] > 0)


def bearing_load(p: Parameters, s: Moment) -> Array:
    """Friction of the hoop's bearing under the load of the ball: F N/(m g), N = m ((Ro-Rb) psi'^2 + g cos psi).

    Source: Coulomb's law with a normal force that turns with the ball: sign(theta') times a function of psi and psi'.
    """
    given = s.device.given
    return p["F"] * s.normal_n / (given["mb"] * given["g"])
