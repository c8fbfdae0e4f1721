"""From the demanded torque to the torque on the hoop, in the order of the contract: delay, dead zone, limits, ripple
and gain, bias and cogging, lag.

Rules of this file: one function an effect, `(p, torque, theta, dtheta) -> torque`, arrays (B,), p by parameter name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from concealed.contacts import clip
from concealed.plant import Array

Parameters = Mapping[str, Array]
NOMINAL_LIMIT_NM = 0.7


def deadzone(p: Parameters, torque: Array, theta: Array, dtheta: Array) -> Array:
    """u - d sign(u), 0 for abs(u) < d."""
    return np.sign(torque) * np.maximum(np.abs(torque) - p["d"], 0.0)


def saturation(p: Parameters, torque: Array, theta: Array, dtheta: Array) -> Array:
    """abs(tau) <= s."""
    return clip(torque, p["s"])


def back_emf_limit(p: Parameters, torque: Array, theta: Array, dtheta: Array) -> Array:
    """abs(tau) <= max(0, 0.7 (1 - abs(theta')/w0))."""
    limit = NOMINAL_LIMIT_NM * np.maximum(0.0, 1.0 - np.abs(dtheta) / p["w0"])
    return clip(torque, limit)


def ripple(p: Parameters, torque: Array, theta: Array, dtheta: Array) -> Array:
    """u (1 + a sin(n theta + phi))."""
    return torque * (1.0 + p["a"] * np.sin(p["n"] * theta + p["phi"]))


def torque_gain(p: Parameters, torque: Array, theta: Array, dtheta: Array) -> Array:
    """k u."""
    return torque * p["k"]


def torque_bias(p: Parameters, torque: Array, theta: Array, dtheta: Array) -> Array:
    """u + b."""
    return torque + p["b"]


def cogging(p: Parameters, torque: Array, theta: Array, dtheta: Array) -> Array:
    """u + A sin(n theta + phi)."""
    return torque + p["A"] * np.sin(p["n"] * theta + p["phi"])


# The order is the contract's.
MAPS: Mapping[str, Callable[[Parameters, Array, Array, Array], Array]] = {
    "actuator.deadzone": deadzone,
    "actuator.saturation": saturation,
    "actuator.back_emf_limit": back_emf_limit,
    "actuator.ripple": ripple,
    "actuator.torque_gain": torque_gain,
    "actuator.torque_bias": torque_bias,
    "actuator.cogging": cogging,
}


def lag(time_s: Array, torque: Array, state: Array, h: float) -> tuple[Array, Array]:
    """Mean torque over a step of `h` and state after it, of T tau' = torque - tau with `torque` held; T = 0 passes."""
    slow = np.maximum(time_s, 1e-9)
    decay = np.exp(-h / slow)
    after = torque + (state - torque) * decay
    # mean of torque + (state - torque) exp(-t/T) over the step
    return torque + (state - torque) * (1.0 - decay) * slow / h, after


def delay_weights(delay_s: Array, step: int, h: float, sample_s: float) -> tuple[Array, Array]:
    """Mean torque over substep `step` as (1 - w) u[k - n - 1] + w u[k - n]: n (B,) whole samples, w (B,) in 0 to 1."""
    end = (step + 1) * h - delay_s
    back = np.ceil(-end / sample_s - 1e-12).clip(min=0.0)  # the sample in whose hold the substep's end lies
    into = end + back * sample_s  # s since that sample took effect
    return back.astype(np.int64), np.clip(into / h, 0.0, 1.0)
