"""A declared plant with any set of effects: one step, the readings, and their exact derivatives, in CasADi.

The state z is the plant's, then the torque behind a lag and the readings behind a sensor's lag, where there are such.
A step of h seconds takes the torque of each of its substeps (so that a delay may be a fraction of a sample), a
disturbance force on every coordinate, the time and all parameters. Every substep is one Runge-Kutta step of fourth
order. Dry friction is the force that brings its rate to zero over the substep, clipped to +-level: what sticks stays
where it is, to the last bits.

Rules of this file: effects at their neutral values leave the base's numbers as they are, bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import takewhile
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.integration_step import USUAL_S, HoldingForces, Motion, StageTorques, joined, split_inputs

Array = NDArray[np.float64]

# Substeps of a node's interval of 20 ms: smooth forces at 5 ms; with 5 substeps a run of 4 s with dry friction misses
# the converged angles by 1e-4 rad, a tenth of the encoder's step (tests of step-halving).
SMOOTH_SUBSTEPS, FRICTION_SUBSTEPS = 4, 5
# A sensor's lag takes what it reads for straight within a substep: of a speed behind a drive's lag it misses 4e-4 rad/s
# at 2.5 ms, 1.3e-3 at 5 ms.
BENT_SUBSTEPS = 8
LONGEST_STEP_S = 0.020
# A reading that is late is the state carried back by so many Runge-Kutta steps, each with the mean torque of its time.
BACK_STEPS = 3


class Composite:
    """A plant and its effects; parameters by name: the base's, then `slot.effect.parameter`."""

    motion_class: type[Motion] = Motion  # what moves it over a substep

    def __init__(
        self,
        plant: Plant,
        effects: Sequence[Effect] = (),
        substeps: int | None = None,
        *,
        limited: bool = True,
        numbers: Mapping[str, float] | None = None,
    ) -> None:
        """`substeps`: of a node's interval, in place of what the effects need; `limited`: no input is larger than its
        limit; `numbers`: values that the equations have as constants from the beginning."""
        self.effects, self.declared = tuple(effects), plant
        for effect in self.effects:
            if effect.plant is not None:
                plant = effect.plant(plant)
        self.plant = plant
        self.values = {**plant.values, **{e.key(name): value for e in effects for name, value in e.neutral().items()}}
        self.names = tuple(self.values)
        self._torque_lags = [e for e in self.effects if e.lag]
        self._sensor_lags = [(e, c) for e in self.effects for c in e.sensor_lag if plant.state_of(c)]
        self.latencies = {c: e.key(name) for e in self.effects for c, name in e.latency.items() if c in plant.channels}
        self.delays = tuple(e.key(e.delay) for e in self.effects if e.delay)
        self.nx, self.nq = len(plant.states), len(plant.coordinates)
        # disturbances: a force on every coordinate, a rate of every first-order state
        self.nw, self.nu = len(plant.disturbed), max(1, len(plant.inputs))
        self.longest_step_s = LONGEST_STEP_S * (plant.time_scale_s / USUAL_S)
        self.nz = self.nx + bool(self._torque_lags) + len(self._sensor_lags)
        self.channels = tuple(plant.channels)
        self.substeps = substeps or self._needed_substeps()
        inner = not self._torque_lags
        self._motion = self.motion_class(
            self.plant, self.effects, self.names, inner_torque=inner, limited=limited, numbers=numbers
        )
        self._shortest_s = self._motion.shortest_s

    def _needed_substeps(self) -> int:
        dry = any(e.friction for e in self.effects)
        least = max(FRICTION_SUBSTEPS if dry else SMOOTH_SUBSTEPS, BENT_SUBSTEPS if self.reads_bent else 0)
        return max(least, *(e.substeps for e in self.effects), 0)

    @property
    def reads_bent(self) -> bool:
        """Whether a sensor lags behind what bends within a step: the rate under a torque that lags, too."""
        return bool(self._torque_lags and self._sensor_lags)

    # ------------------------------------------------------------------------------------------ expressions

    def step_expression(
        self,
        z: Any,
        torques: Any,
        w: Any,
        h: Any,
        t: Any,
        p: Mapping[str, Any],
        holding: HoldingForces | None = None,
    ) -> Any:
        """State after h seconds; torques: the input (or a column of several) of each substep; w (nw,) held; `holding`:
        as `Motion.step`."""
        d = h / self.substeps
        for j in range(self.substeps):
            z = self._substep(z, torques[j], w, d, t + j * d, p, holding)
        return z

    def rate_expression(self, x: Any, torque: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """dx/dt of the plant's own state under a demanded torque; dry friction not among the effects."""
        return self._motion.rate(x, torque, t, p)

    def smooth_rate_expression(self, x: Any, torque: Any, t: Any, p: Mapping[str, Any], width: float) -> Any:
        """The same with dry friction as a curve that is steep within `width` of rest (in the friction's own rate)."""
        return self._motion.smooth_rate(x, torque, t, p, width)

    def output_expressions(self, z: Any, back: Any, w: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """Readings (channels,); back (channels, BACK_STEPS nu): inputs on the way back, the youngest first."""
        found = []
        for row, channel in enumerate(self.channels):
            if channel in self.latencies:
                late = p[self.latencies[channel]]
                found.append(self.reading(channel, self._earlier(z, back[row, :], w, t, p, late), t - late, p))
            else:
                found.append(self.reading(channel, z, t, p))
        return ca.vertcat(*found)

    def reading(self, channel: str, z: Any, t: Any, p: Mapping[str, Any]) -> Any:
        """What a channel reads of a state, its latency apart."""
        index = self._lag_index(channel)
        value = self._seen(channel, z, t, p) if index is None else z[index]
        for effect in self.effects:
            if effect.sensor is not None:
                value += effect.sensor(self.plant.point(z, p, 0.0, t), effect.values(p)).get(channel, 0.0)
        return value

    def _lag_index(self, channel: str) -> int | None:
        lagged = [c for _, c in self._sensor_lags]
        return self.nx + bool(self._torque_lags) + lagged.index(channel) if channel in lagged else None

    def _seen(self, channel: str, z: Any, t: Any = 0.0, p: Mapping[str, Any] | None = None) -> Any:
        reading = self.plant.channels[channel].reading
        if reading is not None:
            return reading(self.plant.reading_point(z, p or {}, t))
        return z[self.plant.states.index(self.plant.state_of(channel))]

    def _substep(
        self, z: Any, u: Any, w: Any, d: Any, t: Any, p: Mapping[str, Any], holding: HoldingForces | None = None
    ) -> Any:
        before = z[: self.nx]
        torques, tail = self._lagged(z, u, d, t, p)
        x = self._motion.step(before, torques, w, d, t, p, holding)
        for effect, channel in self._sensor_lags:
            time = p[effect.key(effect.sensor_lag[channel])]
            reading = z[self.nx + len(tail)]
            seen = (self._seen(channel, before), self._seen(channel, x))
            tail = [*tail, _low_passed(reading, *seen, d, time, self._shortest_s)]
        return ca.vertcat(x, *tail)

    def _lagged(self, z: Any, u: Any, d: Any, t: Any, p: Mapping[str, Any]) -> tuple[StageTorques, list[Any]]:
        """Torques over a substep behind the lag, and the lag's state after it; without a lag the demand."""
        if not self._torque_lags:
            return StageTorques(u, u, u), []
        lag = p[self._torque_lags[0].key(str(self._torque_lags[0].lag))]
        # what the maps make of the demand follows the angle: taken in the middle of the substep
        middle = self._motion.drifted(z[: self.nx], d / 2)
        torque, others = split_inputs(self._motion.torque(middle, u, t + d / 2, p), self.nu)
        # T tau' = u - tau:  tau(d) = u + (tau_0 - u) e^(-d/T), of which e^(-s/T) has over d
        #   the mean g = (1 - e^(-d/T)) T/d  and the double integral  m d^2,  m = (1 - g) T/d
        decay, off = ca.exp(-d / ca.fmax(lag, self._shortest_s)), z[self.nx] - torque
        share = lag / ca.fmax(d, self._shortest_s)
        mean = (1 - decay) * share
        twice = (1 - mean) * share
        # the straight line with both moves rate and position as the lag does: from 6 m - 2 g to 4 g - 6 m
        stages = (torque + off * one for one in (6 * twice - 2 * mean, mean, 4 * mean - 6 * twice))
        return StageTorques(*(joined(one, others) for one in stages)), [torque + off * decay]

    def _earlier(self, z: Any, torques: Any, w: Any, t: Any, p: Mapping[str, Any], d: Any) -> Any:
        """State d seconds ago."""
        h = d / BACK_STEPS
        for j in range(BACK_STEPS):
            z = self._one_back(z, torques[j * self.nu : (j + 1) * self.nu].T, w, t - j * h, p, h)
        return z

    def _one_back(self, z: Any, u: Any, w: Any, t: Any, p: Mapping[str, Any], h: Any) -> Any:
        x, tail = z[: self.nx], []
        torque = u
        if self._torque_lags:
            lag = p[self._torque_lags[0].key(str(self._torque_lags[0].lag))]
            every = self._motion.torque(self._motion.drifted(x, -h / 2), u, t - h / 2, p)
            u, others = split_inputs(every, self.nu)
            # tau_0 = u + (tau - u) e^(h/T), and its mean over h as above
            shortest = self._shortest_s
            off = (z[self.nx] - u) * _grown(h, lag, shortest)
            torque = u + off * (1 - ca.exp(-h / ca.fmax(lag, shortest))) * lag / ca.fmax(h, shortest)
            torque = joined(torque, others)
            tail = [u + off]
        before = self._motion.step_back(x, torque, w, h, t, p)
        for effect, channel in self._sensor_lags:
            time = p[effect.key(effect.sensor_lag[channel])]
            reading = z[self.nx + len(tail)]
            seen = (self._seen(channel, before), self._seen(channel, x))
            tail = [*tail, _low_pass_undone(reading, *seen, h, time, self._shortest_s)]
        return ca.vertcat(before, *tail)

    def point_in_frame(self, z: Any, p: Mapping[str, Any], t: Any = 0.0, u: Any = 0.0) -> Point:
        """The point of a state in a frame that leans and shakes as effects have it."""
        return self.plant.point(z, p, u, t).in_frame(self.effects, p)

    # ------------------------------------------------------------------------------------------ functions

    @cached_property
    def _symbols(self) -> dict[str, Any]:
        return {
            "z": ca.SX.sym("z", self.nz),
            "torques": ca.SX.sym("torques", self.substeps, self.nu),
            "w": ca.SX.sym("w", self.nw),
            "h": ca.SX.sym("h"),
            "t": ca.SX.sym("t"),
            "p": ca.SX.sym("p", len(self.names)),
            "back": ca.SX.sym("back", len(self.channels), BACK_STEPS * self.nu),
        }

    def _named(self, p: Any) -> dict[str, Any]:
        return {name: p[index] for index, name in enumerate(self.names)}

    @cached_property
    def step_function(self) -> ca.Function:
        """(z, torques, w, h, t, p) -> z after."""
        s = self._symbols
        after = self.step_expression(s["z"], _rows(s["torques"]), s["w"], s["h"], s["t"], self._named(s["p"]))
        return ca.Function("step", [s[k] for k in ("z", "torques", "w", "h", "t", "p")], [ca.densify(after)], _CSE)

    @cached_property
    def output_function(self) -> ca.Function:
        """(z, back, w, t, p) -> readings."""
        s = self._symbols
        y = self.output_expressions(s["z"], s["back"], s["w"], s["t"], self._named(s["p"]))
        return ca.Function("outputs", [s[k] for k in ("z", "back", "w", "t", "p")], [ca.densify(y)], _CSE)

    @cached_property
    def reading_function(self) -> ca.Function:
        """(z, t, p) -> readings of this very state: no latency."""
        s = self._symbols
        y = [self.reading(channel, s["z"], s["t"], self._named(s["p"])) for channel in self.channels]
        return ca.Function("readings", [s[k] for k in ("z", "t", "p")], [ca.densify(ca.vertcat(*y))], _CSE)

    @cached_property
    def demand_function(self) -> ca.Function:
        """(z, u, t, p) -> what a lag of the drive follows: the first input behind all that it is mapped by."""
        s = self._symbols
        u = ca.SX.sym("u", self.nu)
        torque, _ = split_inputs(self._motion.torque(s["z"][: self.nx], u, s["t"], self._named(s["p"])), self.nu)
        return ca.Function("demand", [s["z"], u, s["t"], s["p"]], [ca.densify(torque)], _CSE)

    def substep_derivatives(self, free: Sequence[str]) -> ca.Function:
        """(z, torque, w, d, t, p) -> z after d seconds; its derivatives by z, w, torque and free parameters."""
        s = self._symbols
        ins = [s["z"], _rows(s["torques"])[0], s["w"], s["h"], s["t"], s["p"]]
        after = self._substep(ins[0], ins[1], ins[2], ins[3], ins[4], self._named(s["p"]))
        by = ca.vertcat(ins[0], ins[2], ins[1], *(s["p"][self.names.index(name)] for name in free))
        return ca.Function("derivatives", ins, [ca.densify(after), ca.densify(ca.jacobian(after, by))], _CSE)

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

    def delay_s(self, values: Mapping[str, float]) -> float:
        """By how much the demanded torque is late."""
        return sum(values.get(key, 0.0) for key in self.delays)

    def latency_s(self, channel: str, values: Mapping[str, float]) -> float:
        """By how much a channel's readings are late."""
        return values.get(self.latencies.get(channel, ""), 0.0)

    @property
    def settled(self) -> tuple[int | None, ...]:
        """Of the states behind lags: the plant's state that each follows at rest, None for the demanded torque."""
        readings = [self.plant.states.index(self.plant.state_of(channel)) for _, channel in self._sensor_lags]
        return (*([None] if self._torque_lags else []), *readings)

    @property
    def followed(self) -> tuple[str | None, ...]:
        """The channels of the lags, in the order of `settled`; None for the torque."""
        return (*([None] if self._torque_lags else []), *(channel for _, channel in self._sensor_lags))

    @property
    def lags(self) -> tuple[str, ...]:
        """The parameters (s) of the lags, in the order of `settled`."""
        sensors = [effect.key(effect.sensor_lag[channel]) for effect, channel in self._sensor_lags]
        return (*(e.key(str(e.lag)) for e in self._torque_lags[:1]), *sensors)

    def beginning(self, x: Array, u: float = 0.0) -> Array:
        """z from the plant's state: what an effect added to it begins as the plant says, what lags has settled."""
        z = np.zeros(self.nz)
        z[: len(x)] = x
        for i, name in enumerate(self.plant.states[len(x) :], start=len(x)):
            if other := self.plant.remembered.get(name):
                z[i] = z[self.plant.states.index(other)]
        z[self.nx :] = [u if state is None else z[state] for state in self.settled]
        return z

    @property
    def state_names(self) -> tuple[str, ...]:
        """Of every element of z: the plant's states, then what lags."""
        torque = ["lagging torque"] if self._torque_lags else []
        return (*self.plant.states, *torque, *(f"lagging {channel}" for _, channel in self._sensor_lags))

    def taking_over(self, before: Composite, z: Array, u: float = 0.0) -> Array:
        """z from that of the same plant with other effects: what both remember goes on, the rest begins."""
        had = dict(zip(before.state_names, z.tolist(), strict=True))
        shared = list(takewhile(had.__contains__, self.plant.states))
        begun = self.beginning(np.array([had[name] for name in shared]), u)
        return np.array([had.get(name, begun[i]) for i, name in enumerate(self.state_names)])


_CSE = {"cse": True}


def _rows(inputs: Any) -> list[Any]:
    """Columns of the inputs, one a substep."""
    return [row.T for row in ca.vertsplit(inputs)]


def _low_passed(m: Any, before: Any, after: Any, d: Any, lag: Any, shortest_s: float) -> Any:
    """T m' = y - m over d seconds of a reading y that moves in a straight line, exactly."""
    # m(d) = y_1 - s T + (m_0 - y_0 + s T) e^(-d/T),  s = (y_1 - y_0)/d
    run = (after - before) / ca.fmax(d, shortest_s) * lag
    return after - run + (m - before + run) * ca.exp(-d / ca.fmax(lag, shortest_s))


def _low_pass_undone(m: Any, before: Any, after: Any, d: Any, lag: Any, shortest_s: float) -> Any:
    """m d seconds ago: the same solved for m_0."""
    run, more = (after - before) / ca.fmax(d, shortest_s) * lag, _grown(d, lag, shortest_s) - 1
    # m_0 = y_0 - s T + (m - y_1 + s T) e^(d/T)
    return m + (before - after) + (m - after + run) * more


def _grown(d: Any, lag: Any, shortest_s: float) -> Any:
    """e^(d/T) of the way back, at most e: what has died away cannot be called back."""
    return ca.exp(ca.fmin(d / ca.fmax(lag, shortest_s), 1.0))
