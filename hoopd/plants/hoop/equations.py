"""The equations of motion: a motor-driven hoop with a ball rolling inside, written once in CasADi symbols.

Rules of this file: equations only; what a model may leave out is not built here, it comes as `extra_forces`.
State x = (theta rad, dtheta rad/s, psi rad, dpsi rad/s), input u = torque on the hoop in N m; theta, psi and the
torque turn the same way, psi = 0 at the bottom.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import casadi as ca


class Symbols(NamedTuple):
    """What an extra force may depend on: state, input and parameters, all symbols or constants."""

    theta: ca.SX
    dtheta: ca.SX
    psi: ca.SX
    dpsi: ca.SX
    u: ca.SX
    p: Mapping[str, ca.SX]


# A generalised force (on theta, on psi) in N m.
ExtraForce = Callable[[Symbols], tuple[Any, Any]]


class Lagrangian(NamedTuple):
    """Energies and dissipation of the device."""

    kinetic: ca.SX  # J
    potential: ca.SX  # J
    dissipation: ca.SX  # W / 2, Rayleigh's function


def lagrangian(kinematics: str, s: Symbols) -> Lagrangian:
    """T, V and D of the device (docs/explanations/fit_physics.md) under one of the two kinematics."""
    p = s.p
    rolling_radius = p["Ro"] - p["Rb"]
    # phi' = (Ro/Rb)(theta' - psi'): rate of the ball against the line to its contact point
    dphi = p["Ro"] / p["Rb"] * (s.dtheta - s.dpsi)
    # w = phi' + psi' is rolling without slipping, Rb w = Ro theta' - (Ro-Rb) psi'; the papers have w = phi' + theta'
    w = dphi + (s.dpsi if kinematics == "rolling" else s.dtheta)
    # T = m v^2/2 + Ib w^2/2 + Ih theta'^2/2, v = (Ro-Rb) psi'
    kinetic = (p["mb"] * (rolling_radius * s.dpsi) ** 2 + p["Ib"] * w**2 + p["Ih"] * s.dtheta**2) / 2
    # V = -m g (Ro-Rb) cos psi
    potential = -p["mb"] * p["g"] * rolling_radius * ca.cos(s.psi)
    # D = bb phi'^2/2 + bh theta'^2/2
    dissipation = (p["bb"] * dphi**2 + p["bh"] * s.dtheta**2) / 2
    return Lagrangian(kinetic, potential, dissipation)


def equations_of_motion(kinematics: str, s: Symbols, force: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Mass matrix M (2, 2) and right-hand side r (2,) of M q'' = r, by Euler-Lagrange."""
    energy = lagrangian(kinematics, s)
    q, dq = ca.vertcat(s.theta, s.psi), ca.vertcat(s.dtheta, s.dpsi)
    lagrange = energy.kinetic - energy.potential
    # d/dt dL/dq' - dL/dq + dD/dq' = Q   with   d/dt dL/dq' = M q'' + d(dL/dq')/dq q'
    momentum = ca.gradient(lagrange, dq)
    mass = ca.jacobian(momentum, dq)
    rhs = (
        force + ca.gradient(lagrange, q) - ca.gradient(energy.dissipation, dq) - ca.mtimes(ca.jacobian(momentum, q), dq)
    )
    return mass, rhs


def _inverse(m: ca.SX) -> ca.SX:
    """Inverse of a symmetric (2, 2) matrix."""
    det = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    return ca.vertcat(ca.horzcat(m[1, 1], -m[0, 1]), ca.horzcat(-m[1, 0], m[0, 0])) / det


def mobility(structure: str, s: Symbols) -> ca.SX:
    """(2, 2) accelerations per generalised force, M^-1; for `entries` [[L1, L2], [L2, -K2/(m g (Ro-Rb))]]."""
    p = s.p
    if structure == "entries":
        corner = -p["K2"] / (p["mb"] * p["g"] * (p["Ro"] - p["Rb"]))
        return ca.vertcat(ca.horzcat(p["L1"], p["L2"]), ca.horzcat(p["L2"], corner))
    mass, _ = equations_of_motion(structure, s, ca.SX.zeros(2))
    return _inverse(mass)


def accelerations(structure: str, s: Symbols, force: ca.SX) -> ca.SX:
    """(theta'', psi'') under a generalised force (2,), which includes the torque on theta."""
    p = s.p
    if structure == "entries":
        # theta'' = J11 theta' + J12 psi' + K1 sin psi + (mobility Q)_1, psi'' alike
        own = ca.vertcat(
            p["J11"] * s.dtheta + p["J12"] * s.dpsi + p["K1"] * ca.sin(s.psi),
            p["J21"] * s.dtheta + p["J22"] * s.dpsi + p["K2"] * ca.sin(s.psi),
        )
        return own + ca.mtimes(mobility(structure, s), force)
    mass, rhs = equations_of_motion(structure, s, force)
    return ca.mtimes(_inverse(mass), rhs)


def symbols(x: Any, u: ca.SX, p: Mapping[str, ca.SX]) -> Symbols:
    """Named view of a state (4,), an input and the parameters."""
    return Symbols(x[0], x[1], x[2], x[3], u, p)


def rate(
    structure: str,
    x: ca.SX,
    u: ca.SX,
    p: Mapping[str, ca.SX],
    extra_forces: tuple[ExtraForce, ...] = (),
    moving: str = "both",
) -> ca.SX:
    """dx/dt (4,) as an expression; `p` maps names to symbols or constants.

    `moving`: both, `hoop` (there is no ball) or `ball` (the hoop is held).
    """
    # the Euler-Lagrange derivatives need symbols of their own: the state may be an expression or a number
    z = ca.SX.sym("z", 4)
    s = symbols(z, u, p)
    force = ca.vertcat(u, 0)
    for extra in extra_forces:
        force += ca.vertcat(*extra(s))
    dtheta2, dpsi2 = MOTIONS[moving](structure, s, force)
    return ca.substitute(ca.vertcat(z[1], dtheta2, z[3], dpsi2), z, x)


def _both(structure: str, s: Symbols, force: ca.SX) -> tuple[ca.SX, ca.SX]:
    acceleration = accelerations(structure, s, force)
    return acceleration[0], acceleration[1]


def _hoop_alone(structure: str, s: Symbols, force: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Without the ball: its mass, inertia and friction leave the equations; entries are then the bare hoop's."""
    if structure == "entries":
        return s.p["J11"] * s.dtheta + s.p["L1"] * force[0], ca.SX(0)
    return (force[0] - s.p["bh"] * s.dtheta) / s.p["Ih"], ca.SX(0)


def _ball_alone(structure: str, s: Symbols, force: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The hoop held at rest: whoever holds it brings the torque r that makes theta'' = 0."""
    free, push = accelerations(structure, s, force), mobility(structure, s)
    # 0 = theta''_free + (M^-1)_11 r,   psi'' = psi''_free + (M^-1)_21 r
    return ca.SX(0), ca.substitute(free[1] - push[1, 0] / push[0, 0] * free[0], s.dtheta, ca.SX(0))


MOTIONS = {"both": _both, "hoop": _hoop_alone, "ball": _ball_alone}


def runge_kutta(f: Callable[[ca.SX], ca.SX], x: ca.SX, h: ca.SX, steps: int) -> ca.SX:
    """State after `h` seconds by `steps` classical Runge-Kutta steps of fourth order."""
    d = h / steps
    for _ in range(steps):
        k1 = f(x)
        k2 = f(x + d / 2 * k1)
        k3 = f(x + d / 2 * k2)
        k4 = f(x + d * k3)
        x = x + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def without_ball(structure: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """Parameters of the hoop alone: a ball so light that it moves nothing (`entries`: one that acts on nothing)."""
    if structure == "entries":
        return {**parameters, "J12": 0.0, "K1": 0.0}
    return {**parameters, **{name: 1e-9 * parameters[name] for name in ("mb", "Ib", "bb")}}
