"""Free runs of any plant, with or without effects, over a time axis, and their exact derivatives.

What comes back are states and readings: readings as the sensors give them (late, wrong, lagging), states as they are.

Rules of this file: equations come from `composite`; parameters named `free` are told to each run anew, all others are
held. No step crosses a change of an input, late as it may come, and every late reading has a node of its own. One
object belongs to one thread.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.composite import BACK_STEPS, Composite
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.fingerprint import fingerprint
from hoopd.plants.free_run import CHUNK, Chunks
from hoopd.plants.held_input import SAME_S, mean_inputs

Array = NDArray[np.float64]

# Functions that are kept for the next model of the same kind.
KEPT = 32


class SimulatedRun(NamedTuple):
    """A free run at its nodes; derivatives have no columns where none were asked for."""

    states: Array  # (n, nx) in the plant's order
    readings: Array  # (n, channels)
    states_by: Array  # (n, nx, m + nx) by the free parameters, then by the start
    readings_by: Array  # (n, channels, m + nx)


class FreeRunModel:
    """What a fit simulates again and again.

    Parameters
    ----------
    plant
        Any declared plant.
    effects
        What it has beside its equations.
    free
        Parameters of the plant or its effects that a run is told anew.
    values
        Parameters by name; what is not named is nominal (of an effect: neutral).
    step_s
        Longest Runge-Kutta step; half of the plant's usual sample time without it.
    substeps
        Runge-Kutta steps between two changes of the input, in place of what the effects need.

    Examples
    --------
    A mass that a constant force of 2 N pushes for a second, and how its way answers to its mass:

    >>> import casadi as ca
    >>> from hoopd.plants.declaration import Channel, Input, Plant
    >>> plant = Plant(
    ...     name="mass", coordinates=("x",), accelerations=lambda s, force: force / s.p["m"], values={"m": 4.0},
    ...     free=("m",), inputs=(Input("F", "N", coordinate="x"),), channels={"x": Channel("x", "m")},
    ... )
    >>> run = FreeRunModel(plant, free=("m",)).run_with_sensitivity([4.0], [0.0, 0.0], [0.0, 0.5, 1.0], [2.0, 2.0])
    >>> run.readings[:, 0].round(9).tolist(), run.readings_by[-1, 0].round(9).tolist()
    ([0.0, 0.0625, 0.25], [-0.0625, 1.0, 1.0])
    """

    def __init__(
        self,
        plant: Plant,
        effects: Sequence[Effect] = (),
        free: Sequence[str] = (),
        *,
        values: Mapping[str, float] | None = None,
        step_s: float | None = None,
        substeps: int | None = None,
    ) -> None:
        # without effects a step is one of Runge-Kutta's, and what is held is a number in the equations
        count = substeps or (None if effects else 1)
        known = {**plant.values, **(values or {})}
        fixed = None if effects else {name: value for name, value in known.items() if name not in free}
        limited = any(one.torque is not None or one.lag is not None for one in effects)
        self.composite = c = Composite(plant, effects, count, limited=limited, numbers=fixed)
        # what the equations are made of: neither nominal values nor what judges recordings
        made_of = (plant.states, plant.accelerations, plant.rates, plant.inputs, plant.channels, plant.held)
        self._key = (
            fingerprint((*made_of, plant.time_scale_s, tuple(plant.values))),
            tuple(map(fingerprint, effects)),
            count,
            limited,
            fingerprint(fixed),
        )
        half = plant.time_scale_s / 2.0 if step_s is None else step_s
        # a step of the composite is so many Runge-Kutta steps
        self.free, self.step_s = tuple(free), min(half * c.substeps, c.longest_step_s)
        self.values = {name: (values or {}).get(name, value) for name, value in c.values.items()}
        if unknown := [name for name in self.free if name not in c.names]:
            raise ValueError(f"{plant.name} has no parameter {', '.join(unknown)}")

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> SimulatedRun:
        """From x0 (nx,) at the first of the nodes t (n,) s with the inputs u held between them.

        u: (n-1,) of one input, (n-1, inputs) of several, (n-1, 0) of none.
        """
        return self._simulated(p, x0, t, u, derivatives=False)

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> SimulatedRun:
        """The same with exact derivatives, taken through the integration steps themselves."""
        return self._simulated(p, x0, t, u, derivatives=True)

    def states(
        self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike, *, derivatives: bool = False
    ) -> tuple[Array, Array]:
        """States (n, nx) alone, and their derivatives (n, nx, m + nx; no columns without them)."""
        c = self.composite
        t, u = _axis(t, u, self._inputs)
        values = self._told(p)
        nodes = _union(t, u, c.delay_s(values), []) if c.delays else t
        z, s = self._run(values, np.asarray(x0, float), nodes, t, u, derivatives)
        at = _index(nodes, t) if len(nodes) > len(t) else slice(None)
        return z[at, : c.nx], s[at, : c.nx]

    # ------------------------------------------------------------------------------------------ run

    def _told(self, p: ArrayLike) -> dict[str, float]:
        return {**self.values, **dict(zip(self.free, np.asarray(p, float), strict=True))}

    def _simulated(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike, *, derivatives: bool) -> SimulatedRun:
        c = self.composite
        t, u = _axis(t, u, self._inputs)
        values = self._told(p)
        late = {channel: c.latency_s(channel, values) for channel in c.channels}
        nodes = _union(t, u, c.delay_s(values), [d for d in late.values() if d > 0.0])
        z, s = self._run(values, np.asarray(x0, float), nodes, t, u, derivatives)
        readings, by = np.zeros((len(t), len(late))), np.zeros((len(t), len(late), s.shape[2]))
        for row, channel in enumerate(c.channels):
            readings[:, row], by[:, row] = self._channel(channel, late[channel], values, nodes, t, u, z, s)
        at = _index(nodes, t)
        return SimulatedRun(z[at, : c.nx], readings, s[at, : c.nx], by)

    def _run(
        self, values: dict[str, float], x0: Array, nodes: Array, t: Array, u: Array, derivatives: bool
    ) -> tuple[Array, Array]:
        """z (n, nz) at the nodes and its derivatives (n, nz, m + nx) by free parameters and start (none: 0 columns)."""
        c = self.composite
        h = np.diff(nodes)
        steps = np.maximum(1, np.ceil(h / self.step_s - 1e-6)).astype(int)
        last = np.cumsum(steps)
        length = np.repeat(h / steps, steps)
        times: list[Array] = []
        delay, simple = c.delay_s(values), nodes is t and not self._timed
        if not simple:
            begin = np.repeat(nodes[:-1], steps) + (np.arange(last[-1]) - np.repeat(last - steps, steps)) * length
            times = [begin] if self._timed else []
        if simple and delay == 0.0:
            held = np.repeat(u, steps, axis=0)
        else:
            held = mean_inputs(np.column_stack([begin, begin + length]), t, u, delay)
        start = c.beginning(x0, float(u[0, 0]))
        first = start if not derivatives else np.concatenate([start, self._first_sensitivity().T.ravel()])
        runner = self._with_derivatives if derivatives else self._plain
        rows = runner(first, (held, length, *times), self._vector(values))
        rows = np.concatenate([first[None], rows[last - 1]])
        columns = len(self.free) + c.nx if derivatives else 0
        s = rows[:, c.nz :].reshape(len(rows), columns, c.nz).transpose(0, 2, 1)
        return rows[:, : c.nz], s

    def _first_sensitivity(self) -> Array:
        """(nz, m + nx): what lags starts settled."""
        c, m = self.composite, len(self.free)
        by = np.zeros((c.nz, m + c.nx))
        for column, bump in enumerate(np.eye(c.nx)):
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
        """One channel's readings (n,) at t and their derivatives (n, m + nx)."""
        c, row, vector = self.composite, self.composite.channels.index(channel), self.composite.vector(values)
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
            back = np.tile(u[0], (len(c.channels), BACK_STEPS))
            y, by_z, by_p = self._outputs(z[0], back, np.zeros(c.nw), nodes[0], shortened)
            out[index] = float(y[row])
            if s.shape[2]:
                by[index] = by_z.full()[row] @ s[0]
                by[index, : len(self.free)] += by_p.full()[row]
        return out, by

    def _chain(self, found: Array, row: int, s: Array) -> Array:
        """Derivatives of readings through the state's and by the parameters themselves."""
        if not s.shape[2]:
            return np.zeros((len(found), 0))
        c, m = self.composite, len(self.free)
        y, rest = len(c.channels), found[:, len(c.channels) :]
        by_z = rest[:, : y * c.nz].reshape(len(found), c.nz, y)[:, :, row]
        by_p = rest[:, y * c.nz :].reshape(len(found), m, y)[:, :, row]
        by = np.einsum("nz,nzk->nk", by_z, s)
        by[:, :m] += by_p
        return np.asarray(by)

    # ------------------------------------------------------------------------------------------ functions

    @cached_property
    def _timed(self) -> bool:
        """Whether the steps depend on the time; else they are not told it."""
        z, u, h, t, p = self._symbols
        return bool(ca.depends_on(self._after(z, u, h, t, p), t))

    def _told_to(self, z: Any, u: Any, h: Any, t: Any, p: Any) -> list[Any]:
        return [z, u, h, t, p] if self._timed else [z, u, h, p]

    @cached_property
    def _nominal(self) -> Array:
        return self.composite.vector(self.values)

    def _vector(self, values: Mapping[str, float]) -> Array:
        """Parameters in the composite's order; only the free ones are other than nominal."""
        vector = self._nominal.copy()
        vector[self._places] = [values[name] for name in self.free]
        return vector

    @property
    def _inputs(self) -> int:
        """Held numbers of a step: one also where there is no input."""
        return self.composite.nu

    @cached_property
    def _symbols(self) -> tuple[Any, ...]:
        c = self.composite
        u = ca.SX.sym("u", self._inputs)
        return ca.SX.sym("z", c.nz), u, ca.SX.sym("h"), ca.SX.sym("t"), ca.SX.sym("p", len(c.names))

    @cached_property
    def _plain(self) -> Chunks:
        return Chunks(_kept(("run", *self._key), self._plain_step), accumulates=True)

    def _plain_step(self) -> ca.Function:
        z, u, h, t, p = self._symbols
        return ca.Function("step", self._told_to(z, u, h, t, p), [self._after(z, u, h, t, p)])

    @cached_property
    def _with_derivatives(self) -> Chunks:
        return Chunks(_kept(("both", *self._key, self.free), self._step_with_derivatives), accumulates=True)

    def _step_with_derivatives(self) -> ca.Function:
        z, u, h, t, p = self._symbols
        c, m = self.composite, len(self.free)
        s, after = ca.SX.sym("s", c.nz, m + c.nx), self._after(z, u, h, t, p)
        # S_k+1 = dF/dz S_k + [dF/dp, 0]
        by_p = ca.horzcat(ca.densify(ca.jacobian(after, p)[:, self._places]), ca.SX.zeros(c.nz, c.nx))
        s_after = ca.densify(ca.mtimes(ca.jacobian(after, z), s) + by_p)
        both, both_after = ca.vertcat(z, ca.vec(s)), ca.vertcat(after, ca.vec(s_after))
        return ca.Function("both", self._told_to(both, u, h, t, p), [both_after], {"cse": True})

    @cached_property
    def _seen(self) -> Chunks:
        """Readings of a state, their derivatives by it and by the free parameters, in one column."""
        z, _, _, t, p = self._symbols
        c = self.composite
        y = c.reading_function(z, t, p)
        parts = (y, ca.vec(ca.densify(ca.jacobian(y, z))), ca.vec(ca.densify(ca.jacobian(y, p)[:, self._places])))
        return Chunks(ca.Function("seen", [z, t, p], [ca.densify(ca.vertcat(*parts))], {"cse": True}).map(CHUNK))

    @cached_property
    def _outputs(self) -> ca.Function:
        return self.composite.output_derivatives(self.free)

    @cached_property
    def _places(self) -> list[int]:
        return [self.composite.names.index(name) for name in self.free]

    def _after(self, z: Any, u: Any, h: Any, t: Any, p: Any) -> Any:
        c = self.composite
        return c.step_function(z, ca.repmat(u.T, c.substeps, 1), ca.SX.zeros(c.nw), h, t, p)


# Functions of the models made last: a fit makes several of one kind in a row.
_FUNCTIONS: OrderedDict[Hashable, ca.Function] = OrderedDict()


def _kept(key: Hashable, make: Callable[[], ca.Function]) -> ca.Function:
    """CHUNK steps of a function, made once for models of the same kind."""
    if key not in _FUNCTIONS:
        _FUNCTIONS[key] = make().mapaccum("steps", CHUNK)
        while len(_FUNCTIONS) > KEPT:
            _FUNCTIONS.popitem(last=False)
    _FUNCTIONS.move_to_end(key)
    return _FUNCTIONS[key]


def _axis(t: ArrayLike, u: ArrayLike, inputs: int) -> tuple[Array, Array]:
    """Nodes (n,) and held inputs (n-1, inputs); ValueError when they do not fit."""
    t, u = np.asarray(t, float), np.asarray(u, float)
    if t.ndim != 1 or len(t) < 2 or u.shape[:1] != (len(t) - 1,):
        raise ValueError(f"expected n nodes and n - 1 inputs, not {t.shape} and {u.shape}")
    if not (np.diff(t) > 0.0).all():
        raise ValueError("the nodes must increase")
    u = u.reshape(len(u), -1)
    u = np.zeros((len(u), 1)) if u.shape[1] == 0 else u
    if u.shape[1] != inputs:
        raise ValueError(f"expected {inputs} inputs, not {u.shape[1]}")
    return t, u


def _union(t: Array, u: Array, delay_s: float, late: Sequence[float]) -> Array:
    """Nodes: those of the axis, where a late input changes, where a late reading was taken."""
    parts = [t]
    if delay_s > 0.0:
        changes = t[1:-1][(np.diff(u, axis=0) != 0.0).any(axis=1)] + delay_s
        parts.append(changes[changes < t[-1]])
    for d in late:
        parts.append((t - d)[t - d > t[0]])
    nodes = np.sort(np.concatenate(parts))
    return np.asarray(nodes[np.concatenate([[True], np.diff(nodes) > SAME_S])])


def _index(nodes: Array, when: Array) -> NDArray[np.intp]:
    """The node at each of these times, which are all nodes."""
    return np.clip(np.searchsorted(nodes, when - 2.0 * SAME_S), 0, len(nodes) - 1)
