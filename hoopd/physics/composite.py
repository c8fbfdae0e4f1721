"""A declared plant with any set of effects: one step, the readings, and their exact derivatives, in CasADi.

The state z is the plant's, then the torque behind a lag and the readings behind a sensor's lag, where there are such.
A step of h seconds takes the torque of each of its substeps (so that a delay may be a fraction of a sample), a
disturbance force on every coordinate, the time and all parameters. Smooth forces are integrated by fourth-order
Runge-Kutta; dry friction is an impulse clipped to +-level times half a substep through the mobility M^-1, before and
after it (Strang), so that sticking is exact and the splitting is of second order.

Rules of this file: effects at their neutral values leave the base's numbers as they are, bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.physics.declared import DeclaredPlant
from hoopd.physics.effects.base import DryFriction, Effect, Point
from hoopd.physics.equations import runge_kutta

Array = NDArray[np.float64]

# Substeps of a node's interval (at most 20 ms): smooth forces at 5 ms; a friction's reversal is met within 2 ms.
SMOOTH_SUBSTEPS, FRICTION_SUBSTEPS = 4, 10
LONGEST_STEP_S = 0.020
# A reading that is late is the state carried back by so many Runge-Kutta steps, each with the mean torque of its time.
BACK_STEPS = 3
# Width of the smooth form of dry friction on the way back, rad/s: there is no sticking to be exact about.
BACK_WIDTH = 0.02
# A lag shorter than this is none.
SHORTEST_LAG_S = 1e-7


class Composite:
    """A plant and its effects; parameters by name: the base's, then `slot.effect.parameter`."""

    def __init__(self, plant: DeclaredPlant, effects: Sequence[Effect] = ()) -> None:
        self.effects = tuple(effects)
        for effect in self.effects:
            if effect.plant is not None:
                plant = effect.plant(plant)
        self.plant = plant
        self.values = {**plant.values, **{e.key(name): value for e in effects for name, value in e.neutral().items()}}
        self.names = tuple(self.values)
        self._torque_lags = [e for e in self.effects if e.lag]
        self._sensor_lags = [(e, c) for e in self.effects for c in e.sensor_lag if c in plant.channels]
        self.latencies = {c: e.key(name) for e in self.effects for c, name in e.latency.items() if c in plant.channels}
        self.delays = tuple(e.key(e.delay) for e in self.effects if e.delay)
        self.nx, self.nq = len(plant.states), len(plant.coordinates)
        self.nz = self.nx + bool(self._torque_lags) + len(self._sensor_lags)
        self.channels = tuple(plant.channels)
        dry = any(e.friction for e in self.effects)
        self.substeps = FRICTION_SUBSTEPS if dry else SMOOTH_SUBSTEPS

    # ------------------------------------------------------------------------------------------ expressions

    def step_expression(self, z: Any, torques: Any, w: Any, h: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """State after h seconds; torques (substeps,), w (coordinates,) held."""
        d = h / self.substeps
        for j in range(self.substeps):
            z = self._substep(z, torques[j], w, d, t + j * d, p)
        return z

    def output_expressions(self, z: Any, back: Any, w: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """Readings (channels,); back (channels, BACK_STEPS): torque on the way back, the youngest first."""
        found = []
        for row, channel in enumerate(self.channels):
            late = channel in self.latencies
            x = self._earlier(z, back[row, :], w, t, p, p[self.latencies[channel]]) if late else z
            point = self.plant.point(x, p, 0.0, t - p[self.latencies[channel]] if late else t)
            found.append(self._reading(channel, point, z, p))
        return ca.vertcat(*found)

    def _reading(self, channel: str, point: Point, z: Any, p: Mapping[str, Any]) -> Any:
        value = getattr(point, self.plant.channels[channel])
        for index, (_, lagged) in enumerate(self._sensor_lags):
            if lagged == channel:
                value = z[self.nx + bool(self._torque_lags) + index]
        for effect in self.effects:
            if effect.sensor is not None:
                value += effect.sensor(point, effect.values(p)).get(channel, 0.0)
        return value

    def _substep(self, z: Any, u: Any, w: Any, d: Any, t: Any, p: Mapping[str, Any]) -> Any:
        x = z[: self.nx]
        torque, tail = self._actuated(z, u, d, t, p)
        x = self._stopped(x, d / 2, t, p)
        speeds = x
        x = runge_kutta(lambda y: self._rate(y, torque, w, t, p), x, d, 1)
        x = self._stopped(x, d / 2, t + d, p)
        for effect, channel in self._sensor_lags:
            m, name = z[self.nx + len(tail)], self.plant.channels[channel]
            mid = (getattr(self.plant.point(speeds, p), name) + getattr(self.plant.point(x, p), name)) / 2
            # T m' = y - m, exactly for a reading that stays at its mean over the substep
            tail = [*tail, mid + (m - mid) * ca.exp(-d / _lag(effect, effect.sensor_lag[channel], p))]
        return ca.vertcat(x, *tail)

    def _actuated(self, z: Any, u: Any, d: Any, t: Any, p: Mapping[str, Any]) -> tuple[Any, list[Any]]:
        """Mean torque over a substep behind the actuator, and the lag's state after it."""
        if self.plant.driven is None:
            return 0.0, []
        torque = ca.fmin(ca.fmax(u, -self.plant.limit), self.plant.limit)
        for effect in sorted(self.effects, key=lambda one: one.order):
            if effect.torque is not None:
                torque = effect.torque(self.plant.point(z[: self.nx], p, torque, t), effect.values(p))
        if not self._torque_lags:
            return torque, []
        # T tau' = u - tau:  tau(d) = u + (tau_0 - u) e^(-d/T),  its mean over d: u + (tau_0 - u) (1 - e^(-d/T)) T/d
        lag = _lag(self._torque_lags[0], str(self._torque_lags[0].lag), p)
        decay, off = ca.exp(-d / lag), z[self.nx] - torque
        return torque + off * (1 - decay) * lag / ca.fmax(d, SHORTEST_LAG_S), [torque + off * decay]

    def _rate(self, x: Any, torque: Any, w: Any, t: Any, p: Mapping[str, Any], *, smooth_friction: bool = False) -> Any:
        s = self.plant.point(x, p, torque, t)
        force = {q: w[i] if i < w.numel() else 0.0 for i, q in enumerate(self.plant.coordinates)}
        if self.plant.driven is not None:
            force[self.plant.driven] += torque
        shifts: dict[str, Any] = {}
        for effect in self.effects:
            e = effect.values(p)
            if effect.force is not None:
                _add(force, effect.force(s, e))
            if effect.shift is not None:
                _add(shifts, effect.shift(s, e), grow=True)
            if smooth_friction and effect.friction is not None:
                _add(force, self._smooth(effect, effect.friction, s, p))
        seen = s.replaced(**{q: getattr(s, q) + by for q, by in shifts.items() if q in self.plant.coordinates})
        a = self.plant.accelerations(seen, ca.vertcat(*(force[q] for q in self.plant.coordinates)))
        return ca.vertcat(*(one for i in range(self.nq) for one in (x[2 * i + 1], a[i])))

    def _smooth(self, effect: Effect, friction: DryFriction, s: Point, p: Mapping[str, Any]) -> dict[str, Any]:
        along = friction.along(s)
        rate = sum(c * getattr(s, f"d{q}") for q, c in along.items())
        f = -friction.level(s, effect.values(p)) * ca.tanh(rate / BACK_WIDTH)
        return {q: c * f for q, c in along.items()}

    def _stopped(self, x: Any, d: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """State after dry friction has acted for d seconds."""
        for effect in self.effects:
            if effect.friction is not None:
                x = self._stopped_by(effect, effect.friction, x, d, t, p)
        return x

    def _stopped_by(self, effect: Effect, friction: DryFriction, x: Any, d: Any, t: Any, p: Mapping[str, Any]) -> Any:
        s = self.plant.point(x, p, 0.0, t)
        along = friction.along(s)
        direction = ca.vertcat(*(along.get(q, 0.0) for q in self.plant.coordinates))
        speed = ca.vertcat(*(x[2 * i + 1] for i in range(self.nq)))
        # the impulse that stops the rate:  (a' M^-1 a) f d = -a' q',  clipped to +-level d
        push = ca.mtimes(self._mobility(s, p), direction)
        stop = -ca.dot(direction, speed) / ca.dot(direction, push)
        most = friction.level(s, effect.values(p)) * d
        change = push * ca.fmin(ca.fmax(stop, -most), most)
        return ca.vertcat(*(one for i in range(self.nq) for one in (x[2 * i], x[2 * i + 1] + change[i])))

    def _mobility(self, s: Point, p: Mapping[str, Any]) -> Any:
        force = ca.SX.sym("force", self.nq)
        return ca.substitute(ca.jacobian(self.plant.accelerations(s, force), force), force, ca.SX.zeros(self.nq))

    def _earlier(self, z: Any, torques: Any, w: Any, t: Any, p: Mapping[str, Any], d: Any) -> Any:
        """Plant's state d seconds ago."""
        x, h = z[: self.nx], d / BACK_STEPS
        for j in range(BACK_STEPS):
            torque, _ = self._static(x, torques[j], t - j * h, p)
            x = runge_kutta(
                lambda y, torque=torque, j=j: self._rate(y, torque, w, t - j * h, p, smooth_friction=True), x, -h, 1
            )
        return x

    def _static(self, x: Any, u: Any, t: Any, p: Mapping[str, Any]) -> tuple[Any, None]:
        torque = u
        for effect in sorted(self.effects, key=lambda one: one.order):
            if effect.torque is not None:
                torque = effect.torque(self.plant.point(x, p, torque, t), effect.values(p))
        return torque, None

    # ------------------------------------------------------------------------------------------ functions

    @cached_property
    def _symbols(self) -> dict[str, Any]:
        return {
            "z": ca.SX.sym("z", self.nz),
            "torques": ca.SX.sym("torques", self.substeps),
            "w": ca.SX.sym("w", self.nq),
            "h": ca.SX.sym("h"),
            "t": ca.SX.sym("t"),
            "p": ca.SX.sym("p", len(self.names)),
            "back": ca.SX.sym("back", len(self.channels), BACK_STEPS),
        }

    def _named(self, p: Any) -> dict[str, Any]:
        return {name: p[index] for index, name in enumerate(self.names)}

    @cached_property
    def step_function(self) -> ca.Function:
        """(z, torques, w, h, t, p) -> z after."""
        s = self._symbols
        after = self.step_expression(s["z"], s["torques"], s["w"], s["h"], s["t"], self._named(s["p"]))
        return ca.Function("step", [s[k] for k in ("z", "torques", "w", "h", "t", "p")], [ca.densify(after)], _CSE)

    @cached_property
    def output_function(self) -> ca.Function:
        """(z, back, w, t, p) -> readings."""
        s = self._symbols
        y = self.output_expressions(s["z"], s["back"], s["w"], s["t"], self._named(s["p"]))
        return ca.Function("outputs", [s[k] for k in ("z", "back", "w", "t", "p")], [ca.densify(y)], _CSE)

    def step_derivatives(self, free: Sequence[str]) -> ca.Function:
        """(z, torques, w, h, t, p) -> after, by z, by w, by torques, by the free parameters."""
        s, keys = self._symbols, ("z", "torques", "w", "h", "t", "p")
        after = self.step_expression(s["z"], s["torques"], s["w"], s["h"], s["t"], self._named(s["p"]))
        by_p = ca.jacobian(after, s["p"])[:, [self.names.index(name) for name in free]]
        parts = [after, *(ca.jacobian(after, s[k]) for k in ("z", "w", "torques")), by_p]
        return ca.Function("derivatives", [s[k] for k in keys], [ca.densify(one) for one in parts], _CSE)

    def output_derivatives(self, free: Sequence[str]) -> ca.Function:
        """(z, back, w, t, p) -> readings, by z, by the free parameters."""
        s, keys = self._symbols, ("z", "back", "w", "t", "p")
        y = self.output_expressions(s["z"], s["back"], s["w"], s["t"], self._named(s["p"]))
        by_p = ca.jacobian(y, s["p"])[:, [self.names.index(name) for name in free]]
        return ca.Function(
            "readings", [s[k] for k in keys], [ca.densify(a) for a in (y, ca.jacobian(y, s["z"]), by_p)], _CSE
        )

    def vector(self, values: Mapping[str, float]) -> Array:
        """Parameters in the order of `names`; what `values` leaves out is as declared (effects: neutral)."""
        return np.array([values.get(name, self.values[name]) for name in self.names], dtype=float)

    def beginning(self, x: Array, u: float = 0.0) -> Array:
        """z from the plant's state: a lag's torque and a sensor's lag have settled."""
        z = np.zeros(self.nz)
        z[: self.nx] = x
        if self._torque_lags:
            z[self.nx] = u
        for index, (_, channel) in enumerate(self._sensor_lags):
            z[self.nx + bool(self._torque_lags) + index] = x[self.plant.states.index(self.plant.channels[channel])]
        return z


_CSE = {"cse": True}


def _lag(effect: Effect, name: str, p: Mapping[str, Any]) -> Any:
    return ca.fmax(p[effect.key(name)], SHORTEST_LAG_S)


def _add(total: dict[str, Any], more: Mapping[str, Any], *, grow: bool = False) -> None:
    for name, value in more.items():
        if name in total:
            total[name] += value
        elif grow:
            total[name] = value
