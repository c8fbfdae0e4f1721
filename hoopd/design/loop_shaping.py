"""Loop shaping: PI through a point of the Nyquist plane, PID tangent to a circle of constant |T|.

Rules of this file: continuous plants of python-control in, gains out; w in rad/s, angles in degrees, negative
feedback. What a design promises at one frequency is checked over all of them by `peak_complementary`.
The functions have the meaning of `loopshapingPI` and `loopshapingPID` of ControlSystems.jl; the PID is solved in
closed form there where that package bisects.
"""

from __future__ import annotations

from cmath import exp, phase
from math import radians
from typing import Any, NamedTuple, TypeAlias

import control
import numpy as np
from scipy.optimize import minimize_scalar

from hoopd.design.pid import Parallel

Lti: TypeAlias = control.TransferFunction | control.StateSpace


class FrequencyPoint(NamedTuple):
    """A frequency response at one frequency."""

    value: complex  # P(jw)
    slope: complex  # dP/ds at jw


class Peak(NamedTuple):
    """A maximum over frequency."""

    value: float
    w: float  # rad/s


def response_and_slope(plant: Lti, w: float, delay_s: float = 0.0) -> FrequencyPoint:
    """P(jw) e^(-jw delay) and its derivative by s, exact; ValueError for a discrete or a multivariable plant."""
    if plant.isdtime(strict=True) or not plant.issiso():
        raise ValueError("loop shaping takes a continuous plant of one input and one output")
    value, slope = _state_space_point(plant, w) if isinstance(plant, control.StateSpace) else _rational_point(plant, w)
    late = exp(-1j * w * delay_s)
    # (P e^-sT)' = (P' - T P) e^-sT
    return FrequencyPoint(value * late, (slope - delay_s * value) * late)


def loopshaping_pi(
    plant: Lti, w: float, phase_margin_deg: float | None = None, gain: float | None = None, delay_s: float = 0.0
) -> Parallel:
    """PI with which L(jw) = gain e^(j(phase margin - 180)); without one of the two the plant's own is kept.

    c = L(jw)/P(jw), kp = Re c, -ki/w = Im c. Gains may come out negative: no PI of the usual kind turns L there.
    """
    value = response_and_slope(plant, w, delay_s).value
    size = abs(value) if gain is None else gain
    angle = phase(value) if phase_margin_deg is None else radians(phase_margin_deg - 180.0)
    c = size * exp(1j * angle) / value
    return Parallel(c.real, -w * c.imag)


def loopshaping_pid(plant: Lti, w: float, mt: float = 1.3, phi_t: float = 75.0, delay_s: float = 0.0) -> Parallel:
    """PID with which L touches the circle |T| = mt at the frequency w, `phi_t` degrees below the real axis.

    L0 = centre + radius e^(-j phi_t), centre -mt^2/(mt^2 - 1), radius mt/(mt^2 - 1): the touching point
    c = L0/P(jw):              kp = Re c,  kd w - ki/w = Im c
    dL/dw normal to L0 - centre:  Re[conj(L0 - centre) j (P (kd + ki/w^2) + c P')] = 0, linear in kd + ki/w^2
    """
    if not mt > 1.0:
        raise ValueError(f"the largest |T| must be above 1, not {mt:g}: the circle would have no inside")
    value, slope = response_and_slope(plant, w, delay_s)
    radius = mt / (mt**2 - 1.0)
    ray = radius * exp(-1j * radians(phi_t))
    c = (ray - mt * radius) / value
    across = (ray.conjugate() * 1j * value).real
    if abs(across) <= 1e-12 * abs(ray * value):
        raise ValueError("the plant's direction at this frequency leaves kd and ki free: change w or phi_t")
    # c = kp + j (kd w - ki/w)  ->  dc/dw = j (kd + ki/w^2)
    total = -(ray.conjugate() * 1j * c * slope).real / across
    difference = c.imag / w
    return Parallel(c.real, w**2 * (total - difference) / 2.0, (total + difference) / 2.0)


def peak_complementary(plant: Lti, controller: Lti, delay_s: float = 0.0, *, w_low: float = 1e-2) -> Peak:
    """Largest |T(jw)|, T = L/(1 + L), from `w_low` to 1e4 rad/s: the best of a grid, refined between its neighbours."""

    def size(w: Any) -> Any:
        loop = plant(1j * w) * controller(1j * w) * np.exp(-1j * w * delay_s)
        return np.abs(loop / (1.0 + loop))

    grid = np.geomspace(w_low, 1e4, 4000)
    best = int(np.argmax(size(grid)))
    low, high = np.log(grid[max(best - 1, 0)]), np.log(grid[min(best + 1, len(grid) - 1)])
    found = minimize_scalar(lambda x: -size(np.exp(x)), bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    return Peak(float(-found.fun), float(np.exp(found.x)))


def _rational_point(plant: control.TransferFunction, w: float) -> tuple[complex, complex]:
    n, d = np.poly1d(plant.num[0][0]), np.poly1d(plant.den[0][0])
    s = 1j * w
    # (n/d)' = (n' d - n d')/d^2
    return complex(n(s) / d(s)), complex((n.deriv()(s) * d(s) - n(s) * d.deriv()(s)) / d(s) ** 2)


def _state_space_point(plant: control.StateSpace, w: float) -> tuple[complex, complex]:
    resolvent = np.linalg.inv(1j * w * np.eye(plant.nstates) - plant.A)
    # P = C (sI - A)^-1 B + D,  P' = -C (sI - A)^-2 B
    into = resolvent @ plant.B
    return complex((plant.C @ into + plant.D)[0, 0]), complex(-(plant.C @ resolvent @ into)[0, 0])
