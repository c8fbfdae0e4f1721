"""The plant of the rig: a model moved through time, with any physics that the daemon's model does not have.

Its physics may become another at times that are told: dry friction that begins after a minute, and goes again. What
moves, and what both remember (a lag, a Dahl state, a warm bearing), goes on then; a ball in the air lands first.

With `ball.lift_off` the ball leaves the hoop where nothing presses it on, flies, and lands: psi is then the direction
in which it is seen, and its distance from the axis is below the track's.

Rules of this file: time is an argument and never runs backwards; a segment between two events is integrated in steps
of at most 1 ms, 2 ms where the ball may fly. What acts late is kept with its time, so that delays and latencies of any
length are exact at the plant's own steps.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Mapping, Sequence
from math import inf, nan

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.core.records import Vector
from hoopd.plants.compiled import Call
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.effects.contact_modes import AIR, INNER, ROLLING, ContactCourse, ContactModes
from hoopd.plants.numeric_plant import ADVANCE_STEPS, NumericPlant
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]
State = tuple[float, float, float, float]

# Longest segment of one call, and its steps; with effects a call is one such step, which the past keeps.
SEGMENT_S, STEP_S = 0.02, 0.001
# A tick falls into what lies between the answer of the board, the picture and the next tick: a call for a part of it
# takes so many steps, none longer than in the whole.
FEWER_STEPS = (2, 7, 14)
# The past that is kept, beyond the largest latency: a picture is looked at when it is taken.
MEMORY_S = 0.05
SAME_S = 1e-9
READ = ("theta", "dtheta", "psi")


class _Physics:
    """What moves and what is read, for as long as it stays the same."""

    def __init__(self, found: FoundEffects) -> None:
        effects, values = found.effects(), found.values
        c = Composite(found.plant, effects, substeps=1)
        steps = (1,) if effects else (*FEWER_STEPS, ADVANCE_STEPS)
        models = [NumericPlant(found.plant, effects, values, advance_steps=count) for count in steps]
        self._models = [(count * STEP_S + SAME_S, model) for count, model in zip(steps, models, strict=True)]
        self.delay_s = c.delay_s(values)
        self.late = {channel: c.latency_s(channel, values) for channel in READ}
        self.errors = _readings(c, values) if any(one.sensor or one.sensor_lag for one in effects) else None
        self.composite = c
        self._flying = (
            (ContactModes(found.plant, effects), values) if any(e.flight is not None for e in effects) else None
        )
        self.has_effects = bool(effects)
        self.modes = {ROLLING} if self._flying is None else set(self._flying[0].hybrid.modes)

    def prepare(self, z: Array) -> None:
        """Makes all functions now, not in the first tick."""
        for longest_s, model in self._models:
            model.advance(z, 0.0, longest_s - SAME_S)

    def advance(self, z: Array, torque_nm: float, h: float, t: float) -> Array:
        """State after h seconds."""
        model = next((model for longest_s, model in self._models if h <= longest_s), self._models[-1][1])
        return model.advance(z, torque_nm, h, t)

    def course(self, z: Array) -> ContactCourse | None:
        """How the ball touches the hoop from here on; None where it always does."""
        return None if self._flying is None else ContactCourse(*self._flying, z)


class RigPlant:
    """Plant, drive and sensors as they really are, over time."""

    def __init__(
        self,
        found: FoundEffects,
        x0: Vector,
        *,
        held: bool = False,
        hold_s: float = 0.0,
        t: float = 0.0,
        later: Sequence[tuple[float, FoundEffects]] = (),
        inner: bool = False,
    ) -> None:
        """`held`: hands hold ball and hoop at x0 until `hold_s` has passed and the drive gives its first torque;
        `later`: what the physics is from a time on, in order; `inner`: the ball begins on the inner hoop."""
        self._stages = [(-inf, _Physics(found)), *((since, _Physics(one)) for since, one in later)]
        self._remembers = any(any(one.late.values()) for _, one in self._stages)
        self._longest_s = max(max(one.late.values()) for _, one in self._stages)
        self._release_s = hold_s
        self.restart(x0, held=held, t=t, inner=inner)
        for _, one in self._stages:
            one.prepare(one.composite.beginning(np.asarray(x0, float)))

    def restart(self, x0: Vector, *, held: bool = False, t: float = 0.0, inner: bool = False) -> None:
        """Begin anew, at rest in everything but x0: as a plant that is made now."""
        self._t, self._stage = t, 0
        self._physics = self._stages[0][1]
        self._torques: deque[tuple[float, float]] = deque([(-inf, 0.0)])  # from when on
        self._landed: list[tuple[float, float]] = []  # flights of the stages before
        self._begin(self._physics.composite.beginning(np.asarray(x0, float)), INNER if inner else ROLLING)
        self._held, self._release_t = held, t + self._release_s
        self._past: deque[tuple[float, Array, float]] = deque([(t, self._z, 1.0)])

    def _begin(self, z: Array, mode: str) -> None:
        """This stage's physics from a state of its own on."""
        self._z, self._course = z, self._physics.course(z)
        if self._course is not None and mode == INNER:
            self._course.restart(z, INNER)
        # a course has steps of its own; the past is kept step by step
        fine = self._physics.has_effects and (self._course is None or self._remembers)
        self._segment_s = STEP_S if fine else SEGMENT_S

    def _change(self) -> None:
        """The next stage's physics takes over, with hoop and ball where they are; what was on its way stays so."""
        before, mode, torque_nm = self._physics.composite, self.ball_mode, self._torques[0][1]
        self._landed = self.flights
        self._stage += 1
        self._physics = self._stages[self._stage][1]
        own = self._physics.composite
        self._past = deque((t, own.taking_over(before, z, torque_nm), distance) for t, z, distance in self._past)
        self._begin(own.taking_over(before, self._z, torque_nm), mode)

    def _change_where_due(self) -> None:
        while self._t >= self._next_stage_t - SAME_S and self._takes_over(self._stages[self._stage + 1][1]):
            self._change()

    def _takes_over(self, physics: _Physics) -> bool:
        """Whether a physics has the mode that the ball is in: a flight ends by the laws by which it began."""
        return self.ball_mode != AIR and self.ball_mode in physics.modes

    @property
    def t(self) -> float:
        """How far the plant has come, in s."""
        return self._t

    @property
    def state(self) -> State:
        """theta, dtheta, psi, dpsi in rad and rad/s."""
        return _state(self._z)

    @property
    def shown(self) -> State:
        """The state that a picture taken now shows: late, and with the camera's own errors."""
        theta, dtheta, psi, dpsi = _state(self._seen("psi"))
        return theta, dtheta, psi if self._physics.errors is None else self._read("psi"), dpsi

    @property
    def shown_distance(self) -> float:
        """The ball's distance from the axis in such a picture, in shares of what it is on the hoop."""
        return self._past_at(self._t - self._physics.late["psi"])[1] if self._remembers else self.distance

    @property
    def distance(self) -> float:
        """Of the ball's centre from the axis, in shares of what it is on the hoop; below 1 it flies."""
        return 1.0 if self._course is None else self._course.distance

    @property
    def ball_mode(self) -> str:
        """What the ball does: rolling, air or inner."""
        return ROLLING if self._course is None else self._course.mode

    @property
    def flights(self) -> list[tuple[float, float]]:
        """Begin and end of every flight so far, s."""
        return self._landed if self._course is None else [*self._landed, *self._course.flights(self._t)]

    def sample(self) -> tuple[float, float, float]:
        """theta, dtheta as the encoder gives them now, and no current of its own: the board takes torque over torque
        constant."""
        if self._physics.errors is None and not self._remembers:
            return float(self._z[0]), float(self._z[1]), nan
        return self._read("theta"), self._read("dtheta"), nan

    def advance(self, t: float, torque_nm: float) -> None:
        """Go on to `t` with the torque demanded."""
        if self._held and torque_nm != 0.0 and self._t >= self._release_t:
            self._held = False
        if self._held:
            self._t = max(t, self._t)
            self._change_where_due()
            self._past = deque([(self._t, self._z, 1.0)])
        if torque_nm != self._torques[-1][1]:
            self._torques.append((self._t, torque_nm))
        while t - self._t > SAME_S:
            self._change_where_due()
            until = min(one for one in (t, self._next_torque(), self._next_stage_t) if one > self._t)
            h = min(until - self._t, self._segment_s)
            self._move(self._torques[0][1], h)
            self._t += h
            if self._remembers:
                self._remember()

    @property
    def _next_stage_t(self) -> float:
        return self._stages[self._stage + 1][0] if self._stage + 1 < len(self._stages) else inf

    def _move(self, torque_nm: float, h: float) -> None:
        if self._course is None:
            self._z = self._physics.advance(self._z, torque_nm, h, self._t)
            return
        self._course.advance(torque_nm, h, self._t)
        self._z = self._course.seen()

    def _next_torque(self) -> float:
        """When another torque arrives; what has arrived is dropped."""
        while len(self._torques) > 1 and self._torques[1][0] + self._physics.delay_s <= self._t + SAME_S:
            self._torques.popleft()
        return self._torques[1][0] + self._physics.delay_s if len(self._torques) > 1 else inf

    def _remember(self) -> None:
        self._past.append((self._t, self._z, self.distance))
        oldest = self._t - self._longest_s - MEMORY_S
        while self._past[0][0] < oldest:
            self._past.popleft()

    def _read(self, channel: str) -> float:
        """What a sensor gives now."""
        z, row = self._seen(channel), READ.index(channel)
        errors = self._physics.errors
        return float(z[row] if errors is None else errors.vector(z, self._t)[row])

    def _seen(self, channel: str) -> Array:
        """The state that a sensor sees."""
        return self._past_at(self._t - self._physics.late[channel])[0] if self._remembers else self._z

    def _past_at(self, t: float) -> tuple[Array, float]:
        """State and distance at a time of the past (the first one before it), in a straight line between two steps."""
        if t >= self._past[-1][0]:
            return self._past[-1][1:]
        index = bisect_right(self._past, t, key=lambda one: one[0])
        if index == 0:
            return self._past[0][1:]
        (t0, z0, d0), (t1, z1, d1) = self._past[index - 1], self._past[index]
        share = (t - t0) / (t1 - t0)
        return np.asarray(z0 + (z1 - z0) * share), d0 + (d1 - d0) * share


def make_plant(
    structure: str,
    parameters: dict[str, float],
    x0: list[float],
    held: bool = False,
    hold_s: float = 0.0,
    effects: dict[str, dict[str, float]] | None = None,
    later: list[tuple[float, dict[str, dict[str, float]], dict[str, float]]] | None = None,
) -> RigPlant:
    """Plant from plain data: what the board's process is told on its command line; effects by name, and those and the
    parameters that there are from a time on."""

    def found(told: Mapping[str, Mapping[str, float]], numbers: Mapping[str, float]) -> FoundEffects:
        return FoundEffects(structure, numbers, tuple(FoundEffect(name, values) for name, values in told.items()))

    stages = [(since, found(told, numbers)) for since, told, numbers in later or ()]
    return RigPlant(found(effects or {}, parameters), np.array(x0, float), held=held, hold_s=hold_s, later=stages)


def _readings(c: Composite, values: Mapping[str, float]) -> Call:
    """(z, t) -> readings without latency."""
    z, t = ca.SX.sym("z", c.nz), ca.SX.sym("t")
    p = dict(zip(c.names, map(ca.SX, c.vector(values)), strict=True))
    seen = ca.vertcat(*(c.reading(channel, z, t, p) for channel in READ))
    return Call(ca.Function("readings", [z, t], [ca.densify(seen)]))


def _state(z: Array) -> State:
    theta, dtheta, psi, dpsi = z[:4].tolist()
    return theta, dtheta, psi, dpsi
