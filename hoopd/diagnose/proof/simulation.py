"""Free runs of a hypothesis over windows of a stretch, all at once, and the starts and parameters that fit them best.

Rules of this file: every window starts from a state of its own, fitted to that window's readings; nothing between two
windows is shared but the parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.window_lengths import WINDOW_S, window_scale
from hoopd.plants.effects.base import Effect
from hoopd.plants.lag_starts import low_passed, read_at_start
from hoopd.plants.likelihood.batch_calls import mapped
from hoopd.plants.likelihood.composites import composite_of, fitting_effects
from hoopd.plants.likelihood.stretches import Held, Stretch
from hoopd.plants.plant_with_effects import Composite
from hoopd.plants.scales import state_scales

Array = NDArray[np.float64]
# Parameters of all columns, or of each.
Columns = Mapping[str, float] | Sequence[Mapping[str, float]]

START_STEPS = 4
# Finite differences of starts and parameters, relative to their size.
DIFFERENCE = 1e-5
# A window whose simulation is no number any more is as bad as this many times what usually moves.
LARGEST = 1e3
# No number of a simulation counts as larger, times what usually moves.
BOUND = 1e6


@dataclass(frozen=True)
class Windows:
    """A stretch cut into windows, padded to equal length: nodes (n, b)."""

    stretch: Stretch
    first: NDArray[np.int64]  # (b,) node of each window's start
    count: NDArray[np.int64]  # (b,) nodes
    y: Array  # (n, nc, b) readings, NaN: none

    @property
    def length(self) -> int:
        """Nodes of the longest."""
        return int(self.count.max())

    @cached_property
    def sizes(self) -> Array:
        """(nc, 1) of the readings, 1 where there are none."""
        found: Array = np.max(np.abs(np.nan_to_num(self.y)), axis=(0, 2), initial=0.0)[:, None]
        return np.where(found > 0.0, found, 1.0)


def bounded(y: Array, size: Array) -> Array:
    """Numbers of a simulation: one that left every bound is as bad as can be, not as good as none.

    `size`: what usually moves, of a shape that y's is a multiple of.
    """
    found = np.minimum(np.maximum(y, -BOUND * size), BOUND * size)
    return np.asarray(np.where(np.isnan(found), LARGEST * size, found))


def windows_of(stretch: Stretch, window_s: float | None = WINDOW_S) -> Windows:
    """Windows of about this length, were the plant as fast as the hoop; None: one over the whole stretch."""
    window_s = None if window_s is None else window_s * window_scale(stretch.plant)
    span = stretch.t[-1] - stretch.t[0]
    pieces = 1 if window_s is None else max(1, round(span / window_s))
    edges = np.searchsorted(stretch.t, np.linspace(stretch.t[0], stretch.t[-1], pieces + 1) - 1e-9)
    edges[-1] = len(stretch.t) - 1
    first, count = edges[:-1], np.diff(edges) + 1
    y = np.full((int(count.max()), stretch.y.shape[1], len(first)), np.nan)
    for b, (a, n) in enumerate(zip(first, count, strict=True)):
        y[:n, :, b] = stretch.y[a : a + n]
        if a + n < len(stretch.t):
            y[n - 1, :, b] = np.nan  # the last node belongs to the next window
    return Windows(stretch, first, count, y)


class Simulator:
    """One hypothesis on the windows of one stretch."""

    def __init__(self, windows: Windows, effects: Sequence[Effect]) -> None:
        self.windows = windows
        self.composite: Composite = composite_of(windows.stretch.plant, fitting_effects(windows.stretch.plant, effects))
        self.held = Held.of(windows.stretch)
        self._read: dict[tuple[str, float], Array] = {}  # where sensors were at the starts, by time constant

    def run(self, values: Columns, start: Array) -> Array:
        """States (n, nz, b, k) from starts (nx, b, k); `values`: one for all k columns, or one for each."""
        c, w = self.composite, self.windows
        _, b, k = start.shape
        n, total = w.length, b * k
        each = _each(values, k)
        torques, h, t = self._inputs(each)
        step = _Mapped(c.step_function, total)
        step.set(5, np.tile(np.stack([c.vector(one) for one in each], axis=1), (1, b)))
        step.set(2, np.zeros((c.nw, total)))
        out = np.empty((n, c.nz, total))
        out[0] = self._beginning(start, each).reshape(c.nz, total)
        h, t, sizes = np.repeat(h, k, axis=1), np.repeat(t, k, axis=1), self._sizes(out[0])
        for i in range(n - 1):
            step.set(0, out[i])
            step.set(1, torques[i])
            step.set(3, h[i][None])
            step.set(4, t[i][None])
            out[i + 1] = bounded(step(), sizes)
        return out.reshape(n, c.nz, b, k)

    def _sizes(self, begin: Array) -> Array:
        """(nz, 1) of what is simulated from states (nz, columns): no less than any start, reading or usual size."""
        found = np.maximum(np.abs(begin).max(axis=1), float(self.windows.sizes.max()))
        nx = self.composite.nx
        found[:nx] = np.maximum(found[:nx], state_scales(self.composite.plant))
        return np.asarray(found[:, None])

    def _beginning(self, start: Array, each: Sequence[Mapping[str, float]]) -> Array:
        """(nz, b, k) what lags behind the state begins with the past that it has."""
        c, (_, b, k) = self.composite, start.shape
        u = [self.held.u[min(first, len(self.held.u) - 1)] for first in self.windows.first]
        columns = [[c.beginning(start[:, i, j], u[i]) for j in range(k)] for i in range(b)]
        out: Array = np.array(columns).transpose(2, 0, 1)
        if c.nz > c.nx:
            past = np.stack(_by_value(each, self._past), axis=2) - self._added(out, each)  # (lags, b, k)
            out[c.nx :] = np.where(np.isfinite(past), past, out[c.nx :])
        return out

    def _past(self, values: Mapping[str, float]) -> Array:
        """(lags, b) where each lag is at the windows' starts, of a sensor as it is read; NaN where nothing tells."""
        return np.stack(
            [self._past_of(*one, values) for one in zip(self.composite.followed, self.composite.lags, strict=True)]
        )

    def _past_of(self, channel: str | None, lag: str, values: Mapping[str, float]) -> Array:
        """(b,) of one lag: of the drive from its demands (`channel` None), of a sensor from its readings."""
        w, lag_s = self.windows, float(values.get(lag, 0.0))
        if channel is None:
            return low_passed(self._demands(values), np.diff(self.held.t), lag_s)[w.first]
        if (channel, lag_s) not in self._read:  # starts and parameters are tried again and again beside the same one
            row, t = self.composite.channels.index(channel), w.stretch.t
            spans = enumerate(zip(w.first, w.count, strict=True))
            found = [read_at_start(t[a : a + n], w.y[:n, row, i], lag_s) for i, (a, n) in spans]
            self._read[channel, lag_s] = np.array(found)
        return self._read[channel, lag_s]

    def _demands(self, values: Mapping[str, float]) -> Array:
        """(n-1,) what the drive's lag followed in each step, its maps taken at rest."""
        c = self.composite
        u = self.held.inputs(1, c.delay_s(values))[0]
        call = mapped(c.demand_function, len(u), (0, 3))
        return call(np.zeros(c.nz), u, self.held.t[:-1], c.vector(values))[0].ravel()

    def _added(self, begin: Array, each: Sequence[Mapping[str, float]]) -> Array:
        """(lags, b, k) what a sensor shows beside what lags in it; 0 of the drive."""
        c, (nz, b, k) = self.composite, begin.shape
        z, t = begin.transpose(1, 2, 0).reshape(b * k, nz), np.repeat(self.windows.stretch.t[self.windows.first], k)
        p = np.tile(np.stack([c.vector(one) for one in each]), (b, 1))
        shown = mapped(c.reading_function, b * k, ())(z, t, p)[0].reshape(b, k, -1).transpose(2, 0, 1)
        return np.stack(
            [
                np.zeros((b, k)) if channel is None else shown[c.channels.index(channel)] - begin[c.nx + i]
                for i, channel in enumerate(c.followed)
            ]
        )

    def readings(self, values: Columns, states: Array) -> Array:
        """(n, nc, b, k) what the sensors show of states (n, nz, b, k)."""
        c, w = self.composite, self.windows
        n, nz, b, k = states.shape
        nodes, count, each = self._nodes(), n * b * k, _each(values, k)
        # (k, steps, nc, n, b), of which each node takes its (nc, steps) column after column
        back = np.stack([one[:, :, nodes] for one in _by_value(each, self._back)])
        side = back.transpose(3, 4, 0, 1, 2).reshape(count, -1)
        z, t = states.transpose(0, 2, 3, 1).reshape(count, nz), np.repeat(w.stretch.t[nodes], k)
        alike = isinstance(values, Mapping)
        p = c.vector(each[0]) if alike else np.tile(np.stack([c.vector(one) for one in each]), (n * b, 1))
        call = mapped(c.output_function, count, (4,) if alike else ())
        return call(z, side, np.zeros((count, c.nw)), t, p)[0].reshape(n, b, k, -1).transpose(0, 3, 1, 2)

    def _back(self, values: Mapping[str, float]) -> Array:
        """(steps inputs, nc, nodes) inputs on the way back to each channel's latency."""
        c = self.composite
        late = [max(float(values.get(c.latencies.get(name, ""), 0.0)), 0.0) for name in c.channels]
        return self.held.inputs_back(late, c.delay_s(values))

    def _nodes(self) -> NDArray[np.int64]:
        """(n, b) node of the stretch; past a window's end its last."""
        w = self.windows
        within = np.minimum(np.arange(w.length)[:, None], w.count - 1)
        return np.asarray(w.first + within)

    def _inputs(self, each: Sequence[Mapping[str, float]]) -> tuple[Array, Array, Array]:
        """Inputs (n-1, substeps inputs, b k), steps (n-1, b), times (n-1, b); no length past a window's end."""
        w, nodes = self.windows, self._nodes()
        at = np.minimum(nodes[:-1], len(self.held.u) - 1)
        torques = np.stack(_by_value(each, lambda one: self._flat_inputs(one)[:, at]), axis=-1)
        h = np.where(np.arange(w.length - 1)[:, None] < w.count - 1, w.stretch.h[at], 0.0)
        wide = torques.transpose(1, 0, 2, 3).reshape(len(at), len(torques), -1)
        return wide, h, w.stretch.t[nodes[:-1]]

    def _flat_inputs(self, values: Mapping[str, float]) -> Array:
        """(substeps inputs, steps), one input after the other."""
        c = self.composite
        every = self.held.inputs(c.substeps, c.delay_s(values))
        return every.transpose(2, 0, 1).reshape(-1, every.shape[1])


def _each(values: Columns, k: int) -> list[Mapping[str, float]]:
    """One set of values for each of k columns."""
    return [values] * k if isinstance(values, Mapping) else list(values)


def _by_value(each: Sequence[Mapping[str, float]], make: Callable[[Mapping[str, float]], Array]) -> list[Array]:
    """`make` of every column; of columns that are one object once."""
    made: dict[int, Array] = {}
    for one in each:
        if id(one) not in made:
            made[id(one)] = make(one)
    return [made[id(one)] for one in each]


class _Mapped:
    """A function on many columns, repeatedly, on memory of its own."""

    def __init__(self, function: ca.Function, count: int) -> None:
        self._args = [np.zeros((count, function.nnz_in(i))) for i in range(function.n_in())]
        self._out = np.zeros((count, function.size1_out(0)))
        self._buffer, self._trigger = function.map(count).buffer()
        for i, array in enumerate(self._args):
            self._buffer.set_arg(i, memoryview(array))  # type: ignore[call-arg, arg-type, unused-ignore]
        self._buffer.set_res(0, memoryview(self._out))  # type: ignore[call-arg, arg-type, unused-ignore]

    def set(self, index: int, columns: Array) -> None:
        """Argument `index` (rows, count)."""
        self._args[index][:] = columns.T

    def __call__(self) -> Array:
        self._trigger()
        return self._out.T.copy()


@dataclass(frozen=True)
class Simulated:
    """Best free runs of the windows."""

    windows: Windows
    start: Array  # (nx, b)
    y: Array  # (n, nc, b)
    states: Array  # (n, nz, b)


def fitted_starts(
    windows: Windows, effects: Sequence[Effect], values: Mapping[str, float], reference: Array, sigma: Array
) -> Simulated:
    """Free runs from the starts that fit each window's readings, weighted by 1/sigma (nc,); reference (nodes, nx).

    What a mechanism remembers is known from what was before the window, and stays as the reference has it: as a free
    number it would stand for a kick at the start that no memory gives.
    """
    simulator = Simulator(windows, effects)
    nx, usual = simulator.composite.nx, state_scales(simulator.composite.plant)[:, None]
    # of the states that effects add: a slipping ball begins as it likes, a memory with what it is known to hold
    plant = simulator.composite.plant
    remembered = [name in plant.remembered for name in plant.states]
    start = reference[windows.first, :nx].T.copy()
    best, cost, step = start, np.full(start.shape[1], np.inf), np.zeros_like(start)
    for _ in range(START_STEPS):
        y = simulator.readings(values, simulator.run(values, _perturbed(start, usual)))
        e = _errors(windows, y[..., 0], sigma)
        now = np.sum(e**2, axis=(0, 1))
        better = now < cost
        best, cost = np.where(better, start, best), np.minimum(now, cost)
        jacobian = np.nan_to_num((y[..., 1:] - y[..., :1]) / _steps(start, usual)[None, None].transpose(0, 1, 3, 2))
        jacobian = np.where(np.isfinite(windows.y)[..., None], jacobian, 0.0) / sigma[None, :, None, None]
        jacobian[..., remembered] = 0.0
        # from a start that is worse no step is taken: half of the one that led there, from the best
        step = np.where(better, _newton(e, jacobian), step / 2.0)
        start = best + step
    states = simulator.run(values, start[:, :, None])
    y = simulator.readings(values, states)
    worse = np.sum(_errors(windows, y[..., 0], sigma) ** 2, axis=(0, 1)) > cost
    if worse.any():
        start = np.where(worse, best, start)
        states = simulator.run(values, start[:, :, None])
        y = simulator.readings(values, states)
    return Simulated(windows, start, y[..., 0], states[..., 0])


def _steps(start: Array, usual: Array) -> Array:
    """(nx, b) of starts, and their usual sizes (nx, 1)."""
    return DIFFERENCE * np.maximum(np.abs(start), usual)


def _perturbed(start: Array, usual: Array) -> Array:
    """(nx, b, 1 + nx): as it is, then with each component moved."""
    nx, b = start.shape
    out = np.repeat(start[:, :, None], nx + 1, axis=2)
    steps = _steps(start, usual)
    for i in range(nx):
        out[i, :, i + 1] += steps[i]
    assert out.shape == (nx, b, nx + 1)
    return out


def _errors(windows: Windows, y: Array, sigma: Array) -> Array:
    """(n, nc, b) in units of sigma, 0 where nothing was measured."""
    e = (windows.y - bounded(y, windows.sizes)) / sigma[None, :, None]
    return np.asarray(np.where(np.isfinite(windows.y), e, 0.0))


def _newton(e: Array, jacobian: Array) -> Array:
    """(nx, b) Gauss-Newton steps; jacobian (n, nc, b, nx)."""
    normal = np.einsum("ncbi,ncbj->bij", jacobian, jacobian)
    right = np.einsum("ncbi,ncb->bi", jacobian, e)
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(normal.shape[1])
    return np.asarray(np.linalg.solve(normal + 1e-300 * np.eye(normal.shape[1]), right[..., None])[..., 0].T)
