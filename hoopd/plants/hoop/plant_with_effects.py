"""The plant with found effects and all numbers: what `Plant` is, for a model file that names missing physics.

State (theta, dtheta, psi, dpsi); the torque of a call is what is demanded of the drive. Delays, lags and sensors are
not part of it (`writeback`), nor what depends on a time of its own.

Rules of this file: equations come from `composite`; the call buffers of one object belong to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.compiled import Call, zero_order_hold
from hoopd.plants.composite import Composite
from hoopd.plants.effects.base import Effect
from hoopd.plants.found_effects import Found
from hoopd.plants.hoop.plant import FILTER_STEPS

Array = NDArray[np.float64]

# Longest step of `advance`: dry friction is met within it.
ADVANCE_S = 0.001
# Steps of the filter's 20 ms where a force comes back more than `MANY` times a turn: 12 times at 8 rad/s are 1 rad in
# one of two steps, a Runge-Kutta error below 1 %.
MANY, HARMONIC_FILTER_STEPS = 12.0, 4


def acts_now(effect: Effect) -> bool:
    """A force, a friction, a map of the torque or a lean that depends on where the plant is, and on nothing else."""
    acts = effect.force or effect.friction or effect.torque or effect.shift
    return acts is not None and effect.plant is None and "t" not in effect.depends_on


class EffectPlant:
    """The interface of `Plant`, with effects that act now (`acts_now`)."""

    def __init__(self, found: Found) -> None:
        if not all(map(acts_now, found.effects())):
            raise ValueError(f"not all of {', '.join(found.names)} act on the state alone")
        effects = found.effects()
        steps = HARMONIC_FILTER_STEPS if _most_a_turn(found, effects) > MANY else FILTER_STEPS
        self.found, self.structure, self.parameters = found, found.structure, dict(found.base)
        self._step = Call(_step(found, effects, steps, jacobian=True))
        self._fine = Call(_step(found, effects, 1, jacobian=False))
        self._smooth = _linear(found, effects)

    def advance(self, x: ArrayLike, u: float, h: float) -> Array:
        """State (4,) after `h` seconds, at 1 ms or finer, with the demanded torque `u` held."""
        steps = max(1, int(np.ceil(h / ADVANCE_S - 1e-9)))
        after = np.asarray(x, float)
        for _ in range(steps):
            after = self._fine.vector(after, u, h / steps)
        return after

    def step_and_jacobian(self, x: ArrayLike, u: float, h: float) -> tuple[Array, Array]:
        """State (4,) after `h` seconds (up to 20 ms) and its derivative by x (4, 4)."""
        after = self._step.vector(x, u, h)
        return after, self._step.matrix(1)

    def derivative(self, x: ArrayLike, u: float) -> Array:
        """dx/dt (4,) without dry friction."""
        return np.asarray(self._smooth(np.asarray(x, float), u)[0]).ravel()

    def linearize(self, x0: ArrayLike = (0.0, 0.0, 0.0, 0.0), u0: float = 0.0) -> tuple[Array, Array]:
        """A (4, 4), B (4, 1) of dx/dt around a point, exact, without dry friction."""
        _, a, b = self._smooth(np.asarray(x0, float), u0)
        return a.full(), b.full()

    def discretize(self, h: float, x0: ArrayLike = (0.0, 0.0, 0.0, 0.0), u0: float = 0.0) -> tuple[Array, Array]:
        """Ad (4, 4), Bd (4, 1) of the linear model over `h` seconds, input held."""
        return zero_order_hold(*self.linearize(x0, u0), h)


def _most_a_turn(found: Found, effects: tuple[Effect, ...]) -> float:
    """How often the finest of them comes back in a turn."""
    values = found.values
    return max((values.get(e.key(one.name), 0.0) for e in effects for one in e.parameters if one.discrete), default=0.0)


def composite_of(found: Found, effects: tuple[Effect, ...], substeps: int | None = None) -> Composite:
    """The declared plant with these effects."""
    return Composite(found.plant, effects, substeps)


def numbers(composite: Composite, values: Mapping[str, float]) -> dict[str, ca.SX]:
    """Parameters of a composite as constants."""
    return {name: ca.SX(value) for name, value in zip(composite.names, composite.vector(values), strict=True)}


def _step(found: Found, effects: tuple[Effect, ...], substeps: int, *, jacobian: bool) -> ca.Function:
    """(x, u, h) -> x after, and its derivative."""
    c = composite_of(found, effects, substeps)
    x, u, h = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("h")
    after = c.step_expression(x, [u] * substeps, ca.SX.zeros(c.nw), h, 0.0, numbers(c, found.values))
    results = [ca.densify(after)] + ([ca.densify(ca.jacobian(after, x))] if jacobian else [])
    return ca.Function("step", [x, u, h], results, {"cse": True})


def _linear(found: Found, effects: tuple[Effect, ...]) -> ca.Function:
    """(x, u) -> dx/dt, A, B, with dry friction left out."""
    c = composite_of(found, tuple(one for one in effects if one.friction is None))
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    rate = c.rate_expression(x, u, 0.0, numbers(c, found.values))
    parts = [rate, ca.jacobian(rate, x), ca.jacobian(rate, u)]
    return ca.Function("linear", [x, u], [ca.densify(one) for one in parts])
