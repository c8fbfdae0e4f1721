"""What an adaptive solver makes of a torque that jumps at every sample, against integration from sample to sample.

The thesis told its solvers the torque by time, u(t) = input[floor(50 t) + 1], and let them choose their steps: a step
that spans several samples sees the torque at its few stages only. Here the same is done again, to be measured.

Rules of this file: the plant comes as its derivative; nothing here is needed to simulate (`hoop.simulate`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.hoop.simulate import HoopModel

Array = NDArray[np.float64]
Rate = Callable[[float, Array], Array]

# What DifferentialEquations.jl and scipy take when nothing is said, and what the thesis took by saying nothing.
RTOL, ATOL = 1e-3, 1e-6
# Tight enough that its error is rounding: the truth that others are measured against.
TRUTH_RTOL, TRUTH_ATOL = 3e-14, 1e-13
# Explicit methods of order 4 and 5 stay stable while |lambda| h is below about this (Hairer, Wanner, II, IV.2).
STABILITY = 2.78


@dataclass(frozen=True)
class Solved:
    """A run at the samples and what it took."""

    x: Array  # (n, 4)
    times: Array  # (steps + 1,) s, where the steps ended
    evaluations: int

    @property
    def steps(self) -> int:
        """Accepted steps."""
        return len(self.times) - 1

    def largest_error(self, truth: Array) -> Array:
        """(4,) largest difference of each state over the run."""
        return np.asarray(np.abs(self.x - truth).max(axis=0))


@dataclass(frozen=True)
class SolverCase:
    """How a solver is called across the jumps."""

    method: str
    rtol: float = RTOL
    atol: float = ATOL
    max_step_s: float = math.inf

    @property
    def text(self) -> str:
        """As a table names it."""
        step = "" if math.isinf(self.max_step_s) else f", steps up to {1e3 * self.max_step_s:g} ms"
        return f"{self.method}, rtol {self.rtol:g}{step}"


@dataclass(frozen=True)
class Study:
    """One torque, the converged run, and what others make of it."""

    t: Array  # (n,) s
    u: Array  # (n-1,) N m
    truth: Array  # (n, 4)
    across: dict[SolverCase, Solved]
    by_step: dict[float, Array]  # fixed step in s -> (n, 4), sample to sample


@dataclass(frozen=True)
class Stiffness:
    """How far apart the plant's time scales are, at the bottom at rest."""

    eigenvalues: NDArray[np.complex128]  # (4,) 1/s
    ratio: float  # largest over smallest decay rate that is not zero; stiff systems have 1e3 and more
    largest_step_s: float  # at which an explicit method of order 4 would still be stable


def two_level_torque(samples: int, seed: int = 0, amplitude_nm: float = 0.1) -> Array:
    """(samples,) N m: one of two levels by chance at every sample."""
    return np.asarray(np.random.default_rng(seed).choice([-amplitude_nm, amplitude_nm], samples))


def by_time(t: Array, u: Array) -> Callable[[float], float]:
    """u(t) = u[floor((t - t0) / h)], as the thesis wrote it."""
    t0, per_s, last = float(t[0]), (len(t) - 1) / float(t[-1] - t[0]), len(u) - 1
    return lambda now: float(u[min(max(math.floor(per_s * (now - t0)), 0), last)])


def across_jumps(
    plant: HoopPlant,
    x0: Array,
    t: Array,
    u: Array,
    case: SolverCase,
) -> Solved:
    """One call of an adaptive solver over the whole run, the torque looked up by time.

    method: one of scipy's (RK45, Radau, ...) or Rosenbrock23. t (n,) s evenly spaced, u (n-1,) N m.
    """
    torque = by_time(t, u)

    def rate(now: float, x: Array) -> Array:
        return plant.derivative(x, torque(now))

    if case.method == "Rosenbrock23":
        return _rosenbrock23(rate, lambda x: plant.linearize(x)[0], x0, t, case)
    options = {"rtol": case.rtol, "atol": case.atol, "max_step": case.max_step_s}
    found = solve_ivp(rate, (t[0], t[-1]), x0, case.method, t_eval=t, dense_output=True, **options)
    return Solved(found.y.T, np.asarray(found.sol.ts), int(found.nfev))


def study(
    plant: HoopPlant,
    x0: Array,
    t: Array,
    u: Array,
    cases: Sequence[SolverCase],
    steps_s: Sequence[float] = (0.02, 0.01, 0.005, 0.0025),
) -> Study:
    """The converged run (DOP853 started anew at every sample), the cases across the jumps, fixed steps between them."""
    truth = sample_to_sample(plant, x0, t, u, "DOP853").x
    across = {case: across_jumps(plant, x0, t, u, case) for case in cases}
    fixed = {h: HoopModel(plant.structure, plant.parameters, step_s=h).run((), x0, t, u) for h in steps_s}
    return Study(t, u, truth, across, fixed)


def sample_to_sample(
    plant: HoopPlant, x0: Array, t: Array, u: Array, method: str, *, rtol: float = TRUTH_RTOL, atol: float = TRUTH_ATOL
) -> Solved:
    """The solver started anew at every sample with the torque held: no step crosses a jump."""
    x, times, evaluations = [np.asarray(x0, float)], [t[:1]], 0
    for k in range(len(t) - 1):
        found = solve_ivp(
            lambda _, z, torque=u[k]: plant.derivative(z, torque), (t[k], t[k + 1]), x[-1], method, rtol=rtol, atol=atol
        )
        x.append(found.y[:, -1])
        times.append(found.t[1:])
        evaluations += int(found.nfev)
    return Solved(np.array(x), np.concatenate(times), evaluations)


def stiffness(plant: HoopPlant) -> Stiffness:
    """Eigenvalues of the plant at the bottom, and what they ask of a solver."""
    eigenvalues = np.linalg.eigvals(plant.linearize()[0]).astype(complex)
    decay = np.abs(eigenvalues.real)
    moving = decay[np.abs(eigenvalues) > 1e-9]
    return Stiffness(
        eigenvalues[np.argsort(np.abs(eigenvalues))],
        float(moving.max() / moving.min()),
        STABILITY / float(np.abs(eigenvalues).max()),
    )


def _rosenbrock23(
    rate: Rate,
    jacobian: Callable[[Array], Array],
    x0: Array,
    t: Array,
    case: SolverCase,
) -> Solved:
    """The modified Rosenbrock pair of order 2 (3) that is MATLAB's ode23s and Julia's Rosenbrock23.

    Source: Shampine, Reichelt, The MATLAB ODE Suite, SIAM J. Sci. Comput. 18 (1997), section 3. The torque's derivative
    by time is 0 wherever it exists, which is what automatic differentiation of floor() gives.
    """
    d, e32 = 1.0 / (2.0 + math.sqrt(2.0)), 6.0 + math.sqrt(2.0)
    now, end, x = float(t[0]), float(t[-1]), np.asarray(x0, float)
    f0, h = rate(now, x), min(1e-3, case.max_step_s)
    times, states, slopes, evaluations = [now], [x], [f0], 1
    while now < end - 1e-12:
        h = min(h, end - now, case.max_step_s)
        w = np.eye(4) - h * d * jacobian(x)
        k1 = np.linalg.solve(w, f0)
        f1 = rate(now + h / 2, x + h / 2 * k1)
        k2 = np.linalg.solve(w, f1 - k1) + k1
        after = x + h * k2
        f2 = rate(now + h, after)
        k3 = np.linalg.solve(w, f2 - e32 * (k2 - f1) - 2.0 * (k1 - f0))
        evaluations += 2
        size = _size(h / 6 * (k1 - 2.0 * k2 + k3), case.atol + case.rtol * np.maximum(np.abs(x), np.abs(after)))
        if size <= 1.0:
            now, x, f0 = now + h, after, f2
            times.append(now)
            states.append(x)
            slopes.append(f0)
        # order 2: the next step by the cube root
        h *= min(5.0, max(0.2, 0.9 * max(size, 1e-10) ** (-1 / 3)))
    dense = CubicHermiteSpline(times, states, slopes)
    return Solved(np.asarray(dense(t)), np.array(times), evaluations)


def _size(error: Array, allowed: Array) -> float:
    """Root mean square of the error in units of what is allowed."""
    return float(np.sqrt(np.mean((error / allowed) ** 2)))
