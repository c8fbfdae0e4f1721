"""Forces that the plain device lacks: smooth ones, dry ones, and those that no table knows.

Rules of this file: one function an effect; a force is `(p, s) -> (on_theta, on_psi, on_roll)` in N m, arrays (B,) or 0;
`on_roll` is conjugate to the rolling rate. Dry friction is a limit that an impulse may not pass.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from concealed.plant import Array, Body

Parameters = Mapping[str, Array]
Force = tuple[Array | float, Array | float, Array | float]


@dataclass
class Moment:
    """What a force may depend on, at the middle of a substep, arrays (B,)."""

    t: Array | float  # s since the recording's first sample, never negative
    theta: Array
    dtheta: Array
    psi: Array
    dpsi: Array
    torque: Array  # demanded, N m
    device: Body
    memory: dict[str, Array]  # of forces that remember
    h: float  # s

    @property
    def rolling(self) -> Array:
        """phi' = (Ro/Rb)(theta' - psi'), rad/s."""
        return self.device.ratio * (self.dtheta - self.dpsi)

    @property
    def normal_n(self) -> Array:
        """N = m ((Ro-Rb) psi'^2 + g cos psi), never negative."""
        p = self.device.given
        return p["mb"] * np.maximum((p["Ro"] - p["Rb"]) * self.dpsi**2 + p["g"] * np.cos(self.psi), 0.0)


def hoop_quadratic_drag(p: Parameters, s: Moment) -> Force:
    """-c theta' abs(theta') on the hoop."""
    return -p["c"] * s.dtheta * np.abs(s.dtheta), 0.0, 0.0


def imbalance(p: Parameters, s: Moment) -> Force:
    """-A sin(theta + phi) on the hoop."""
    return -p["A"] * np.sin(s.theta + p["phi"]), 0.0, 0.0


def friction_drift(p: Parameters, s: Moment) -> Force:
    """Viscous coefficient bh (1 + a (1 - exp(-t/T)))."""
    return -s.device.bh * p["a"] * -np.expm1(-s.t / p["T"]) * s.dtheta, 0.0, 0.0


def ball_quadratic_drag(p: Parameters, s: Moment) -> Force:
    """-c psi' abs(psi') on psi."""
    return 0.0, -p["c"] * s.dpsi * np.abs(s.dpsi), 0.0


def tilt(p: Parameters, s: Moment) -> Force:
    """Gravity turned: -m g (Ro-Rb) sin(psi - d)."""
    return 0.0, s.device.weight * (np.sin(s.psi) - np.sin(s.psi - p["d"])), 0.0


def vibration(p: Parameters, s: Moment) -> Force:
    """Base acceleration A sin(w t + phi): m (Ro-Rb) A cos psi on psi."""
    lever = s.device.weight / s.device.given["g"]
    return 0.0, lever * p["A"] * np.sin(p["w"] * s.t + p["phi"]) * np.cos(s.psi), 0.0


def disturbance(p: Parameters, s: Moment) -> Force:
    """A on the hoop from t0 to t1."""
    return p["A"] * ((s.t >= p["t0"]) & (s.t < p["t1"])), 0.0, 0.0


def hand(p: Parameters, s: Moment) -> Force:
    """A person's push on the ball: half a sine of size A from t0 to t1."""
    into = (s.t - p["t0"]) / (p["t1"] - p["t0"])
    return 0.0, p["A"] * np.sin(np.pi * np.clip(into, 0.0, 1.0)), 0.0


def drive_off(p: Parameters, s: Moment) -> Force:
    """Start-up: until t1 the drive ignores what it is told."""
    return -s.torque * (s.t < p["t1"]), 0.0, 0.0


def detent(p: Parameters, s: Moment) -> Force:
    """A magnet pulls the hoop to the angle q, felt within the width w only."""
    off = (np.mod(s.theta - p["q"] + np.pi, 2 * np.pi) - np.pi) / p["w"]
    return -p["A"] * off * np.exp(0.5 - 0.5 * off**2), 0.0, 0.0


def reversal_loss(p: Parameters, s: Moment) -> Force:
    """After a change of the torque's sign a share a of it is lost, until the hoop has turned by about q rad."""
    turned, before = s.memory["turned"], s.memory["torque"]
    turned[...] = np.where(np.sign(s.torque) != np.sign(before), 0.0, turned + np.abs(s.dtheta) * s.h)
    before[...] = s.torque
    return -p["a"] * s.torque * np.exp(-turned / p["q"]), 0.0, 0.0


def angle_friction(p: Parameters, s: Moment) -> Force:
    """Rolling friction that grows with psi^2: -c psi^2 phi'."""
    return 0.0, 0.0, -p["c"] * s.psi**2 * s.rolling


def heating(p: Parameters, s: Moment) -> Force:
    """Viscous friction that grows with the heat of the last T seconds: -c E theta', T E' = theta'^2 - E."""
    heat = s.memory["heat"]
    heat += s.h / p["T"] * (s.dtheta**2 - heat)
    return -p["c"] * heat * s.dtheta, 0.0, 0.0


def cable(p: Parameters, s: Moment) -> Force:
    """A cable wound up with the hoop: a cubic spring -k ((theta - q)/10 rad)^3."""
    return -p["k"] * ((s.theta - p["q"]) / 10.0) ** 3, 0.0, 0.0


def track(p: Parameters, s: Moment) -> Force:
    """A track that is no circle: m g (Ro-Rb) k psi^3 on psi."""
    return 0.0, -s.device.weight * p["k"] * s.psi**3, 0.0


FORCES: Mapping[str, Callable[[Parameters, Moment], Force]] = {
    "hoop.quadratic_drag": hoop_quadratic_drag,
    "hoop.imbalance": imbalance,
    "hoop.friction_drift": friction_drift,
    "ball.quadratic_drag": ball_quadratic_drag,
    "frame.tilt": tilt,
    "frame.vibration": vibration,
    "external.disturbance": disturbance,
    "decoy.hand": hand,
    "decoy.drive_off": drive_off,
    "unknown.detent": detent,
    "unknown.reversal_loss": reversal_loss,
    "unknown.angle_friction": angle_friction,
    "unknown.heating": heating,
    "unknown.cable": cable,
    "unknown.track": track,
}


def coulomb(p: Parameters, s: Moment) -> Array:
    """Fc."""
    return p["Fc"]


def stribeck(p: Parameters, s: Moment) -> Array:
    """Fc + Fs exp(-(theta'/vs)^2)."""
    return p["Fc"] + p["Fs"] * np.exp(-((s.dtheta / p["vs"]) ** 2))


def rolling_resistance(p: Parameters, s: Moment) -> Array:
    """r N."""
    return p["r"] * s.normal_n


# Limits in N m of dry friction against theta' and against phi'.
ON_HOOP: Mapping[str, Callable[[Parameters, Moment], Array]] = {
    "hoop.coulomb_friction": coulomb,
    "hoop.stribeck_friction": stribeck,
}
ON_ROLL: Mapping[str, Callable[[Parameters, Moment], Array]] = {
    "ball.coulomb_friction": coulomb,
    "ball.rolling_resistance": rolling_resistance,
}
