"""PI and PID: the three ways to write the gains, their transfer functions with the derivative filtered.

Rules of this file: python-control's transfer functions in and out; the controller acts on the error in negative
feedback; gains are in the units of output per input (N m/rad here), times in s.

    parallel   C(s) = kp + ki/s + kd s
    standard   C(s) = kp (1 + 1/(ti s) + td s)
    series     C(s) = kc (1 + 1/(ti s)) (1 + td s)
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

import control


class Parallel(NamedTuple):
    """kp + ki/s + kd s."""

    kp: float
    ki: float = 0.0
    kd: float = 0.0


class Standard(NamedTuple):
    """kp (1 + 1/(ti s) + td s); ti infinite: no integral action."""

    kp: float
    ti: float = inf
    td: float = 0.0


class Series(NamedTuple):
    """kc (1 + 1/(ti s)) (1 + td s), ti not below td."""

    kc: float
    ti: float = inf
    td: float = 0.0


Gains = Parallel | Standard | Series


def to_parallel(gains: Gains) -> Parallel:
    """The same controller with parallel gains: ki = kp/ti, kd = kp td."""
    if isinstance(gains, Parallel):
        return gains
    kp, ti, td = to_standard(gains)
    return Parallel(kp, kp / ti, kp * td)


def to_standard(gains: Gains) -> Standard:
    """The same controller in standard form; ValueError without a proportional part, which that form needs."""
    if isinstance(gains, Standard):
        return gains
    if isinstance(gains, Parallel):
        kp, ki, kd = gains
        if kp == 0.0:
            raise ValueError("a controller without proportional part has no standard form")
        return Standard(kp, kp / ki if ki else inf, kd / kp)
    kc, ti, td = gains
    # kc (1 + 1/(ti s))(1 + td s) = kc (1 + td/ti) + kc/(ti s) + kc td s
    ratio = 1.0 + td / ti
    return Standard(kc * ratio, ti * ratio, td / ratio)


def to_series(gains: Gains) -> Series:
    """The same controller in series form; ValueError when its zeros are not real (ti < 4 td)."""
    if isinstance(gains, Series):
        return gains
    kp, ti, td = to_standard(gains)
    if ti == inf:
        return Series(kp, inf, td)
    if ti < 4.0 * td:
        raise ValueError(f"complex zeros (ti {ti:g} s below 4 td = {4 * td:g} s): no series form")
    # ti_s + td_s = ti, ti_s td_s = ti td, the larger one integrates
    ti_series = (ti + sqrt(ti * (ti - 4.0 * td))) / 2.0
    return Series(kp * ti_series / ti, ti_series, ti - ti_series)


def pid(gains: Gains, filter_s: float = 0.0, order: int = 1) -> control.TransferFunction:
    """C(s) of the gains with a noise filter of time constant `filter_s` (0: none, improper with a derivative).

    order 1   the derivative alone, kd s/(1 + s Tf); Tf = td/N with N 2 to 20 (Astrom, Hagglund, Advanced PID, 3.3)
    order 2   the whole controller, 1/(1 + s Tf + (s Tf)^2/2), as `pid` of ControlSystems.jl
    """
    kp, ki, kd = to_parallel(gains)
    if filter_s < 0.0 or order not in (1, 2):
        raise ValueError("a noise filter has a time constant of 0 s or more, and order 1 or 2")
    if order == 2:
        filtering = control.tf([1.0], [filter_s**2 / 2.0, filter_s, 1.0] if filter_s else [1.0])
        return _pi_d([kd, kp, ki]) * filtering
    # kp + ki/s + kd s/(1 + s Tf) over the common denominator s (1 + s Tf)
    if ki:
        return control.tf([kd + kp * filter_s, kp + ki * filter_s, ki], [filter_s, 1.0, 0.0])
    return control.tf([kd + kp * filter_s, kp], [filter_s, 1.0])


def _pi_d(numerator: list[float]) -> control.TransferFunction:
    """(kd s^2 + kp s + ki)/s, without the integrator when ki is 0."""
    return control.tf(numerator, [1.0, 0.0]) if numerator[-1] else control.tf(numerator[:-1], [1.0])


def pid_two_degrees(
    gains: Gains, b: float = 1.0, c: float = 0.0, filter_s: float = 0.0
) -> tuple[control.TransferFunction, control.TransferFunction]:
    """(Cr, Cy) of u = Cr r - Cy y: the reference enters with weights `b` (proportional) and `c` (derivative).

    u = kp (b r - y) + ki/s (r - y) + kd s/(1 + s Tf) (c r - y)   (Astrom, Hagglund, Advanced PID, 3.4)
    """
    kp, ki, kd = to_parallel(gains)
    return pid(Parallel(b * kp, ki, c * kd), filter_s), pid(gains, filter_s)
