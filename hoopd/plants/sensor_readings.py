"""What the sensors read along a free run: late, wrong or lagging, with exact derivatives where they are asked for.

Rules of this file: every late reading has a node of its own in the run; what lies before the first node is the first
state carried back. One object belongs to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.compiled import CHUNK, Chunks
from hoopd.plants.held_input import SAME_S
from hoopd.plants.likelihood.batch_calls import mapped
from hoopd.plants.plant_with_effects import BACK_STEPS, Composite

Array = NDArray[np.float64]


class SensorReadings:
    """The channels of one composite; derivatives are by the parameters named `free`, then by the start."""

    def __init__(self, composite: Composite, free: Sequence[str]) -> None:
        self._composite, self._free = composite, len(free)
        self._names, self._places = tuple(free), [composite.names.index(name) for name in free]

    def latencies_s(self, values: Mapping[str, float]) -> list[float]:
        """By how much each channel is late."""
        return [self._composite.latency_s(channel, values) for channel in self._composite.channels]

    def at(
        self, t: Array, values: Mapping[str, float], nodes: Array, u: Array, z: Array, z_by: Array
    ) -> tuple[Array, Array]:
        """Readings (n, channels) at t (n,) and their derivatives (n, channels, columns of z_by).

        z (nodes, nz): states at the nodes of the run, among which the times t and those of the late readings are;
        z_by (nodes, nz, columns): their derivatives, without columns where none are wanted.
        """
        late = self.latencies_s(values)
        out, by = np.zeros((len(t), len(late))), np.zeros((len(t), len(late), z_by.shape[2]))
        vector = self._composite.vector(values)
        for lateness in dict.fromkeys(late):
            rows = [row for row, one in enumerate(late) if one == lateness]
            inside = t - lateness >= nodes[0] - SAME_S
            when = t[inside] - lateness
            at = node_index(nodes, when)
            if z_by.shape[2]:
                found = self._with_derivatives(None, (z[at], when), vector)
            else:
                found = mapped(self._composite.reading_function, len(when), (2,))(z[at], when, vector)[0][:, :, 0]
            for row in rows:
                out[inside, row] = found[:, row]
                by[inside, row] = self._chain(found, row, z_by[at])
                for index in np.flatnonzero(~inside):
                    after = t[index] - nodes[0]
                    out[index, row], by[index, row] = self._before_the_start(
                        row, lateness - after, vector, nodes[0], u, z[0], z_by[0]
                    )
        return out, by

    def _before_the_start(
        self, row: int, earlier: float, vector: Array, begin: float, u: Array, z0: Array, z0_by: Array
    ) -> tuple[float, Array]:
        """A reading from before the first node: the first state carried back with the inputs that it began with."""
        c = self._composite
        # the output's own way back, over the part of the latency that lies before the start
        shortened = vector.copy()
        shortened[c.names.index(c.latencies[c.channels[row]])] = earlier
        back = np.tile(u[0], (len(c.channels), BACK_STEPS))
        if not z0_by.shape[1]:
            return float(c.output_function(z0, back, np.zeros(c.nw), begin, shortened)[row]), np.zeros(0)
        y, by_z, by_p = self._outputs(z0, back, np.zeros(c.nw), begin, shortened)
        by = by_z.full()[row] @ z0_by
        by[: self._free] += by_p.full()[row]
        return float(y[row]), by

    def _chain(self, found: Array, row: int, z_by: Array) -> Array:
        """Derivatives of readings through the state's and by the parameters themselves."""
        if not z_by.shape[2]:
            return np.zeros((len(found), 0))
        c, m = self._composite, self._free
        y, rest = len(c.channels), found[:, len(c.channels) :]
        by_z = rest[:, : y * c.nz].reshape(len(found), c.nz, y)[:, :, row]
        by_p = rest[:, y * c.nz :].reshape(len(found), m, y)[:, :, row]
        by = np.einsum("nz,nzk->nk", by_z, z_by)
        by[:, :m] += by_p
        return np.asarray(by)

    # ------------------------------------------------------------------------------------------ functions

    @cached_property
    def _with_derivatives(self) -> Chunks:
        """Readings of a state, their derivatives by it and by the free parameters, in one column."""
        c = self._composite
        z, t, p = ca.SX.sym("z", c.nz), ca.SX.sym("t"), ca.SX.sym("p", len(c.names))
        y = c.reading_function(z, t, p)
        parts = (y, ca.vec(ca.densify(ca.jacobian(y, z))), ca.vec(ca.densify(ca.jacobian(y, p)[:, self._places])))
        return Chunks(ca.Function("seen", [z, t, p], [ca.densify(ca.vertcat(*parts))], {"cse": True}).map(CHUNK))

    @cached_property
    def _outputs(self) -> Any:
        return self._composite.output_derivatives(self._names)


def node_index(nodes: Array, when: Array) -> NDArray[np.intp]:
    """The node at each of these times, which are all nodes."""
    return np.clip(np.searchsorted(nodes, when - 2.0 * SAME_S), 0, len(nodes) - 1)
