"""The plant: a motor-driven hoop with a ball rolling inside, written once in CasADi symbols.

Rules of this file: equations only; no effect of EFFECTS.md is built here, they come as `extra_forces`.
State x = (theta rad, dtheta rad/s, psi rad, dpsi rad/s), input u = torque on the hoop in N m; theta, psi and the
torque turn the same way, psi = 0 at the bottom. The input is held over a step (zero-order hold).

The call buffers of one `Plant` are shared by its calls: one object belongs to one thread.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

KINEMATICS = ("rolling", "published")
STRUCTURES = (*KINEMATICS, "entries")

# Which parameters each structure takes, with their units.
_GEOMETRY = {"mb": "kg", "Ro": "m", "Rb": "m", "g": "m/s^2"}
_LAGRANGIAN = {**_GEOMETRY, "Ib": "kg m^2", "Ih": "kg m^2", "bb": "N m s", "bh": "N m s"}
_ENTRIES = {
    **_GEOMETRY,  # only generalised forces beyond the torque need these
    "J11": "1/s",
    "J12": "1/s",
    "K1": "1/s^2",
    "L1": "1/(kg m^2)",
    "J21": "1/s",
    "J22": "1/s",
    "K2": "1/s^2",
    "L2": "1/(kg m^2)",
}
PARAMETER_UNITS: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "rolling": MappingProxyType(_LAGRANGIAN),
        "published": MappingProxyType(_LAGRANGIAN),
        "entries": MappingProxyType(_ENTRIES),
    }
)
_POSITIVE = frozenset({"mb", "Ro", "Rb", "g", "Ib", "Ih", "L1"})
_NOT_NEGATIVE = frozenset({"bb", "bh"})

# 20 Runge-Kutta steps a call: any segment up to the tick of 20 ms is integrated at 1 ms or finer.
ADVANCE_STEPS = 20
# The filter's step over 20 ms from (0, 60 rad/s, 0.4 rad, -3 rad/s): 1, 2, 4 and 8 steps miss the converged psi by
# 4.5e-7, 2.4e-8, 1.4e-9 and 8e-11 rad. 2 steps are 1e5 times below the camera's noise (test of step-halving).
FILTER_STEPS = 2


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


class ParameterError(ValueError):
    """A parameter is missing, unknown or outside its range; `name` says which."""

    def __init__(self, name: str, reason: str) -> None:
        self.name, self.reason = name, reason
        super().__init__(f"{name}: {reason}")


def check_parameters(structure: str, values: Mapping[str, float], extra: tuple[str, ...] = ()) -> dict[str, float]:
    """The parameters of a structure in their order; ParameterError on a missing, unknown or impossible one."""
    if structure not in STRUCTURES:
        raise ParameterError("structure", f"unknown {structure!r}; known: {', '.join(STRUCTURES)}")
    names = (*PARAMETER_UNITS[structure], *extra)
    for name in values:
        if name not in names:
            raise ParameterError(name, f"not a parameter of the {structure} model; known: {', '.join(names)}")
    for name in names:
        _check_value(name, values.get(name))
    if values["Ro"] <= values["Rb"]:
        raise ParameterError("Rb", f"the ball's rolling radius {values['Rb']} m must be below Ro = {values['Ro']} m")
    return {name: float(values[name]) for name in names}


def _check_value(name: str, value: float | None) -> None:
    if value is None:
        raise ParameterError(name, "missing")
    if not math.isfinite(value):
        raise ParameterError(name, f"must be finite, not {value}")
    if name in _POSITIVE and value <= 0.0:
        raise ParameterError(name, f"must be positive, not {value}")
    if name in _NOT_NEGATIVE and value < 0.0:
        raise ParameterError(name, f"must not be negative, not {value}")


# ---------------------------------------------------------------------------------------------- equations


class Lagrangian(NamedTuple):
    """Energies and dissipation of the device."""

    kinetic: ca.SX  # J
    potential: ca.SX  # J
    dissipation: ca.SX  # W / 2, Rayleigh's function


def lagrangian(kinematics: str, s: Symbols) -> Lagrangian:
    """T, V and D of PHYSICS.md section 2 under one of the two kinematics."""
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


def symbols(x: ca.SX, u: ca.SX, p: Mapping[str, ca.SX]) -> Symbols:
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
    dtheta2, dpsi2 = _MOTIONS[moving](structure, s, force)
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


_MOTIONS = {"both": _both, "hoop": _hoop_alone, "ball": _ball_alone}


def rate_function(
    structure: str, extra_forces: tuple[ExtraForce, ...] = (), extra_parameters: tuple[str, ...] = ()
) -> tuple[ca.Function, tuple[str, ...]]:
    """f(x, u, p) -> dx/dt with the parameters as one symbolic vector, and their names in order (for identification)."""
    names = (*PARAMETER_UNITS[structure], *extra_parameters)
    x, u, p = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("p", len(names))
    named = {name: p[index] for index, name in enumerate(names)}
    return ca.Function("f", [x, u, p], [rate(structure, x, u, named, extra_forces)], ["x", "u", "p"], ["dx"]), names


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


# ---------------------------------------------------------------------------------------------- the object


class _Call:
    """A CasADi function behind preallocated buffers: a call costs a copy and the arithmetic, a few microseconds."""

    def __init__(self, function: ca.Function) -> None:
        self._arguments = [np.zeros(function.size1_in(i)) for i in range(function.n_in())]
        # CasADi is column-major: a matrix is kept as its transpose and handed out as a transposed view
        self._results = [np.zeros((function.size2_out(i), function.size1_out(i))) for i in range(function.n_out())]
        self._buffer, self._trigger = function.buffer()
        for index, array in enumerate(self._arguments):
            self._buffer.set_arg(index, memoryview(array))  # type: ignore[call-arg, arg-type, unused-ignore]
        for index, result in enumerate(self._results):
            self._buffer.set_res(index, memoryview(result))  # type: ignore[call-arg, arg-type, unused-ignore]
        self.x = self._arguments[0]
        self._scalars: list[Any] = [
            memoryview(array)  # type: ignore[arg-type, unused-ignore]
            for array in self._arguments[1:]
        ]  # numpy takes longer for one number
        self._first: Vector = self._results[0][0]

    def vector(self, x: ArrayLike, *scalars: float) -> Vector:
        """First result as a new vector."""
        self.x[:] = x
        for array, value in zip(self._scalars, scalars, strict=True):
            array[0] = value
        self._trigger()
        return self._first.copy()

    def matrix(self, index: int) -> Matrix:
        """Result `index` of the last call as a new matrix."""
        return self._results[index].T.copy()


class Plant:
    """The plant with numbers: derivative, simulation from sample to sample, the filter's step, linearisation."""

    def __init__(
        self,
        structure: str,
        parameters: Mapping[str, float],
        extra_forces: tuple[ExtraForce, ...] = (),
        extra_parameters: tuple[str, ...] = (),
    ) -> None:
        self._structure = structure
        self._parameters = check_parameters(structure, parameters, extra_parameters)
        self._extra = extra_forces
        x, u, h = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("h")
        p = {name: ca.SX(value) for name, value in self._parameters.items()}
        f = ca.Function("f", [x, u], [rate(structure, x, u, p, extra_forces)])
        self._rate = _Call(ca.Function("rate", [x, u], [ca.densify(f(x, u))]))
        self._jacobians = ca.Function("jacobians", [x, u], [ca.jacobian(f(x, u), x), ca.jacobian(f(x, u), u)])
        self._energy = ca.Function("energy", [x], [self._energy_of(x, u, p)])
        after = runge_kutta(lambda z: f(z, u), x, h, ADVANCE_STEPS)
        self._advance = _Call(ca.Function("advance", [x, u, h], [after], {"cse": True}))
        self._step = _Call(self._step_function(f, x, u, h, FILTER_STEPS))

    @property
    def structure(self) -> str:
        """rolling, published or entries."""
        return self._structure

    @property
    def parameters(self) -> Mapping[str, float]:
        """Names and values in SI units (`PARAMETER_UNITS`), read only."""
        return MappingProxyType(self._parameters)

    def derivative(self, x: ArrayLike, u: float) -> Vector:
        """dx/dt (4,)."""
        return self._rate.vector(x, u)

    def advance(self, x: ArrayLike, u: float, h: float) -> Vector:
        """State (4,) after `h` seconds (up to 20 ms: at 1 ms or finer) with the torque `u` held."""
        return self._advance.vector(x, u, h)

    def step_and_jacobian(self, x: ArrayLike, u: float, h: float) -> tuple[Vector, Matrix]:
        """State (4,) after `h` seconds (up to 20 ms) and its derivative by x (4, 4)."""
        after = self._step.vector(x, u, h)
        return after, self._step.matrix(1)

    def linearize(self, x0: ArrayLike = (0.0, 0.0, 0.0, 0.0), u0: float = 0.0) -> tuple[Matrix, Matrix]:
        """A (4, 4), B (4, 1) of dx/dt around a point, exact."""
        a, b = self._jacobians(np.asarray(x0, float), u0)
        return a.full(), b.full()

    def discretize(self, h: float, x0: ArrayLike = (0.0, 0.0, 0.0, 0.0), u0: float = 0.0) -> tuple[Matrix, Matrix]:
        """Ad (4, 4), Bd (4, 1) of the linear model over `h` seconds, input held; exact to rounding."""
        a, b = self.linearize(x0, u0)
        return zero_order_hold(a, b, h)

    def energy(self, x: ArrayLike) -> float:
        """Kinetic plus potential energy in J (Lagrangian structures only)."""
        if self._structure == "entries":
            raise ValueError("the entries of a model without a Lagrangian have no energy")
        return float(self._energy(np.asarray(x, float)))

    def with_parameters(self, **changes: float) -> Plant:
        """The same plant with some parameters changed."""
        extra = tuple(name for name in self._parameters if name not in PARAMETER_UNITS[self._structure])
        return Plant(self._structure, {**self._parameters, **changes}, self._extra, extra)

    def __reduce__(self) -> tuple[type[Plant], tuple[Any, ...]]:
        extra = tuple(name for name in self._parameters if name not in PARAMETER_UNITS[self._structure])
        return Plant, (self._structure, self._parameters, self._extra, extra)

    def _energy_of(self, x: ca.SX, u: ca.SX, p: Mapping[str, ca.SX]) -> ca.SX:
        if self._structure == "entries":
            return ca.SX.nan()
        energy = lagrangian(self._structure, symbols(x, u, p))
        return energy.kinetic + energy.potential

    @staticmethod
    def _step_function(f: ca.Function, x: ca.SX, u: ca.SX, h: ca.SX, steps: int) -> ca.Function:
        after = runge_kutta(lambda z: f(z, u), x, h, steps)
        return ca.Function("step", [x, u, h], [after, ca.densify(ca.jacobian(after, x))], {"cse": True})


def zero_order_hold(a: Matrix, b: Matrix, h: float) -> tuple[Matrix, Matrix]:
    """Ad, Bd of dx/dt = A x + B u held over `h`: exp([[A, B], [0, 0]] h), scaled Taylor series."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a * h, b * h
    # scale until the norm is below 1/8, where 12 terms reach rounding (1/8^13/13! < 1e-21), then square back
    squarings = max(0, math.ceil(math.log2(max(float(np.linalg.norm(block, 1)), 1e-300) * 8)))
    scaled = block / 2**squarings
    term = result = np.eye(n + m)
    for k in range(1, 13):
        term = term @ scaled / k
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result[:n, :n], result[:n, n:]
