"""A rig's plant with physics that the daemon's model does not have: any effects of the library, at steps of 1 ms.

Rules of this file: time is an argument and never runs backwards; what acts late is kept with its time, so that delays
and latencies of any length are exact at the plant's own steps.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from math import ceil, nan

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.core.records import Vector
from hoopd.plants.compiled import Call
from hoopd.plants.composite import Composite
from hoopd.plants.found_effects import Found

Array = NDArray[np.float64]
State = tuple[float, float, float, float]

STEP_S = 0.001
# The past that is kept, beyond the largest latency: a picture is looked at when it is taken.
MEMORY_S = 0.05
SAME_S = 1e-9


class HiddenPlant:
    """What `RigPlant` is, with effects: plant, drive and sensors as they really are."""

    def __init__(self, found: Found, x0: Vector, *, held: bool = False, hold_s: float = 0.0) -> None:
        """`held`, `hold_s`: as of `RigPlant`."""
        self._composite = c = Composite(found.plant, found.effects(), substeps=1)
        values = found.values
        self._delay_s = c.delay_s(values)
        self._late = {channel: c.latency_s(channel, values) for channel in ("theta", "dtheta", "psi")}
        self._step, self._read = _functions(c, found)
        self._z = c.beginning(np.asarray(x0, float))
        self._t, self._held, self._hold_s = 0.0, held, hold_s
        self._torques: deque[tuple[float, float]] = deque([(-np.inf, 0.0)])  # from when on
        self._past: deque[tuple[float, Array]] = deque([(0.0, self._z)])

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
        z = self._at(self._t - self._late["psi"])
        theta, dtheta, _, dpsi = _state(z)
        return theta, dtheta, float(self._read.vector(z, self._t)[2]), dpsi

    def sample(self) -> tuple[float, float, float]:
        """theta, dtheta as the encoder gives them now, and no current of its own."""
        theta, dtheta = (
            float(self._read.vector(self._at(self._t - self._late[name]), self._t)[row])
            for row, name in enumerate(("theta", "dtheta"))
        )
        return theta, dtheta, nan

    def advance(self, t: float, torque_nm: float) -> None:
        """Go on to `t` with the torque demanded."""
        if self._held and torque_nm != 0.0 and self._t >= self._hold_s:
            self._held = False
        if self._held:
            self._t = max(t, self._t)
            self._past = deque([(self._t, self._z)])
        if torque_nm != self._torques[-1][1]:
            self._torques.append((self._t, torque_nm))
        while t - self._t > SAME_S:
            self._go(min(t, self._next_torque()))

    def _next_torque(self) -> float:
        """When another torque arrives; what has arrived is dropped."""
        while len(self._torques) > 1 and self._torques[1][0] + self._delay_s <= self._t + SAME_S:
            self._torques.popleft()
        return self._torques[1][0] + self._delay_s if len(self._torques) > 1 else np.inf

    def _go(self, t: float) -> None:
        steps = max(1, ceil((t - self._t) / STEP_S - SAME_S))
        start, h = self._t, (t - self._t) / steps
        for index in range(steps):
            self._z = self._step.vector(self._z, self._torques[0][1], h, start + index * h)
            self._past.append((start + (index + 1) * h, self._z))
        self._t = t
        oldest = t - max(self._late.values()) - MEMORY_S
        while self._past[0][0] < oldest:
            self._past.popleft()

    def _at(self, t: float) -> Array:
        """State at a time of the past (the first one before it), in a straight line between two steps."""
        if t >= self._past[-1][0]:
            return self._past[-1][1]
        index = bisect_right(self._past, t, key=lambda one: one[0])
        if index == 0:
            return self._past[0][1]
        (t0, z0), (t1, z1) = self._past[index - 1], self._past[index]
        return np.asarray(z0 + (z1 - z0) * ((t - t0) / (t1 - t0)))


def _functions(c: Composite, found: Found) -> tuple[Call, Call]:
    """(z, u, h, t) -> z after, and (z, t) -> readings without latency."""
    z, u, h, t = ca.SX.sym("z", c.nz), ca.SX.sym("u"), ca.SX.sym("h"), ca.SX.sym("t")
    p = {name: ca.SX(value) for name, value in zip(c.names, c.vector(found.values), strict=True)}
    after = c.step_expression(z, [u], ca.SX.zeros(c.nw), h, t, p)
    seen = ca.vertcat(*(c.reading(channel, z, t, p) for channel in ("theta", "dtheta", "psi")))
    step = ca.Function("step", [z, u, h, t], [ca.densify(after)], {"cse": True})
    return Call(step), Call(ca.Function("readings", [z, t], [ca.densify(seen)]))


def _state(z: Array) -> State:
    return float(z[0]), float(z[1]), float(z[2]), float(z[3])
