"""Feedback along a planned motion: a linear-quadratic regulator whose gains follow the plan, tick by tick.

    u_k = u*_k - K_k (x_k - x*_k),   K_k = (R + B'PB)^-1 B'PA,   P_k = Q + A'P(A - BK)

from the end backwards; behind the end the regulator of the bottom goes on, so that P begins with its own.

Rules of this file: mathematics of the gains; who plays them is `core.tracker`.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Ticks of the bottom's regulator until its P no longer changes: ten of its slowest time constants.
SETTLING_TICKS = 1500


@dataclass(frozen=True)
class TrackingWeights:
    """Deviations from the plan that cost the same (Bryson's rule); the hoop's own angle costs nothing."""

    dtheta_rad_s: float = 6.0
    psi_rad: float = 0.15
    dpsi_rad_s: float = 1.5
    torque_nm: float = 0.08

    @property
    def q(self) -> Array:
        """(4, 4) of the state."""
        return np.diag([0.0, self.dtheta_rad_s**-2, self.psi_rad**-2, self.dpsi_rad_s**-2])

    @property
    def r(self) -> float:
        """Of the torque."""
        return self.torque_nm**-2


def tracking_gains(
    step: ca.Function, states: Array, inputs: Array, weights: TrackingWeights, rest: Array | None = None
) -> Array:
    """Gains along a motion.

    Parameters
    ----------
    step : casadi.Function
        (x, u) to the state after a tick and its derivatives by x (4, 4) and u (4, 1).
    states : ndarray, shape (n + 1, 4)
        At the edges of the ticks: theta, dtheta, psi, dpsi.
    inputs : ndarray, shape (n,)
        Torques, N m.
    weights : TrackingWeights
        What costs how much.
    rest : ndarray, shape (4,), optional
        Where the regulator goes on behind the end; the bottom without.

    Returns
    -------
    ndarray, shape (n, 4)
        N m per rad and per rad/s; of theta zero.
    """
    p, _ = resting_gains(step, np.zeros(4) if rest is None else rest, weights)
    gains = np.zeros((len(inputs), 4))
    for k in range(len(inputs) - 1, -1, -1):
        _, a, b = (one.full() for one in step(states[k], inputs[k]))
        p, gains[k] = _backwards(p, a, b, weights)
    gains[:, 0] = 0.0  # where an effect follows the angle, the plan does not know where it begins
    return gains


def resting_gains(step: ca.Function, rest: Array, weights: TrackingWeights) -> tuple[Array, Array]:
    """P (4, 4) and gains (4,) of the regulator of a state at rest, stable or not; `step` as of `tracking_gains`."""
    _, a, b = (one.full() for one in step(rest, 0.0))
    # the hoop's angle does not act on anything here, so that P has no share of it
    p, gains = weights.q, np.zeros(4)
    for _ in range(SETTLING_TICKS):
        p, gains = _backwards(p, a, b, weights)
    return p, gains


def hoop_gain(inertia: float, tick_s: float, weights: TrackingWeights) -> float:
    """Gain on the speed of a hoop whose ball is in the air, N m per rad/s: theta'' = u / I for good.

    Examples
    --------
    >>> round(hoop_gain(1.5e-3, 0.02, TrackingWeights()), 4)
    0.0122
    """
    # 0 = q - p^2 b^2 / (r + p b^2),  K = p b / (r + p b^2)
    b, q = tick_s / inertia, weights.dtheta_rad_s**-2
    p = (q + (q * q + 4.0 * q * weights.r / b**2) ** 0.5) / 2.0
    return float(p * b / (weights.r + p * b * b))


def _backwards(p: Array, a: Array, b: Array, weights: TrackingWeights) -> tuple[Array, Array]:
    """P a tick earlier, and the gains (4,) of that tick."""
    k = (b.T @ p @ a) / (weights.r + float((b.T @ p @ b)[0, 0]))
    before = weights.q + a.T @ p @ (a - b @ k)
    return (before + before.T) / 2.0, k[0]
