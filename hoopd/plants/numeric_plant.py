"""A plant with numbers, with or without effects: derivative, state from sample to sample, the filter's step, linear
models.

The state is that of `plant_with_effects` (the plant's own, then what lags); inputs are a number where there is one,
else a sequence. Delays, latencies and sensors are not part of it: they are the free run's.

Rules of this file: no equation is written here, only calls. Inputs are held over a step (zero-order hold). The call
buffers of one object are shared by its calls: one object belongs to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from hoopd.plants.compiled import Call, Matrix, Vector, zero_order_hold
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.integration_step import USUAL_S, HoldingForces
from hoopd.plants.plant_with_effects import LONGEST_STEP_S, Composite

# Runge-Kutta steps a call of `advance`: up to the plant's usual sample time (20 ms), integrated at a 20th or finer.
ADVANCE_STEPS = 20
# The hoop's filter over 20 ms from (0, 60 rad/s, 0.4 rad, -3 rad/s): 1, 2, 4 and 8 steps miss the converged psi by
# 4.5e-7, 2.4e-8, 1.4e-9 and 8e-11 rad. 2 steps are 1e5 times below the camera's noise (test of step-halving).
FILTER_STEPS = 2
# Steps of the filter's 20 ms where a force comes back more than `MANY` times a turn: 12 times at 8 rad/s are 1 rad in
# one of two steps, a Runge-Kutta error below 1 %.
MANY, HARMONIC_FILTER_STEPS = 12.0, 4


class FilterStep:
    """State after h seconds and its derivative by the state, of a plant at its time zero."""

    def __init__(self, call: Call, state: Call, *, timed: bool) -> None:
        """`state`: as `call`, without the derivative."""
        self._call, self._state, self._rest = call, state, (0.0,) if timed else ()

    def __call__(self, x: Vector, u: float, h: float) -> tuple[Vector, Matrix]:
        """As `NumericPlant.step_and_jacobian`."""
        after = self._call.vector(x, u, h, *self._rest)
        return after, self._call.matrix(1)

    def ahead(self, x: Vector, u: float, h: float) -> Vector:
        """The state alone, of the same bits."""
        return self._state.vector(x, u, h, *self._rest)


class NumericPlant:
    """A plant with numbers.

    Parameters
    ----------
    plant
        Any declared plant.
    effects
        What it has beside its equations; the empty set adds no operation.
    values
        Parameters by name; what is not named is nominal (of an effect: neutral).
    advance_steps
        Runge-Kutta steps in one call of `advance`; fewer make a call shorter, not its steps longer.

    Examples
    --------
    A tank of 2 m2 that 0.1 m3/s fills for ten seconds:

    >>> from hoopd.plants.declaration import Input
    >>> tank = Plant(
    ...     "tank", first_order=("level",), rates=lambda s: s.inflow / s.p["A"], values={"A": 2.0},
    ...     inputs=(Input("inflow", "m3/s"),), time_scale_s=10.0,
    ... )
    >>> NumericPlant(tank).advance([1.0], 0.1, 10.0).round(9).tolist()
    [1.5]
    """

    def __init__(
        self,
        plant: Plant,
        effects: Sequence[Effect] = (),
        values: Mapping[str, float] | None = None,
        *,
        advance_steps: int = ADVANCE_STEPS,
    ) -> None:
        self._plant, self._effects, self._values = plant, tuple(effects), dict(values or {})
        # a drive without effects gives what it is asked for: the limit is the controller's
        self._limited = any(one.torque is not None or one.lag is not None for one in self._effects)
        self._advance_steps = advance_steps
        self._longest_s = LONGEST_STEP_S * (plant.time_scale_s / USUAL_S) * advance_steps / ADVANCE_STEPS

    def prepare(self) -> None:
        """Makes all functions now, for who has no time later."""
        assert self._step and self._advance and self._rate

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the plant's own states."""
        return self._smooth.plant.states

    @property
    def sticks(self) -> bool:
        """Whether dry friction may hold it."""
        return any(one.friction is not None for one in self._effects)

    def derivative(self, x: ArrayLike, u: Any = 0.0, t: float = 0.0) -> Vector:
        """dx/dt of the plant's own states, without dry friction."""
        return self._rate.vector(x, u, t) if self._timed else self._rate.vector(x, u)

    def advance(self, x: ArrayLike, u: Any, h: float, t: float = 0.0) -> Vector:
        """State after `h` seconds with the input `u` held, at a 20th of the usual sample time or finer."""
        if h > self._longest_s:
            pieces = int(np.ceil(h / self._longest_s - 1e-9))
            for index in range(pieces):
                x = self.advance(x, u, min(h / pieces, self._longest_s), t + index * h / pieces)
            return np.asarray(x)
        return self._advance.vector(x, u, h, t) if self._timed else self._advance.vector(x, u, h)

    def step_and_jacobian(self, x: ArrayLike, u: Any, h: float, t: float = 0.0) -> tuple[Vector, Matrix]:
        """State after `h` seconds (up to the usual sample time) and its derivative by x, in which the force of a dry
        friction that holds is taken as given: what the model does not know may move what rests."""
        after = self._step.vector(x, u, h, t) if self._timed else self._step.vector(x, u, h)
        return after, self._step.matrix(1)

    @property
    def filter_step(self) -> FilterStep:
        """`step_and_jacobian` without the plant: what a filter needs, and what goes to another process."""
        return FilterStep(self._step, self._ahead, timed=self._timed)

    def smooth_rate(self, x: Any, u: Any, width: float) -> Any:
        """dx/dt of the plant's own states as an expression, dry friction smoothed over `width` of its rate."""
        c = self._composite(1)
        return c.smooth_rate_expression(x, u, 0.0, self._numbers(c), width)

    def linearize(self, x0: ArrayLike | None = None, u0: Any = 0.0, t: float = 0.0) -> tuple[Matrix, Matrix]:
        """A (n, n), B (n, inputs) of dx/dt around a point (zero without one), exact, without dry friction."""
        start = np.zeros(len(self.states)) if x0 is None else np.asarray(x0, float)
        a, b = self._linear[1](start, u0, t) if self._timed else self._linear[1](start, u0)
        return a.full(), b.full()

    def discretize(self, h: float, x0: ArrayLike | None = None, u0: Any = 0.0, t: float = 0.0) -> tuple[Matrix, Matrix]:
        """Ad (n, n), Bd (n, inputs) of the linear model over `h` seconds, input held; exact to rounding."""
        return zero_order_hold(*self.linearize(x0, u0, t), h)

    def energy(self, x: ArrayLike) -> float:
        """Kinetic plus potential energy, J; ValueError for a plant that declares none."""
        if self._energy is None:
            raise ValueError(f"{self._plant.name}: the plant declares no energy")
        return float(self._energy(np.asarray(x, float)))

    # ------------------------------------------------------------------------------------------ functions

    def _most_a_turn(self) -> float:
        """How often the finest of the effects comes back in a turn."""
        discrete = ((e, one.name) for e in self._effects for one in e.parameters if one.discrete)
        return max((self._values.get(e.key(name), 0.0) for e, name in discrete), default=0.0)

    @cached_property
    def _smooth(self) -> Composite:
        """Without dry friction."""
        effects = tuple(one for one in self._effects if one.friction is None)
        return Composite(self._plant, effects, limited=self._limited, numbers=self._all_values)

    @cached_property
    def _step(self) -> Call:
        return Call(self._stepped("step", self._filter_steps, jacobian=True))

    @cached_property
    def _ahead(self) -> Call:
        return Call(self._stepped("ahead", self._filter_steps, jacobian=False))

    @property
    def _filter_steps(self) -> int:
        return HARMONIC_FILTER_STEPS if self._most_a_turn() > MANY else FILTER_STEPS

    @cached_property
    def _advance(self) -> Call:
        return Call(self._stepped("advance", self._advance_steps, jacobian=False))

    @cached_property
    def _rate(self) -> Call:
        return Call(self._linear[0])

    @cached_property
    def _timed(self) -> bool:
        """Whether equations or effects change with the time; else no call is told it."""
        c = self._composite(1)
        x, u, t = ca.SX.sym("x", c.nz), ca.SX.sym("u", c.nu), ca.SX.sym("t")
        after = c.step_expression(x, [u], ca.SX.zeros(c.nw), 1.0, t, self._numbers(c))
        return bool(ca.depends_on(after, t))

    def _arguments(self, *symbols: Any) -> list[Any]:
        return list(symbols if self._timed else symbols[:-1])

    def _composite(self, substeps: int) -> Composite:
        return Composite(self._plant, self._effects, substeps, limited=self._limited, numbers=self._all_values)

    @cached_property
    def _all_values(self) -> dict[str, float]:
        c = Composite(self._plant, self._effects)
        return dict(zip(c.names, map(float, c.vector(self._values)), strict=True))

    def _stepped(self, name: str, substeps: int, *, jacobian: bool) -> ca.Function:
        """(x, u, h, t) -> x after, and its derivative with dry friction's holding forces taken as given.

        The derivative of what is held is zero, however short the step: a filter would then expect nothing of a hoop at
        rest but what the noise added since its last node, and how much that is would follow the jitter of its ticks.
        """
        c = self._composite(substeps)
        x, u, h, t = ca.SX.sym("x", c.nz), ca.SX.sym("u", c.nu), ca.SX.sym("h"), ca.SX.sym("t")
        told = ([u] * substeps, ca.SX.zeros(c.nw), h, t, self._numbers(c))
        results = [ca.densify(c.step_expression(x, *told))]
        if jacobian:
            holding = HoldingForces()
            by_state = ca.jacobian(c.step_expression(x, *told, holding), x)
            results.append(ca.densify(holding.put_back(by_state)))
        return ca.Function(name, self._arguments(x, u, h, t), results, {"cse": True})

    @cached_property
    def _linear(self) -> tuple[ca.Function, ca.Function]:
        """(x, u, t) -> dx/dt, and -> A, B."""
        c = self._smooth
        x, u, t = ca.SX.sym("x", c.nx), ca.SX.sym("u", c.nu), ca.SX.sym("t")
        rate = c.rate_expression(x, u, t, self._numbers(c))
        parts = [ca.densify(ca.jacobian(rate, one)) for one in (x, u)]
        ins = self._arguments(x, u, t)
        return ca.Function("rate", ins, [ca.densify(rate)]), ca.Function("jacobians", ins, parts)

    @cached_property
    def _energy(self) -> ca.Function | None:
        if self._plant.energy is None:
            return None
        x = ca.SX.sym("x", len(self._plant.states))
        return ca.Function("energy", [x], [self._plant.energy(self._plant.point(x, self._numbers(self._smooth)))])

    def _numbers(self, composite: Composite) -> dict[str, Any]:
        """Parameters of a composite as constants."""
        vector = composite.vector(self._values)
        return {name: ca.SX(value) for name, value in zip(composite.names, vector, strict=True)}
