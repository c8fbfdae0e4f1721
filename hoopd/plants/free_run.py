"""Free runs of any plant, with or without effects, over a time axis, and their exact derivatives.

What comes back are states and readings: readings as the sensors give them (late, wrong, lagging), states as they are.

Rules of this file: equations come from `plant_with_effects`; parameters named `free` are told to each run anew, all
others are held and stand in the equations as numbers. No step crosses a change of an input, late as it may come, and
every late reading has a node of its own. One object belongs to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.files.reading import InputError
from hoopd.plants.compiled import Chunks, kept
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.fingerprint import fingerprint
from hoopd.plants.held_input import mean_inputs, node_axis
from hoopd.plants.plant_with_effects import Composite
from hoopd.plants.run_steps import MOST_AT_ONCE, longest_step_s, nodes_of_run, steps_at_once
from hoopd.plants.sensor_readings import SensorReadings, node_index

Array = NDArray[np.float64]

# Of a run, states and derivatives of all steps: 0.8 GB.
MOST_NUMBERS = 10**8


class SimulatedRun(NamedTuple):
    """A free run at its nodes; derivatives have no columns where none were asked for."""

    states: Array  # (n, nx) in the plant's order
    readings: Array  # (n, channels)
    states_by: Array  # (n, nx, m + nx) by the free parameters, then by the start
    readings_by: Array  # (n, channels, m + nx)
    lagging: Array  # (n, nz - nx) what follows behind lags: the torque, then readings


class FreeRun:
    """What simulates a plant again and again.

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
        Longest Runge-Kutta step; half of the plant's usual sample time without it. Effects that need shorter ones
        have them.

    Examples
    --------
    A mass that a constant force of 2 N pushes for a second, and how its way answers to its mass:

    >>> import casadi as ca
    >>> from hoopd.plants.declaration import Channel, Input, Plant
    >>> plant = Plant(
    ...     name="mass", coordinates=("x",), accelerations=lambda s, force: force / s.p["m"], values={"m": 4.0},
    ...     free=("m",), inputs=(Input("F", "N", coordinate="x"),), channels={"x": Channel("x", "m")},
    ... )
    >>> run = FreeRun(plant, free=("m",)).run_with_sensitivity([4.0], [0.0, 0.0], [0.0, 0.5, 1.0], [2.0, 2.0])
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
    ) -> None:
        neutral = {effect.key(name): value for effect in effects for name, value in effect.neutral().items()}
        known = {**plant.values, **neutral, **(values or {})}
        # what is held is a number in the equations
        held = {name: value for name, value in known.items() if name not in free}
        # a drive without effects gives what it is asked for: the limit is the controller's
        limited = any(one.torque is not None or one.lag is not None for one in effects)
        self.composite = c = Composite(plant, effects, 1, limited=limited, numbers=held)
        self.free, self.values = tuple(free), {name: known.get(name, value) for name, value in c.values.items()}
        if unknown := [name for name in self.free if name not in c.names]:
            raise ValueError(f"{plant.name} has no parameter {', '.join(unknown)}")
        self.step_s = min(plant.time_scale_s / 2.0 if step_s is None else step_s, longest_step_s(c, held))
        # what the equations are made of: neither nominal values nor what judges recordings
        made_of = (plant.states, plant.accelerations, plant.rates, plant.inputs, plant.channels, plant.held)
        self._key = (
            fingerprint((*made_of, plant.time_scale_s, tuple(plant.values))),
            tuple(map(fingerprint, effects)),
            limited,
            fingerprint(held),
        )
        self._sensors = SensorReadings(c, self.free)
        self._runners: dict[int, Chunks] = {}

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike | None = None) -> SimulatedRun:
        """From x0 (nx,) at the first of the nodes t (n,) s with the inputs u held between them.

        x0: the plant's state, or with what lags behind it (nz,), which else has settled; u: (n-1,) of one input,
        (n-1, inputs) of several, None or (n-1, 0) of none.
        """
        return self._simulated(p, x0, t, u, derivatives=False)

    def run_with_sensitivity(
        self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike | None = None
    ) -> SimulatedRun:
        """The same with exact derivatives, taken through the integration steps themselves."""
        return self._simulated(p, x0, t, u, derivatives=True)

    def states(
        self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike | None = None, *, derivatives: bool = False
    ) -> tuple[Array, Array]:
        """States (n, nx) alone, and their derivatives (n, nx, m + nx; no columns without them)."""
        c = self.composite
        t, u, _ = node_axis(t, u, len(c.plant.inputs))
        values = self._told(p)
        nodes = nodes_of_run(t, u, c.delay_s(values), []) if c.delays else t
        z, s = self._run(values, np.asarray(x0, float), nodes, t, u, derivatives)
        at = node_index(nodes, t) if len(nodes) > len(t) else slice(None)
        return z[at, : c.nx], s[at, : c.nx]

    # ------------------------------------------------------------------------------------------ run

    def _told(self, p: ArrayLike) -> dict[str, float]:
        return {**self.values, **dict(zip(self.free, np.asarray(p, float), strict=True))}

    def _simulated(
        self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike | None, *, derivatives: bool
    ) -> SimulatedRun:
        c = self.composite
        t, u, _ = node_axis(t, u, len(c.plant.inputs))
        values = self._told(p)
        nodes = nodes_of_run(t, u, c.delay_s(values), [d for d in self._sensors.latencies_s(values) if d > 0.0])
        z, s = self._run(values, np.asarray(x0, float), nodes, t, u, derivatives)
        readings, by = self._sensors.at(t, values, nodes, u, z, s)
        at = node_index(nodes, t)
        return SimulatedRun(z[at, : c.nx], readings, s[at, : c.nx], by, z[at, c.nx :])

    def _run(
        self, values: dict[str, float], x0: Array, nodes: Array, t: Array, u: Array, derivatives: bool
    ) -> tuple[Array, Array]:
        """z (n, nz) at the nodes and its derivatives (n, nz, m + nx) by free parameters and start (none: 0 columns)."""
        c, start = self.composite, self._start(x0, u)
        if not derivatives:
            return self._forward(values, start, nodes, t, u), np.zeros((len(nodes), c.nz, 0))
        by = self._first_sensitivity(settled=len(x0) < c.nz)
        first = np.concatenate([start, by.T.ravel()])
        rows = self._forward(values, first, nodes, t, u)
        return rows[:, : c.nz], rows[:, c.nz :].reshape(len(rows), len(self.free) + c.nx, c.nz).transpose(0, 2, 1)

    def _forward(self, values: Mapping[str, float], first: Array, nodes: Array, t: Array, u: Array) -> Array:
        """Rows at the nodes from the first of them: z alone, or z with its derivatives, as the first row is."""
        h = np.diff(nodes)
        steps = np.maximum(1, np.ceil(h / self.step_s - 1e-6))
        if not steps.sum() * len(first) <= MOST_NUMBERS:
            reason = f"{nodes[-1] - nodes[0]:g} s in steps of {self.step_s:.3g} s are {steps.sum():.3g} steps"
            name = self.composite.plant.name
            raise InputError(name, "", f"{reason}, more than memory holds: cut it, or take longer steps")
        steps, plain = steps.astype(int), len(first) == self.composite.nz
        # rows of as many steps as divide those of every interval
        at_once = steps_at_once(steps) if plain else 1
        uneven = plain and at_once == 1 and steps.sum() > MOST_AT_ONCE
        step = h / steps
        steps //= at_once
        last, length = np.cumsum(steps), np.repeat(h / steps, steps)
        times: list[Array] = []
        delay, simple = self.composite.delay_s(values), nodes is t and not self._timed
        if not simple:
            begin = np.repeat(nodes[:-1], steps) + (np.arange(last[-1]) - np.repeat(last - steps, steps)) * length
            times = [begin] if self._timed else []
        if simple and delay == 0.0:
            held = np.repeat(u, steps, axis=0)
        else:
            held = mean_inputs(np.column_stack([begin, begin + length]), t, u, delay)
        columns = (held, np.repeat(step, steps), *times)
        if uneven:
            rows = self._uneven(first, columns, self._vector(values))
        else:
            runner = self._plain(at_once) if plain else self._with_derivatives
            rows = runner(first, columns, self._vector(values))
        return np.concatenate([first[None], rows[last - 1]])

    def _uneven(self, first: Array, columns: Sequence[Array], p: Array) -> Array:
        """States (n, nz) after steps each of which has a length of its own, MOST_AT_ONCE of them in a row."""
        # the last row is filled up by repeating its last step
        fill = -len(columns[0]) % MOST_AT_ONCE
        rows = [
            np.concatenate([one, np.repeat(one[-1:], fill, axis=0)]).reshape(-1, MOST_AT_ONCE * (one.size // len(one)))
            for one in columns
        ]
        start = np.tile(first, MOST_AT_ONCE)
        return self._each(start, rows, p).reshape(-1, self.composite.nz)[: len(columns[0])]

    def _start(self, x0: Array, u: Array) -> Array:
        """z (nz,) of the plant's state; a whole z is its own start."""
        return x0 if len(x0) == self.composite.nz else self.composite.beginning(x0, float(u[0, 0]))

    def _first_sensitivity(self, *, settled: bool) -> Array:
        """(nz, m + nx): what lags starts settled, or where it is told."""
        c, m = self.composite, len(self.free)
        by = np.zeros((c.nz, m + c.nx))
        for column, bump in enumerate(np.eye(c.nx)):
            by[:, m + column] = c.beginning(bump)
        if not settled:
            by[c.nx :] = 0.0
        return by

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

    @cached_property
    def _symbols(self) -> tuple[Any, ...]:
        c = self.composite
        u = ca.SX.sym("u", c.nu)
        return ca.SX.sym("z", c.nz), u, ca.SX.sym("h"), ca.SX.sym("t"), ca.SX.sym("p", len(c.names))

    def _plain(self, at_once: int) -> Chunks:
        if at_once not in self._runners:
            made = kept(("run", at_once, *self._key), lambda: self._plain_steps(at_once))
            self._runners[at_once] = Chunks(made, accumulates=True)
        return self._runners[at_once]

    def _plain_steps(self, count: int) -> ca.Function:
        """So many steps of h seconds each."""
        z, u, h, t, p = self._symbols
        after = z
        for index in range(count):
            after = self._after(after, u, h, t + index * h, p)
        return ca.Function("steps", self._told_to(z, u, h, t, p), [after])

    @cached_property
    def _each(self) -> Chunks:
        return Chunks(kept(("each", *self._key), self._each_step), accumulates=True)

    def _each_step(self) -> ca.Function:
        """Steps with their own inputs, lengths and times: all states after them, the last one begins the next row."""
        _, u, _, _, p = self._symbols
        nz, count = self.composite.nz, MOST_AT_ONCE
        before, inputs = ca.SX.sym("z", nz * count), ca.SX.sym("u", u.numel() * count)
        h, t = ca.SX.sym("h", count), ca.SX.sym("t", count)
        after = [before[-nz:]]
        for k, held in enumerate(ca.vertsplit(inputs, u.numel())):
            after.append(self._after(after[-1], held, h[k], t[k], p))
        return ca.Function("each", self._told_to(before, inputs, h, t, p), [ca.vertcat(*after[1:])])

    @cached_property
    def _with_derivatives(self) -> Chunks:
        return Chunks(kept(("both", *self._key, self.free), self._step_with_derivatives), accumulates=True)

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
    def _places(self) -> list[int]:
        return [self.composite.names.index(name) for name in self.free]

    def _after(self, z: Any, u: Any, h: Any, t: Any, p: Any) -> Any:
        return self.composite.step_function(z, u.T, ca.SX.zeros(self.composite.nw), h, t, p)


# ---------------------------------------------------------------------------------------------- one run


def run(
    composite: Composite, values: Mapping[str, float], x0: ArrayLike, t: ArrayLike, u: ArrayLike | None = None
) -> Array:
    """Run a plant with its effects freely, from node to node.

    Parameters
    ----------
    composite : Composite
        The plant and its effects.
    values : mapping of str to float
        Parameters by name, those of effects as `slot.effect.parameter`.
    x0 : array_like, shape (nx,) or (nz,)
        State of the plant at the first node; with what lags behind it, or that has settled.
    t : array_like, shape (n,)
        Nodes in s.
    u : array_like, shape (n - 1,) or (n - 1, inputs), optional
        Inputs held between the nodes; a plant without an input needs none.

    Returns
    -------
    ndarray, shape (n, nz)
        States at the nodes: the plant's, then those of its effects.

    Raises
    ------
    ValueError
        Nodes and inputs that do not fit.

    Examples
    --------
    >>> from hoopd.plants.plant_with_effects import Composite
    >>> from hoopd.plants.free_run import run
    >>> from hoopd.plants.registry import plant_named
    >>> axis = Composite(plant_named("axis"))
    >>> values = {**axis.values, "M": 100.0, "Fv": 0.0, "offset": 0.0}
    >>> run(axis, values, [0.0, 0.0], [0.0, 0.005, 0.01], [200.0, 200.0])[-1].round(6).tolist()  # 2 m/s2 for 10 ms
    [0.0001, 0.02]
    """
    found = _simulated(composite, values, x0, t, u)
    return np.hstack([found.states, found.lagging])


def readings(
    composite: Composite, values: Mapping[str, float], x0: ArrayLike, t: ArrayLike, u: ArrayLike | None = None
) -> dict[str, Array]:
    """Give what each channel reads in a free run.

    Parameters
    ----------
    composite : Composite
        The plant and its effects.
    values : mapping of str to float
        Parameters by name, those of effects as `slot.effect.parameter`.
    x0 : array_like, shape (nx,) or (nz,)
        State of the plant at the first node; with what lags behind it, or that has settled.
    t : array_like, shape (n,)
        Nodes in s.
    u : array_like, shape (n - 1,) or (n - 1, inputs), optional
        Inputs held between the nodes; a plant without an input needs none.

    Returns
    -------
    dict of str to ndarray
        The readings at the nodes, by channel.

    Examples
    --------
    >>> from hoopd.plants.plant_with_effects import Composite
    >>> from hoopd.plants.free_run import readings
    >>> from hoopd.plants.registry import plant_named
    >>> axis = Composite(plant_named("axis"))
    >>> readings(axis, axis.values, [0.1, 0.0], [0.0, 0.005, 0.01], [0.0, 0.0])["x"].round(3).tolist()
    [0.1, 0.1, 0.1]
    """
    found = _simulated(composite, values, x0, t, u)
    return dict(zip(composite.channels, found.readings.T, strict=True))


def free_run_of(composite: Composite) -> FreeRun:
    """What simulates a composite with its steps, all parameters free; an effect may bring another kind of run."""
    kind = next((effect.free_run for effect in composite.effects if effect.free_run is not None), FreeRun)
    step_s = composite.longest_step_s / composite.substeps
    made: FreeRun = kind(composite.declared, composite.effects, composite.names, step_s=step_s)
    return made


_KEPT: WeakKeyDictionary[Composite, FreeRun] = WeakKeyDictionary()


def _simulated(
    composite: Composite, values: Mapping[str, float], x0: ArrayLike, t: ArrayLike, u: ArrayLike | None
) -> SimulatedRun:
    if composite not in _KEPT:
        _KEPT[composite] = free_run_of(composite)
    return _KEPT[composite].run(composite.vector(values), x0, t, u)
