"""Free runs of the plant from node to node of a time axis, and their exact derivatives.

Rules of this file: the torque is held between two nodes and no integration step crosses one, so that nothing is
stepped over; a step is at most STEP_S long whatever the distance of the nodes. One object belongs to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.free_run import CHUNK
from hoopd.plants.held_input import node_axis
from hoopd.plants.hoop.equations import ExtraForce, rate, runge_kutta
from hoopd.plants.hoop.parameters import PARAMETER_UNITS
from hoopd.plants.trajectory import Trajectory

Array = NDArray[np.float64]

# Classical Runge-Kutta at 10 ms misses the converged psi by 2.4e-8 rad over a 20 ms step at full speed (test of
# step-halving), 1e4 times below the encoder's step.
STEP_S = 0.010
# Functions kept for the next model of the same kind: a fit makes several in a row.
KEPT = 32


class Model:
    """The plant with some parameters left free: what a fit simulates again and again."""

    def __init__(
        self,
        structure: str,
        values: Mapping[str, float],
        free: Sequence[str] = (),
        extra_forces: tuple[ExtraForce, ...] = (),
        *,
        moving: str = "both",
        step_s: float = STEP_S,
    ) -> None:
        """`values`: every parameter of the structure (and of the forces); `free`: which of them a run is told anew;
        `moving`: both, hoop (no ball) or ball (hoop held)."""
        unknown = [name for name in free if name not in values]
        missing = [name for name in PARAMETER_UNITS[structure] if name not in values]
        if unknown or missing:
            raise ValueError(f"unknown parameters {unknown}, missing {missing}")
        self.structure, self.values, self.free, self.step_s = structure, dict(values), tuple(free), step_s
        fixed = tuple((name, float(value)) for name, value in values.items() if name not in free)
        self._key = (structure, fixed, self.free, extra_forces, moving)
        self._runners: dict[str, _Runner] = {}

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        """States (n, 4) at the nodes t (n,) s from x0 (4,) with torque u (n-1,) N m held between them."""
        t, u, h = node_axis(t, u)
        return self._over("run", np.asarray(x0, float), u, h, p)

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Trajectory:
        """The same with exact derivatives: S' = df/dx S + df/dp, taken through the integration steps themselves."""
        t, u, h = node_axis(t, u)
        m = len(self.free)
        z0 = np.concatenate([np.asarray(x0, float), np.zeros(4 * m), np.eye(4).ravel()])
        z = self._over("sensitivity", z0, u, h, p)
        s = z[:, 4:].reshape(len(z), m + 4, 4).transpose(0, 2, 1)
        return Trajectory(z[:, :4], s[:, :, :m], s[:, :, m:])

    def _over(self, kind: str, start: Array, u: Array, h: Array, p: ArrayLike) -> Array:
        """`start` and what follows it at every node, as rows."""
        steps = np.maximum(1, np.ceil(h / self.step_s - 1e-9)).astype(int)
        after = self._runner(kind)(start, np.repeat(u, steps), np.repeat(h / steps, steps), np.asarray(p, float))
        return np.concatenate([start[None], after[np.cumsum(steps) - 1]])

    def _runner(self, kind: str) -> _Runner:
        if kind not in self._runners:
            self._runners[kind] = _Runner(_chunk(kind, *self._key), len(self.free))
        return self._runners[kind]


class _Runner:
    """Repeats a step over any number of torques, a chunk at a time, on memory of its own."""

    def __init__(self, chunk: ca.Function, free: int) -> None:
        self._buffer, self._trigger = chunk.buffer()
        self._start, self._p = np.zeros(chunk.size1_in(0)), np.zeros((CHUNK, free))
        for index, array in ((0, self._start), (3, self._p)):
            self._buffer.set_arg(index, memoryview(array))  # type: ignore[call-arg, arg-type, unused-ignore]

    def __call__(self, start: Array, u: Array, h: Array, p: Array) -> Array:
        """States (n, k) after each of the steps h (n,) s with torques u (n,); start (k,), p (m,)."""
        # the last chunk is filled up with steps of no length
        rest = np.zeros(-len(u) % CHUNK)
        u, h = np.concatenate([u, rest]), np.concatenate([h, rest])
        out = np.empty((len(u), len(start)))
        self._start[:], self._p[:] = start, p
        for first in range(0, len(u), CHUNK):
            part = slice(first, first + CHUNK)
            for index, array in ((1, u), (2, h)):
                self._buffer.set_arg(index, memoryview(array[part]))  # type: ignore[call-arg, arg-type, unused-ignore]
            self._buffer.set_res(0, memoryview(out[part]))  # type: ignore[call-arg, arg-type, unused-ignore]
            self._trigger()
            self._start[:] = out[part][-1]
        return out[: len(out) - len(rest)]


@lru_cache(maxsize=KEPT)
def _chunk(
    kind: str,
    structure: str,
    fixed: tuple[tuple[str, float], ...],
    free: tuple[str, ...],
    extra_forces: tuple[ExtraForce, ...],
    moving: str,
) -> ca.Function:
    """CHUNK steps: columns of states after them, from start, torques, lengths and (repeated) free parameters."""
    x, u, h, p = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("h"), ca.SX.sym("p", len(free))
    named = {name: ca.SX(value) for name, value in fixed} | {name: p[index] for index, name in enumerate(free)}
    f = ca.Function("f", [x, u, p], [rate(structure, x, u, named, extra_forces, moving)])
    after = runge_kutta(lambda z: f(z, u, p), x, h, 1)
    z, z_after = (x, after) if kind == "run" else _with_sensitivity(x, p, after)
    step = ca.Function(kind, [z, u, h, p], [z_after], {"cse": True})
    return step.mapaccum(kind, CHUNK)


def _with_sensitivity(x: ca.SX, p: ca.SX, after: ca.SX) -> tuple[ca.SX, ca.SX]:
    """State and its derivatives S by parameters and start in one column, before and after a step."""
    m = p.size1()
    s = ca.SX.sym("s", 4, m + 4)
    # S_k+1 = dF/dx S_k + [dF/dp, 0]
    by_p = ca.horzcat(ca.densify(ca.jacobian(after, p)), ca.SX.zeros(4, 4))
    s_after = ca.densify(ca.mtimes(ca.jacobian(after, x), s) + by_p)
    return ca.vertcat(x, ca.vec(s)), ca.vertcat(after, ca.vec(s_after))
