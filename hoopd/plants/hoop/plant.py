"""The plant with numbers: derivative, simulation from sample to sample, the filter's step, linearisation.

Rules of this file: no equation is written here, only calls. The input is held over a step (zero-order hold). The call
buffers of one `Plant` are shared by its calls: one object belongs to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hoopd.plants.compiled import Call, Matrix, Vector, zero_order_hold
from hoopd.plants.hoop.equations import ExtraForce, lagrangian, rate, runge_kutta, symbols
from hoopd.plants.hoop.parameters import PARAMETER_UNITS, check_parameters

# 20 Runge-Kutta steps a call: any segment up to the tick of 20 ms is integrated at 1 ms or finer.
ADVANCE_STEPS = 20
# The filter's step over 20 ms from (0, 60 rad/s, 0.4 rad, -3 rad/s): 1, 2, 4 and 8 steps miss the converged psi by
# 4.5e-7, 2.4e-8, 1.4e-9 and 8e-11 rad. 2 steps are 1e5 times below the camera's noise (test of step-halving).
FILTER_STEPS = 2


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
        self._rate = Call(ca.Function("rate", [x, u], [ca.densify(f(x, u))]))
        self._jacobians = ca.Function("jacobians", [x, u], [ca.jacobian(f(x, u), x), ca.jacobian(f(x, u), u)])
        self._energy = ca.Function("energy", [x], [self._energy_of(x, u, p)])
        after = runge_kutta(lambda z: f(z, u), x, h, ADVANCE_STEPS)
        self._advance = Call(ca.Function("advance", [x, u, h], [after], {"cse": True}))
        self._step = Call(self._step_function(f, x, u, h, FILTER_STEPS))

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
