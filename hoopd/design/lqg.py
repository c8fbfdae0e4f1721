"""From a model to the numbers of the default law: linear-quadratic gains, how a reference is held, its loop.

Rules of this file: offline only; what comes out are plain numbers for a controller file.

theta is left out of the state: it is the integral of dtheta, nothing in the plant depends on it, and a weight on it
would wind the hoop back to where it stood. The regulated state is (dtheta, psi, dpsi).
"""

from __future__ import annotations

from typing import Any

import control
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from hoopd.core.controllers import LqgGains
from hoopd.core.estimator import EkfSettings
from hoopd.design.weights import Weights
from hoopd.plants.compiled import zero_order_hold
from hoopd.plants.hoop.plant import HoopPlant

Array = NDArray[Any]

REGULATED = [1, 2, 3]  # dtheta, psi, dpsi


def reduced_model(plant: HoopPlant, h: float) -> tuple[Array, Array]:
    """Ad (3, 3), Bd (3, 1) of (dtheta, psi, dpsi) at rest, input held over `h`."""
    a, b = plant.linearize()
    return zero_order_hold(a[np.ix_(REGULATED, REGULATED)], b[REGULATED], h)


def lqr(a: Array, b: Array, q: Array, r: Array) -> Array:
    """K (m, n) of u = -K x that minimises sum x'Qx + u'Ru: P by the Riccati equation, K = (R + B'PB)^-1 B'PA."""
    p = solve_discrete_are(a, b, q, r)
    return np.asarray(np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a))


def kalman_gain(a: Array, c: Array, q: Array, r: Array) -> Array:
    """Filter gain M (n, p) of x += M (y - C x), stationary: M = P C' (C P C' + R)^-1."""
    p = solve_discrete_are(a.T, c.T, q, r)
    return np.asarray(np.linalg.solve(c @ p @ c.T + r, c @ p).T)


def feedback(plant: HoopPlant, weights: Weights, h: float) -> Array:
    """K (3,) on (dtheta, psi, dpsi)."""
    a, b = reduced_model(plant, h)
    q = np.diag([weights.dtheta_rad_s**-2, weights.psi_rad**-2, weights.dpsi_rad_s**-2])
    gains: Array = lqr(a, b, q, np.array([[weights.torque_nm**-2]]))[0]
    return gains


def hold(plant: HoopPlant) -> dict[str, float]:
    """The four numbers by which a reference is held, see `Lqg`: psi'' = 0 at psi = r solved for the torque.

    psi''   = J21 w + K2 sin r + L2 u = 0      ->  u = -(K2 sin r + J21 w) / L2
    theta'' = J11 w + K1 sin r + L1 u          ->  w' = rate (speed_per_sin sin r - w)
    """
    a, b = plant.linearize()
    k1, k2, l1, l2 = a[1, 2], a[3, 2], b[1, 0], b[3, 0]
    rate = -(a[1, 1] - l1 * a[3, 1] / l2)
    return {
        "torque_per_sin": float(-k2 / l2),
        "torque_per_speed": float(-a[3, 1] / l2),
        "speed_per_sin": float((k1 - l1 * k2 / l2) / rate),
        "hold_rate": float(rate),
    }


def lqg_gains(plant: HoopPlant, weights: Weights, h: float, hoop_speed_limit: float = 30.0) -> LqgGains:
    """Everything that `Lqg` needs."""
    return state_feedback(plant, feedback(plant, weights, h), hoop_speed_limit)


def state_feedback(plant: HoopPlant, k: Array, hoop_speed_limit: float = 30.0) -> LqgGains:
    """Everything that `Lqg` needs, for any K (3,) on (dtheta, psi, dpsi)."""
    k_dtheta, k_psi, k_dpsi = (float(value) for value in k)
    return LqgGains(k_dtheta, k_psi, k_dpsi, **hold(plant), hoop_speed_limit=hoop_speed_limit)


# ---------------------------------------------------------------------------------------------- the loop


def seen_plant(plant: HoopPlant, h: float, delay_ticks: int, torque_ticks: int = 0) -> control.StateSpace:
    """Torque to (dtheta, psi) as a tick sees them: dtheta one tick old, psi `delay_ticks` old.

    State: (dtheta, psi, dpsi)_k, dtheta_k-1 ..., psi_k-1 ... psi_k-d. A torque that arrives `torque_ticks` late is, for
    the loop, a state seen so much later: (dtheta, psi, dpsi) are then those on which this tick's torque will act.
    """
    a, b = reduced_model(plant, h)
    first, second = 1 + torque_ticks, delay_ticks + torque_ticks
    n = 3 + first + second
    big, inp, out = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((2, n))
    big[:3, :3], inp[:3] = a, b
    for begin, count, state in ((3, first, 0), (3 + first, second, 1)):
        for index in range(begin, begin + count):
            big[index, state if index == begin else index - 1] = 1.0
    out[0, 2 + first], out[1, n - 1 if second else 1] = 1.0, 1.0
    return control.ss(big, inp, out, 0, h)


def observer_law(model: control.StateSpace, m: Array, k: Array) -> control.StateSpace:
    """Outputs of `model` to -u, for x += M (y - C x) in the tick of y and u = -K x.

    z_k+1 = (I - M C)(A - B K) z_k + M y_k = x_k,   -u_k = K x_k
    """
    after = (np.eye(model.nstates) - m @ model.C) @ (model.A - model.B @ k)
    return control.ss(after, m, k @ after, k @ m, model.dt)


def lqg_law(
    model: HoopPlant, k: Array, settings: EkfSettings, *, h: float, delay_ticks: int, torque_ticks: int = 0
) -> control.StateSpace:
    """`Lqg` and its filter at rest, from (dtheta, psi) as seen to -u.

    A filter that fuses late samples at their own time is the one on the state with the delays in it: the same
    estimate, one Riccati equation.
    """
    seen = seen_plant(model, h, delay_ticks, torque_ticks)
    q = np.zeros_like(seen.A)
    q[:3, :3] = np.diag(settings.q[1:]) * h
    m = kalman_gain(seen.A, seen.C, q, np.diag([settings.r_dtheta, settings.r_psi]))
    return observer_law(seen, m, np.concatenate([k, np.zeros(seen.nstates - 3)])[None, :])


def lqg_loop(
    true: HoopPlant, model: HoopPlant, k: Array, settings: EkfSettings, *, h: float, delay_ticks: int
) -> control.StateSpace:
    """L(z) of `Lqg` broken at the torque, negative feedback: gains k and filter on `model`, the device is `true`."""
    return lqg_law(model, k, settings, h=h, delay_ticks=delay_ticks) * seen_plant(true, h, delay_ticks)
