"""Free runs of a hypothesis over windows of a stretch, all at once, and the starts and parameters that fit them best.

Rules of this file: every window starts from a state of its own, fitted to that window's readings; nothing between two
windows is shared but the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.dataset import Held, Stretch
from hoopd.diagnose.track import composite_of, fitting_effects
from hoopd.physics.composite import Composite
from hoopd.physics.effects.base import Effect

Array = NDArray[np.float64]

WINDOW_S = 2.0
# A window shorter than this share of the others is left to none.
SHORTEST_SHARE = 0.5
START_STEPS = 4
# Finite differences of starts and parameters, relative to their size.
DIFFERENCE = 1e-5
# A window whose simulation leaves the device's range is as bad as this many rad or rad/s.
LARGEST = 1e3


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


def windows_of(stretch: Stretch, window_s: float | None = WINDOW_S) -> Windows:
    """Windows of about this length; None: one over the whole stretch."""
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
        self.held = Held(windows.stretch.t, windows.stretch.u)

    def run(self, values: Mapping[str, float], start: Array) -> Array:
        """States (n, nz, b, k) from starts (nx, b, k)."""
        c, w = self.composite, self.windows
        _, b, k = start.shape
        n, total = w.length, b * k
        torques, h, t = self._inputs(values)
        z = np.repeat(
            np.stack(
                [c.beginning(start[:, i, 0], self.held.u[min(w.first[i], len(self.held.u) - 1)]) for i in range(b)],
                axis=1,
            )[:, :, None],
            k,
            axis=2,
        )
        z[: c.nx] = start
        step = _Mapped(c.step_function, total)
        step.set(5, np.repeat(c.vector(values)[:, None], total, axis=1))
        step.set(2, np.zeros((c.nq, total)))
        out = np.empty((n, c.nz, total))
        out[0] = z.reshape(c.nz, total)
        for i in range(n - 1):
            step.set(0, out[i])
            step.set(1, np.repeat(torques[i], k, axis=1))
            step.set(3, np.repeat(h[i][None], k, axis=1))
            step.set(4, np.repeat(t[i][None], k, axis=1))
            out[i + 1] = np.clip(np.nan_to_num(step(), nan=LARGEST), -1e6, 1e6)
        return out.reshape(n, c.nz, b, k)

    def readings(self, values: Mapping[str, float], states: Array) -> Array:
        """(n, nc, b, k) what the sensors show of states (n, nz, b, k)."""
        c, w = self.composite, self.windows
        n, nz, b, k = states.shape
        late = [max(float(values.get(c.latencies.get(name, ""), 0.0)), 0.0) for name in c.channels]
        delay = float(sum(values.get(name, 0.0) for name in c.delays))
        back = self.held.back(late, delay)  # (steps, nc, nodes)
        nodes = self._nodes()
        wide = back.transpose(1, 0, 2)[:, :, nodes]  # (nc, steps, n, b)
        wide = np.repeat(wide[..., None], k, axis=-1).reshape(len(c.channels), back.shape[0], -1)
        count = n * b * k
        z = states.transpose(1, 0, 2, 3).reshape(nz, count)
        t = np.repeat(w.stretch.t[nodes][..., None], k, axis=-1).reshape(1, count)
        p = np.repeat(c.vector(values)[:, None], count, axis=1)
        side = wide.transpose(0, 2, 1).reshape(len(c.channels), -1)
        y = np.asarray(c.output_function.map(count)(z, side, np.zeros((c.nq, count)), t, p).full())
        return y.reshape(len(c.channels), n, b, k).transpose(1, 0, 2, 3)

    def _nodes(self) -> NDArray[np.int64]:
        """(n, b) node of the stretch; past a window's end its last."""
        w = self.windows
        within = np.minimum(np.arange(w.length)[:, None], w.count - 1)
        return np.asarray(w.first + within)

    def _inputs(self, values: Mapping[str, float]) -> tuple[Array, Array, Array]:
        """Torques (n-1, substeps, b), steps (n-1, b), times (n-1, b); past a window's end steps of no length."""
        w, nodes = self.windows, self._nodes()
        delay = float(sum(values.get(name, 0.0) for name in self.composite.delays))
        torques = self.held.substeps(self.composite.substeps, delay)
        at = np.minimum(nodes[:-1], torques.shape[1] - 1)
        h = np.where(np.arange(w.length - 1)[:, None] < w.count - 1, w.stretch.h[at], 0.0)
        return torques[:, at].transpose(1, 0, 2), h, w.stretch.t[nodes[:-1]]


class _Mapped:
    """A function on many columns, repeatedly, on memory of its own."""

    def __init__(self, function: ca.Function, count: int) -> None:
        mapped = function.map(count)
        self._args = [np.zeros((count, function.size1_in(i))) for i in range(function.n_in())]
        self._out = np.zeros((count, function.size1_out(0)))
        self._buffer, self._trigger = mapped.buffer()
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
    """Free runs from the starts that fit each window's readings, weighted by 1/sigma (nc,); reference (nodes, nx)."""
    simulator = Simulator(windows, effects)
    nx = simulator.composite.nx
    start = reference[windows.first, :nx].T.copy()
    best, cost = start, np.full(start.shape[1], np.inf)
    for _ in range(START_STEPS):
        y = simulator.readings(values, simulator.run(values, _perturbed(start)))
        e = _errors(windows, y[..., 0], sigma)
        now = np.sum(e**2, axis=(0, 1))
        best, cost = np.where(now < cost, start, best), np.minimum(now, cost)
        jacobian = np.nan_to_num((y[..., 1:] - y[..., :1]) / _steps(start)[None, None].transpose(0, 1, 3, 2))
        jacobian = np.where(np.isfinite(windows.y)[..., None], jacobian, 0.0) / sigma[None, :, None, None]
        start = best + _newton(e, jacobian)
    y = simulator.readings(values, simulator.run(values, start[:, :, None]))[..., 0]
    worse = np.sum(_errors(windows, y, sigma) ** 2, axis=(0, 1)) > cost
    start = np.where(worse, best, start)
    states = simulator.run(values, start[:, :, None])
    return Simulated(windows, start, simulator.readings(values, states)[..., 0], states[..., 0])


def _steps(start: Array) -> Array:
    """(nx, b)"""
    return DIFFERENCE * np.maximum(np.abs(start), 1.0)


def _perturbed(start: Array) -> Array:
    """(nx, b, 1 + nx): as it is, then with each component moved."""
    nx, b = start.shape
    out = np.repeat(start[:, :, None], nx + 1, axis=2)
    steps = _steps(start)
    for i in range(nx):
        out[i, :, i + 1] += steps[i]
    assert out.shape == (nx, b, nx + 1)
    return out


def _errors(windows: Windows, y: Array, sigma: Array) -> Array:
    """(n, nc, b) in units of sigma, 0 where nothing was measured."""
    e = (windows.y - np.clip(np.nan_to_num(y, nan=LARGEST), -1e6, 1e6)) / sigma[None, :, None]
    return np.asarray(np.where(np.isfinite(windows.y), e, 0.0))


def _newton(e: Array, jacobian: Array) -> Array:
    """(nx, b) Gauss-Newton steps; jacobian (n, nc, b, nx)."""
    normal = np.einsum("ncbi,ncbj->bij", jacobian, jacobian)
    right = np.einsum("ncbi,ncb->bi", jacobian, e)
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(normal.shape[1])
    return np.asarray(np.linalg.solve(normal + 1e-300 * np.eye(normal.shape[1]), right[..., None])[..., 0].T)
