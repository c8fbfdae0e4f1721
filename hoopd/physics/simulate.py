"""Free runs of the plant from node to node of a time axis, and their exact derivatives.

Rules of this file: the torque is held between two nodes and no integration step crosses one, so that nothing is
stepped over; a step is at most STEP_S long whatever the distance of the nodes. One object belongs to one thread.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.physics.plant import PARAMETER_UNITS, ExtraForce, rate, runge_kutta

Array = NDArray[np.float64]

# Classical Runge-Kutta at 10 ms misses the converged psi by 2.4e-8 rad over a 20 ms step at full speed (test of
# step-halving), 1e4 times below the encoder's step.
STEP_S = 0.010


class Trajectory(NamedTuple):
    """A free run at its nodes, with the derivatives of every state by the free parameters and the initial state."""

    x: Array  # (n, 4)
    by_parameters: Array  # (n, 4, m)
    by_start: Array  # (n, 4, 4)


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
        self._extra_forces, self.moving = extra_forces, moving
        self._cache: dict[tuple[str, int, int], ca.Function] = {}

    @property
    def start_values(self) -> Array:
        """The free parameters (m,) as given."""
        return np.array([self.values[name] for name in self.free])

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        """States (n, 4) at the nodes t (n,) s from x0 (4,) with torque u (n-1,) N m held between them."""
        t, u, h = _axis(t, u)
        after = self._over("run", np.asarray(x0, float), u, h, p)
        return np.vstack([np.asarray(x0, float), after.T])

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Trajectory:
        """The same with exact derivatives: S' = df/dx S + df/dp, taken through the integration steps themselves."""
        t, u, h = _axis(t, u)
        m = len(self.free)
        z0 = np.concatenate([np.asarray(x0, float), np.zeros(4 * m), np.eye(4).ravel()])
        after = self._over("sensitivity", z0, u, h, p)
        z = np.vstack([z0, after.T])
        s = z[:, 4:].reshape(len(z), m + 4, 4).transpose(0, 2, 1)
        return Trajectory(z[:, :4], s[:, :, :m], s[:, :, m:])

    def _over(self, kind: str, start: Array, u: Array, h: Array, p: ArrayLike) -> Array:
        """What follows `start` after every step, as columns."""
        count = h.shape[1]
        # one column of parameters a step: a single one would make CasADi map the whole run over u instead
        columns = np.repeat(np.asarray(p, float).reshape(len(self.free), 1), count, axis=1)
        return np.asarray(self._function(kind, count, h)(start, u, h, columns).full())

    def _function(self, kind: str, count: int, h: Array) -> ca.Function:
        steps = max(1, math.ceil(float(h.max()) / self.step_s - 1e-9))
        key = (kind, count, steps)
        if key not in self._cache:
            step = self._step_function(steps) if kind == "run" else self._sensitivity_function(steps)
            self._cache[key] = step.mapaccum(kind, count)
        return self._cache[key]

    def _step(self, steps: int) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]:
        x, u, h, p = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("h"), ca.SX.sym("p", len(self.free))
        named = {name: ca.SX(value) for name, value in self.values.items()}
        named |= {name: p[index] for index, name in enumerate(self.free)}
        f = ca.Function("f", [x, u, p], [rate(self.structure, x, u, named, self._extra_forces, self.moving)])
        return x, u, h, p, runge_kutta(lambda z: f(z, u, p), x, h, steps)

    def _step_function(self, steps: int) -> ca.Function:
        x, u, h, p, after = self._step(steps)
        return ca.Function("step", [x, u, h, p], [after], {"cse": True})

    def _sensitivity_function(self, steps: int) -> ca.Function:
        x, u, h, p, after = self._step(steps)
        m = len(self.free)
        s = ca.SX.sym("s", 4, m + 4)
        # S_k+1 = dF/dx S_k + [dF/dp, 0]
        by_p = ca.horzcat(ca.densify(ca.jacobian(after, p)), ca.SX.zeros(4, 4))
        s_after = ca.densify(ca.mtimes(ca.jacobian(after, x), s) + by_p)
        z, z_after = ca.vertcat(x, ca.vec(s)), ca.vertcat(after, ca.vec(s_after))
        return ca.Function("sensitivity", [z, u, h, p], [z_after], {"cse": True})


def _axis(t: ArrayLike, u: ArrayLike) -> tuple[Array, Array, Array]:
    """Nodes, torques and distances; ValueError when they do not fit."""
    t, u = np.asarray(t, float), np.asarray(u, float)
    if t.ndim != 1 or len(t) < 2 or u.shape != (len(t) - 1,):
        raise ValueError(f"expected n nodes and n - 1 torques, not {t.shape} and {u.shape}")
    h = np.diff(t)
    if not (h > 0.0).all():
        raise ValueError("the nodes must increase")
    return t, u[None, :], h[None, :]
