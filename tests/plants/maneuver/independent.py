"""Hoop and ball again, written by hand for SciPy: what a plan is checked with shares no equation with the package.

Rolling without slipping: with a = Ro/Rb, r = Ro - Rb the ball turns at w = a theta' + (1 - a) psi'.

    [Ih + Ib a^2        Ib a (1 - a)        ] [theta'']   [tau - bh theta' - bb a^2 (theta' - psi')]
    [Ib a (1 - a)   m r^2 + Ib (1 - a)^2    ] [psi''  ] = [-m g r sin psi + bb a^2 (theta' - psi') ]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Force = Callable[[Array], Array]


def no_force(x: Array) -> Array:
    """On theta and psi."""
    return np.zeros(2)


def accelerations(x: Array, torque: float, p: Mapping[str, float], more: Force = no_force) -> Array:
    a, r = p["Ro"] / p["Rb"], p["Ro"] - p["Rb"]
    coupling = p["Ib"] * a * (1 - a)
    mass = np.array([[p["Ih"] + p["Ib"] * a**2, coupling], [coupling, p["mb"] * r**2 + p["Ib"] * (1 - a) ** 2]])
    roll = p["bb"] * a**2 * (x[1] - x[3])
    force = np.array([torque - p["bh"] * x[1] - roll, -p["mb"] * p["g"] * r * np.sin(x[2]) + roll])
    return np.linalg.solve(mass, force + more(x))


def played(torques: Array, tick_s: float, p: Mapping[str, float], more: Force = no_force) -> Array:
    """States (n + 1, 4) at the edges of the ticks, from rest at the bottom."""

    def rate(t: float, x: Array, torque: float) -> Array:
        theta2, psi2 = accelerations(x, torque, p, more)
        return np.array([x[1], theta2, x[3], psi2])

    x, rows = np.zeros(4), [np.zeros(4)]
    for torque in torques:
        x = solve_ivp(rate, (0.0, tick_s), x, args=(torque,), rtol=1e-10, atol=1e-12, method="DOP853").y[:, -1]
        rows.append(x)
    return np.array(rows)


def contact(x: Array, p: Mapping[str, float]) -> Array:
    """Force between hoop and ball over the ball's weight, of states (n, 4)."""
    return ((p["Ro"] - p["Rb"]) * x[:, 3] ** 2 + p["g"] * np.cos(x[:, 2])) / p["g"]


def grip(x: Array, torque: float, p: Mapping[str, float]) -> float:
    """Friction force of the contact over the normal force, at a state."""
    theta2, psi2 = accelerations(x, torque, p)
    a = p["Ro"] / p["Rb"]
    # the friction turns the ball: Ib w' = Rb f - bb phi'
    turning = p["Ib"] * (a * theta2 + (1 - a) * psi2) + p["bb"] * a * (x[1] - x[3])
    normal = p["mb"] * ((p["Ro"] - p["Rb"]) * x[3] ** 2 + p["g"] * np.cos(x[2]))
    return abs(turning / p["Rb"]) / normal
