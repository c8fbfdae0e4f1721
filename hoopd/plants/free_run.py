"""Free runs of a plant with effects over a time axis, and what its sensors read of them.

Rules of this file: equations come from `composite`; the torque is held between two nodes and no step crosses one. Call
buffers belong to one `FreeRun`, and that to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.composite import BACK_STEPS, Composite
from hoopd.plants.held_input import SAME_S, mean_inputs, node_axis

# Steps in one call: few enough to be written out in a millisecond, many enough that the call costs nothing.
CHUNK = 50
# A distance that is longer by this share is jitter of the same tick, not worth a second step.
JITTER = 0.25

Array = NDArray[np.float64]
Index = NDArray[np.intp]


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
    x0 : array_like, shape (nx,)
        State of the plant at the first node.
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
    >>> from hoopd.plants.composite import Composite
    >>> from hoopd.plants.free_run import run
    >>> from hoopd.plants.registry import plant_named
    >>> axis = Composite(plant_named("axis"))
    >>> values = {**axis.values, "M": 100.0, "Fv": 0.0, "offset": 0.0}
    >>> run(axis, values, [0.0, 0.0], [0.0, 0.005, 0.01], [200.0, 200.0])[-1].round(6).tolist()  # 2 m/s2 for 10 ms
    [0.0001, 0.02]
    """
    return _free_run(composite).run(values, x0, t, u)


def readings(
    composite: Composite,
    values: Mapping[str, float],
    t: ArrayLike,
    u: ArrayLike | None,
    z: Array,
    channel_nodes: Mapping[str, ArrayLike] | None = None,
) -> dict[str, Array]:
    """Give what each channel reads at its nodes.

    Parameters
    ----------
    composite : Composite
        The plant and its effects.
    values : mapping of str to float
        Parameters by name.
    t : array_like, shape (n,)
        Nodes in s, as of the run.
    u : array_like, shape (n - 1,) or (n - 1, inputs), optional
        Inputs, as of the run.
    z : ndarray, shape (n, nz)
        States, as the run gave them.
    channel_nodes : mapping of str to array_like, optional
        Indices into t by channel; all of them where none are given.

    Returns
    -------
    dict of str to ndarray
        The readings by channel.

    Examples
    --------
    >>> from hoopd.plants.composite import Composite
    >>> from hoopd.plants.free_run import readings, run
    >>> from hoopd.plants.registry import plant_named
    >>> axis, t, u = Composite(plant_named("axis")), [0.0, 0.005, 0.01], [0.0, 0.0]
    >>> z = run(axis, axis.values, [0.1, 0.0], t, u)
    >>> readings(axis, axis.values, t, u, z, {"x": [0, 2]})["x"].round(3).tolist()
    [0.1, 0.1]
    """
    return _free_run(composite).readings(values, t, u, z, channel_nodes)


class FreeRun:
    """Simulates one composite again and again."""

    def __init__(self, composite: Composite) -> None:
        self._composite = c = composite
        z, torques, h, t = ca.SX.sym("z", c.nz), ca.SX.sym("torques", c.substeps, c.nu), ca.SX.sym("h"), ca.SX.sym("t")
        p = ca.SX.sym("p", len(c.names))
        step = ca.Function("step", [z, torques, h, t, p], [c.step_function(z, torques, ca.SX.zeros(c.nw), h, t, p)])
        seen = ca.Function("seen", [z, t, p], [c.reading_function(z, t, p)])
        self._accumulate = Chunks(step.mapaccum("run", CHUNK), accumulates=True)
        self._step = Chunks(step.map(CHUNK))
        self._seen = Chunks(seen.map(CHUNK))

    def run(self, values: Mapping[str, float], x0: ArrayLike, t: ArrayLike, u: ArrayLike | None = None) -> Array:
        """States z (n, nz) at the nodes t (n,) s from x0 (the plant's state, or a whole z) under the input u (n-1,).

        Several inputs are (n-1, m); before the first node the input was u[0], for what is late.
        """
        t, u, _ = node_axis(t, u, len(self._composite.plant.inputs))
        return self._forward(values, self._start(np.asarray(x0, float), u), t, u, slice(None))

    def _forward(self, values: Mapping[str, float], start: Array, t: Array, u: Array, part: slice) -> Array:
        """States at some nodes of a run from the first of them."""
        nodes = t[part]
        h = np.diff(nodes)
        steps = np.maximum(1, np.ceil(h / self._composite.longest_step_s - JITTER)).astype(int)
        last = np.cumsum(steps)
        # begin of every step: as many as each interval needs, all of the same length
        number = np.arange(last[-1]) - np.repeat(last - steps, steps)
        length = np.repeat(h / steps, steps)
        begin = np.repeat(nodes[:-1], steps) + number * length
        torques = self._torques(values, begin, length, t, u)
        after = self._accumulate(start, (torques, length, begin), self._composite.vector(values))
        return np.concatenate([start[None], after[last - 1]])

    def readings(
        self,
        values: Mapping[str, float],
        t: ArrayLike,
        u: ArrayLike | None,
        z: Array,
        channel_nodes: Mapping[str, ArrayLike] | None = None,
    ) -> dict[str, Array]:
        """Readings by channel at its nodes (indices into t; all without), from a run's t (n,), u (n-1,), z (n, nz)."""
        (t, u, _), p = node_axis(t, u, len(self._composite.plant.inputs)), self._composite.vector(values)
        every = np.arange(len(t))
        nodes = dict.fromkeys(self._composite.channels, every) if channel_nodes is None else channel_nodes
        return {c: self._channel(c, np.asarray(at, np.intp), values, p, t, u, z) for c, at in nodes.items()}

    def _channel(
        self, channel: str, at: Index, values: Mapping[str, float], p: Array, t: Array, u: Array, z: Array
    ) -> Array:
        row, late = self._composite.channels.index(channel), self._composite.latency_s(channel, values)
        if late <= 0.0:
            return self._seen(None, (z[at], t[at]), p)[:, row].copy()
        when = t[at] - late
        found = np.empty(len(at))
        inside = when >= t[0] - SAME_S
        states = self._between(when[inside], values, p, t, u, z)
        found[inside] = self._seen(None, (states, when[inside]), p)[:, row]
        for index in np.flatnonzero(~inside):
            found[index] = self._before_the_start(row, z[0], t[at[index]] - t[0], late, t, u, p)
        return found

    def _between(self, when: Array, values: Mapping[str, float], p: Array, t: Array, u: Array, z: Array) -> Array:
        """States at any times from the node before each, by the steps of the run itself."""
        node = np.clip(np.searchsorted(t, when + SAME_S, side="right") - 1, 0, len(t) - 1)
        states, at, longest = z[node].copy(), t[node].copy(), self._composite.longest_step_s
        while (rest := np.flatnonzero(when > at)).size:
            length = np.minimum(when[rest] - at[rest], longest)
            torques = self._torques(values, at[rest], length, t, u)
            states[rest] = self._step(None, (states[rest], torques, length, at[rest]), p)
            # the last step of each arrives exactly
            at[rest] = np.where(length < longest, when[rest], at[rest] + length)
        return states

    def _before_the_start(self, row: int, z0: Array, after: float, late: float, t: Array, u: Array, p: Array) -> float:
        """A reading from before the first node: the first state carried back with the torque it began with."""
        c = self._composite
        back = np.tile(np.atleast_1d(u[0]), (len(c.channels), BACK_STEPS))
        # the output's own way back, over the part of the latency that lies before the start
        shortened = p.copy()
        shortened[c.names.index(c.latencies[c.channels[row]])] = late - after
        return float(c.output_function(z0, back, np.zeros(c.nw), t[0], shortened)[row])

    def _torques(self, values: Mapping[str, float], begin: Array, length: Array, t: Array, u: Array) -> Array:
        """Mean inputs of every substep, (steps, substeps nu)."""
        share = np.arange(self._composite.substeps + 1) / self._composite.substeps
        return mean_inputs(begin[:, None] + length[:, None] * share, t, u, self._composite.delay_s(values))

    def _start(self, x0: Array, u: Array) -> Array:
        return x0 if len(x0) == self._composite.nz else self._composite.beginning(x0, float(np.ravel(u)[0]))


class Chunks:
    """A function of many columns, a chunk at a time, on memory of its own; parameters last, for all the same."""

    def __init__(self, function: ca.Function, *, accumulates: bool = False) -> None:
        self._function, self._accumulates = function, accumulates
        self._buffer, self._trigger = function.buffer()
        self._last = function.n_in() - 1
        self._start = np.zeros(function.size1_in(0))
        self._p = np.zeros((CHUNK, function.size1_in(self._last)))
        self._set(self._last, self._p)
        if accumulates:
            self._set(0, self._start)

    def __call__(self, start: Array | None, columns: Sequence[Array], p: Array) -> Array:
        """Results (n, k) for arguments of n rows each; `start` (k,) where each result is the next one's beginning."""
        count = len(columns[0])
        # the last chunk is filled up by repeating its last row
        rows = np.minimum(np.arange(-(-count // CHUNK) * CHUNK), count - 1)
        filled = [np.ascontiguousarray(np.atleast_2d(one.T).T[rows]) for one in columns] if count else []
        out = np.empty((len(rows), self._function.size1_out(0)))
        self._p[:] = p
        if start is not None:
            self._start[:] = start
        for begin in range(0, len(rows), CHUNK):
            part = slice(begin, begin + CHUNK)
            for index, array in enumerate(filled):
                self._set(index + int(self._accumulates), array[part])
            self._buffer.set_res(0, memoryview(out[part]))  # type: ignore[call-arg, arg-type, unused-ignore]
            self._trigger()
            if self._accumulates:
                self._start[:] = out[part][-1]
        return out[:count]

    def _set(self, index: int, array: Array) -> None:
        self._buffer.set_arg(index, memoryview(array))  # type: ignore[call-arg, arg-type, unused-ignore]


_KEPT: WeakKeyDictionary[Composite, FreeRun] = WeakKeyDictionary()


def _free_run(composite: Composite) -> FreeRun:
    if composite not in _KEPT:
        own = next((effect.free_run for effect in composite.effects if effect.free_run is not None), FreeRun)
        _KEPT[composite] = own(composite)
    return _KEPT[composite]
