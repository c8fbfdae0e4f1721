"""Free runs of a plant with found effects over a time axis, with derivatives: what `simulate.Model` is without them.

What comes back are readings: theta, dtheta and psi as the sensors give them (late, wrong, lagging), and dpsi as it is.

Rules of this file: equations come from `composite`; the effects' numbers are held, parameters of the base may be free.
No step crosses a change of the torque, late as it may come, and every late reading has a node of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.composite import BACK_STEPS, LONGEST_STEP_S, Composite
from hoopd.plants.found_effects import Found
from hoopd.plants.free_run import Chunks
from hoopd.plants.held_input import SAME_S, mean_torque
from hoopd.plants.hoop.equations import ExtraForce
from hoopd.plants.hoop.simulate import CHUNK, STEP_S, Model, Trajectory, node_axis

Array = NDArray[np.float64]

STATES = ("theta", "dtheta", "psi", "dpsi")


class EffectModel:
    """The interface of `simulate.Model`; `free`: base parameters that a run is told anew."""

    def __init__(self, found: Found, free: Sequence[str] = (), *, moving: str = "both", step_s: float = STEP_S) -> None:
        """`moving`: both, hoop or ball; effects that what moves does not feel are left out."""
        plant = found.plant_of(moving)
        self._composite = c = Composite(plant, found.effects(plant))
        # a step of the composite is so many Runge-Kutta steps
        self.free, self.step_s = tuple(free), min(step_s * c.substeps, LONGEST_STEP_S)
        self._values = {name: found.values.get(name, value) for name, value in c.values.items()}
        self._columns = [STATES.index(name) for name in plant.states if name in STATES]

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        """Readings (n, 4) at the nodes t (n,) s from x0 (4,) with torques u (n-1,) N m held between them."""
        t, u, _ = node_axis(t, u)
        return self._readings(p, np.asarray(x0, float), t, u, derivatives=False)[0]

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Trajectory:
        """The same with exact derivatives by the free parameters and the start."""
        t, u, _ = node_axis(t, u)
        x, by = self._readings(p, np.asarray(x0, float), t, u, derivatives=True)
        m = len(self.free)
        return Trajectory(x, by[:, :, :m], by[:, :, m:])

    # ------------------------------------------------------------------------------------------ run

    def _readings(self, p: ArrayLike, x0: Array, t: Array, u: Array, *, derivatives: bool) -> tuple[Array, Array]:
        c = self._composite
        values = {**self._values, **dict(zip(self.free, np.asarray(p, float), strict=True))}
        late = {channel: c.latency_s(channel, values) for channel in c.channels}
        nodes = _union(t, u, c.delay_s(values), [d for d in late.values() if d > 0.0])
        z, s = self._run(values, x0, nodes, t, u, derivatives)
        out, by = np.zeros((len(t), 4)), np.zeros((len(t), 4, s.shape[2]))
        at = _index(nodes, t)
        for row, column in enumerate(self._columns):
            out[:, column], by[:, column] = z[at, row], s[at, row]
        for channel in c.channels:
            column = STATES.index(c.plant.state_of(channel))
            found = self._channel(channel, late[channel], values, nodes, t, u, z, s)
            out[:, column], by[:, column] = found
        return out, by

    def _run(
        self, values: dict[str, float], x0: Array, nodes: Array, t: Array, u: Array, derivatives: bool
    ) -> tuple[Array, Array]:
        """z (n, nz) at the nodes and its derivatives (n, nz, m + 4) by free parameters and start (none: 0 columns)."""
        c = self._composite
        h = np.diff(nodes)
        steps = np.maximum(1, np.ceil(h / self.step_s - 1e-6)).astype(int)
        last = np.cumsum(steps)
        length = np.repeat(h / steps, steps)
        begin = np.repeat(nodes[:-1], steps) + (np.arange(last[-1]) - np.repeat(last - steps, steps)) * length
        torque = np.asarray(mean_torque(np.column_stack([begin, begin + length]), t, u, c.delay_s(values)))
        start = c.beginning(x0[self._columns], float(u[0]))
        first = start if not derivatives else np.concatenate([start, self._first_sensitivity().T.ravel()])
        runner = self._with_derivatives if derivatives else self._plain
        rows = runner(first, (torque, length, begin), c.vector(values))
        rows = np.concatenate([first[None], rows[last - 1]])
        columns = len(self.free) + 4 if derivatives else 0
        s = rows[:, c.nz :].reshape(len(rows), columns, c.nz).transpose(0, 2, 1)
        return rows[:, : c.nz], s

    def _first_sensitivity(self) -> Array:
        """(nz, m + 4): what lags starts settled."""
        c, m = self._composite, len(self.free)
        by = np.zeros((c.nz, m + 4))
        for row, column in enumerate(self._columns):
            bump = np.zeros(len(self._columns))
            bump[row] = 1.0
            by[:, m + column] = c.beginning(bump)
        return by

    def _channel(
        self,
        channel: str,
        late: float,
        values: dict[str, float],
        nodes: Array,
        t: Array,
        u: Array,
        z: Array,
        s: Array,
    ) -> tuple[Array, Array]:
        """One channel's readings (n,) at t and their derivatives (n, m + 4)."""
        c, row, vector = self._composite, self._composite.channels.index(channel), self._composite.vector(values)
        out, by = np.zeros(len(t)), np.zeros((len(t), s.shape[2]))
        inside = t - late >= nodes[0] - SAME_S
        when = t[inside] - late
        at = _index(nodes, when)
        found = self._seen(None, (z[at], when), vector)
        out[inside] = found[:, row]
        by[inside] = self._chain(found, row, s[at])
        for index in np.flatnonzero(~inside):
            shortened = vector.copy()
            shortened[c.names.index(c.latencies[channel])] = late - (t[index] - nodes[0])
            back = np.full((len(c.channels), BACK_STEPS), u[0])
            y, by_z, by_p = self._outputs(z[0], back, np.zeros(c.nq), nodes[0], shortened)
            out[index] = float(y[row])
            if s.shape[2]:
                by[index] = by_z.full()[row] @ s[0]
                by[index, : len(self.free)] += by_p.full()[row]
        return out, by

    def _chain(self, found: Array, row: int, s: Array) -> Array:
        """Derivatives of readings through the state's and by the parameters themselves."""
        if not s.shape[2]:
            return np.zeros((len(found), 0))
        c, m = self._composite, len(self.free)
        y, rest = len(c.channels), found[:, len(c.channels) :]
        by_z = rest[:, : y * c.nz].reshape(len(found), c.nz, y)[:, :, row]
        by_p = rest[:, y * c.nz :].reshape(len(found), m, y)[:, :, row]
        by = np.einsum("nz,nzk->nk", by_z, s)
        by[:, :m] += by_p
        return np.asarray(by)

    # ------------------------------------------------------------------------------------------ functions

    @cached_property
    def _symbols(self) -> tuple[Any, ...]:
        c = self._composite
        return ca.SX.sym("z", c.nz), ca.SX.sym("u"), ca.SX.sym("h"), ca.SX.sym("t"), ca.SX.sym("p", len(c.names))

    @cached_property
    def _plain(self) -> Chunks:
        z, u, h, t, p = self._symbols
        step = ca.Function("step", [z, u, h, t, p], [self._after(z, u, h, t, p)])
        return Chunks(step.mapaccum("run", CHUNK), accumulates=True)

    @cached_property
    def _with_derivatives(self) -> Chunks:
        z, u, h, t, p = self._symbols
        c, m = self._composite, len(self.free)
        s, after = ca.SX.sym("s", c.nz, m + 4), self._after(z, u, h, t, p)
        # S_k+1 = dF/dz S_k + [dF/dp, 0]
        by_p = ca.horzcat(ca.densify(ca.jacobian(after, p)[:, self._places]), ca.SX.zeros(c.nz, 4))
        s_after = ca.densify(ca.mtimes(ca.jacobian(after, z), s) + by_p)
        both, both_after = ca.vertcat(z, ca.vec(s)), ca.vertcat(after, ca.vec(s_after))
        step = ca.Function("both", [both, u, h, t, p], [both_after], {"cse": True})
        return Chunks(step.mapaccum("both", CHUNK), accumulates=True)

    @cached_property
    def _seen(self) -> Chunks:
        """Readings of a state, their derivatives by it and by the free parameters, in one column."""
        z, _, _, t, p = self._symbols
        c = self._composite
        y = c.reading_function(z, t, p)
        parts = (y, ca.vec(ca.densify(ca.jacobian(y, z))), ca.vec(ca.densify(ca.jacobian(y, p)[:, self._places])))
        return Chunks(ca.Function("seen", [z, t, p], [ca.densify(ca.vertcat(*parts))], {"cse": True}).map(CHUNK))

    @cached_property
    def _outputs(self) -> ca.Function:
        return self._composite.output_derivatives(self.free)

    @property
    def _places(self) -> list[int]:
        return [self._composite.names.index(name) for name in self.free]

    def _after(self, z: Any, u: Any, h: Any, t: Any, p: Any) -> Any:
        c = self._composite
        return c.step_function(z, ca.repmat(u, c.substeps, 1), ca.SX.zeros(c.nq), h, t, p)


def model_of(
    structure: str,
    values: Mapping[str, float],
    free: Sequence[str] = (),
    extra_forces: tuple[ExtraForce, ...] = (),
    effects: Found | None = None,
    *,
    moving: str = "both",
    step_s: float = STEP_S,
) -> Model | EffectModel:
    """What simulates a plant again and again, with effects where there are some; ValueError for two kinds of forces."""
    if not effects:
        return Model(structure, values, free, extra_forces, moving=moving, step_s=step_s)
    if extra_forces:
        raise ValueError("forces are either effects or functions, not both")
    found = effects.on(structure, values)
    return EffectModel(found, free, moving=moving, step_s=step_s)


def _union(t: Array, u: Array, delay_s: float, late: Sequence[float]) -> Array:
    """Nodes: those of the axis, where a late torque changes, where a late reading was taken."""
    parts = [t]
    if delay_s > 0.0:
        changes = t[1:-1][np.diff(u) != 0.0] + delay_s
        parts.append(changes[changes < t[-1]])
    for d in late:
        parts.append((t - d)[t - d > t[0]])
    nodes = np.sort(np.concatenate(parts))
    return np.asarray(nodes[np.concatenate([[True], np.diff(nodes) > SAME_S])])


def _index(nodes: Array, when: Array) -> NDArray[np.intp]:
    """The node at each of these times, which are all nodes."""
    return np.clip(np.searchsorted(nodes, when - 2.0 * SAME_S), 0, len(nodes) - 1)
