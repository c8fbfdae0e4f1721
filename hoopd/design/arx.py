"""From recorded torques and outputs to a law: least-squares ARX model, then LQG on it.

Rules of this file: offline only; rows are ticks, outputs are (dtheta, psi) as they arrived in that tick, so that the
model holds the delays of board and camera; torque u_k is sent in tick k and first seen in tick k + 1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.core.controllers import LinearGains
from hoopd.design.lqg import kalman_gain, lqr
from hoopd.design.weights import Weights

Array = NDArray[Any]

OUTPUTS = 2
# What acts on the hoop beside the torque that was sent, per tick.
DISTURBANCE_NM = 0.05
SMALLEST_NOISE = 1e-12  # keeps the Riccati equation solvable for the states that are only past values


class ArxModel(NamedTuple):
    """y_k = sum_i A_i y_k-i + sum_j B_j u_k-j + e_k."""

    a: Array  # (na, 2, 2)
    b: Array  # (nb, 2)
    covariance: Array  # (2, 2) of e


def fit_arx(u: Array, y: Array, na: int = 4, nb: int = 6) -> ArxModel:
    """Least squares over the rows whose past is complete (NaN: missing); u (n,) N m, y (n, 2); ValueError: too few,
    or they do not tell the unknowns apart."""
    lag = max(na, nb)
    past_y = [y[lag - i : len(y) - i] for i in range(1, na + 1)]
    past_u = [u[lag - j : len(u) - j, None] for j in range(1, nb + 1)]
    regressors, target = np.hstack(past_y + past_u), y[lag:]
    whole = np.isfinite(regressors).all(axis=1) & np.isfinite(target).all(axis=1)
    unknowns = OUTPUTS * na + nb
    if whole.sum() < 5 * unknowns:
        raise ValueError(f"{int(whole.sum())} complete rows are too few for {unknowns} unknowns an output")
    solution, _, rank, _ = np.linalg.lstsq(regressors[whole], target[whole], rcond=None)
    if rank < unknowns:
        raise ValueError(f"the run tells {rank} of {unknowns} unknowns: the torque or an output hardly moves in it")
    residual = target[whole] - regressors[whole] @ solution
    a = solution[: OUTPUTS * na].reshape(na, OUTPUTS, OUTPUTS).transpose(0, 2, 1)
    return ArxModel(a, solution[OUTPUTS * na :], np.cov(residual.T))


def state_space(model: ArxModel) -> tuple[Array, Array, Array]:
    """a (n, n), b (n,), c (2, n) with state (y_k, ..., y_k-na+1, u_k-1, ..., u_k-nb+1)."""
    na, nb = len(model.a), len(model.b)
    outputs = OUTPUTS * na
    n = outputs + nb - 1
    a, b, c = np.zeros((n, n)), np.zeros(n), np.zeros((OUTPUTS, n))
    a[:OUTPUTS, :outputs] = np.hstack(list(model.a))
    a[:OUTPUTS, outputs:] = model.b[1:].T
    a[OUTPUTS:outputs, : outputs - OUTPUTS] = np.eye(outputs - OUTPUTS)
    b[:OUTPUTS] = model.b[0]
    if nb > 1:
        b[outputs] = 1.0
        a[outputs + 1 :, outputs:-1] = np.eye(nb - 2)
    c[:, :OUTPUTS] = np.eye(OUTPUTS)
    return a, b, c


def arx_lqg(model: ArxModel, weights: Weights, h: float) -> LinearGains:
    """Feedback on an ARX model, and a filter that takes its residual for noise of the outputs and of their sensors.

    By the letter of an ARX model its noise enters with the output alone, M = [I; 0]: the filter believes every sample,
    and of three experiments like the shipped one two end with 17 degrees of phase margin. On a device the residual is
    the sensors' noise as well, and a torque disturbs the hoop: then all three have 54 degrees and 64 ms or more.
    """
    a, b, c = state_space(model)
    rate, noise = np.zeros(len(b)), np.zeros_like(a)
    rate[1], rate[OUTPUTS + 1] = 1.0 / h, -1.0 / h  # dpsi by difference
    noise[:OUTPUTS, :OUTPUTS] = model.covariance
    return linear_lqg(a, b, c, rate, noise, model.covariance, weights, h)


def linear_lqg(
    a: Array, b: Array, c: Array, rate: Array, noise: Array, covariance: Array, weights: Weights, h: float
) -> LinearGains:
    """LQG on a model (a, b, c) of (dtheta, psi); `rate` (n,) gives dpsi of its state, `noise` (n, n) is that of its
    states a tick beside a torque that disturbs the hoop, `covariance` (2, 2) that of its outputs."""
    rows = np.vstack([c[0] / weights.dtheta_rad_s, c[1] / weights.psi_rad, rate / weights.dpsi_rad_s])
    feedback = lqr(a, b[:, None], rows.T @ rows, np.array([[weights.torque_nm**-2]]))[0]
    disturbed = DISTURBANCE_NM**2 * np.outer(b, b) + SMALLEST_NOISE * np.eye(len(b)) + noise
    filter_gain = kalman_gain(a, c, disturbed, covariance)
    return LinearGains(a, b, c, filter_gain, feedback, _feedforward(a, b, c, feedback, h))


def _feedforward(a: Array, b: Array, c: Array, feedback: Array, h: float) -> float:
    """Torque per reference that brings psi nearest to it between 0.3 and 1 s after a step: later the regulated hoop
    speed takes it back, because no torque holds the ball off the bottom at a constant speed of the hoop."""
    x, angle = np.zeros(len(b)), []
    for _ in range(round(1.0 / h)):
        x = a @ x + b * (1.0 - float(feedback @ x))
        angle.append(float(c[1] @ x))
    step = np.array(angle[round(0.3 / h) :])
    return float(step.sum() / (step @ step))
