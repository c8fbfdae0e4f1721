"""Between continuous and sampled time, in both directions.

Rules of this file: python-control's systems in and out; sample times in s. `control.c2d` does what it can; written
here is what it lacks, the way back (`d2c`). Which method: a controller goes by Tustin, a plant under a hold by zoh.
"""

from __future__ import annotations

from math import tan
from typing import TypeAlias

import control
import numpy as np
from scipy.linalg import logm

from hoopd.ident.transfer_functions import transfer_function

Lti: TypeAlias = control.TransferFunction | control.StateSpace

METHODS = ("tustin", "zoh", "matched")


def c2d(system: Lti, h: float, method: str = "tustin", prewarp_w: float | None = None) -> Lti:
    """C(z) of C(s) over `h` seconds by one of METHODS; `prewarp_w`: the frequency at which Tustin is exact."""
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}; known: {', '.join(METHODS)}")
    if isinstance(system, control.TransferFunction) and len(system.num[0][0]) > len(system.den[0][0]):
        raise ValueError("more zeros than poles: filter the derivative first")
    warp = {"prewarp_frequency": prewarp_w} if method == "tustin" and prewarp_w else {}
    return control.c2d(system, h, method=method, **warp)


def d2c(system: Lti, method: str = "zoh", prewarp_w: float | None = None) -> Lti:
    """C(s) whose `c2d` is C(z), by "zoh" or "tustin"; ValueError when no real system has these samples.

    zoh     [[A, B], [0, I]] = exp([[a, b], [0, 0]] h), solved by the matrix logarithm (no pole at or left of 0)
    tustin  s = g (z - 1)/(z + 1), g = 2/h or w/tan(w h/2) (no pole at -1)
    """
    # True is discrete without a sample time
    if isinstance(system.dt, bool) or not system.dt or system.dt < 0.0:
        raise ValueError("needs a discrete system with a sample time")
    ss = control.ss(system)
    if method == "zoh":
        result = _from_held(ss)
    elif method == "tustin":
        result = _from_tustin(ss, prewarp_w)
    else:
        raise ValueError(f"unknown method {method!r}; known: zoh, tustin")
    return transfer_function(result) if isinstance(system, control.TransferFunction) else result


def _from_held(ss: control.StateSpace) -> control.StateSpace:
    n, m = ss.B.shape
    poles = np.linalg.eigvals(ss.A)
    bad = [z for z in poles if abs(z.imag) <= 1e-12 and z.real <= 1e-12]
    if bad:
        raise ValueError(f"pole {bad[0].real:g} at or left of 0: no real continuous system has it under a hold")
    block = np.block([[ss.A, ss.B], [np.zeros((m, n)), np.eye(m)]])
    rate = np.real(logm(block)) / ss.dt
    return control.ss(rate[:n, :n], rate[:n, n:], ss.C, ss.D)


def _from_tustin(ss: control.StateSpace, prewarp_w: float | None) -> control.StateSpace:
    g = prewarp_w / tan(prewarp_w * ss.dt / 2.0) if prewarp_w else 2.0 / ss.dt
    plus = np.eye(ss.nstates) + ss.A
    if np.linalg.cond(plus) > 1e12:
        raise ValueError("pole at -1: Tustin has no way back")
    inverse = np.linalg.inv(plus)
    # z = (g + s)/(g - s):  a = g (I + A)^-1 (A - I), b = (I + A)^-1 B, c = 2 g C (I + A)^-1, d = D - C (I + A)^-1 B
    a = g * inverse @ (ss.A - np.eye(ss.nstates))
    return control.ss(a, inverse @ ss.B, 2.0 * g * ss.C @ inverse, ss.D - ss.C @ inverse @ ss.B)
