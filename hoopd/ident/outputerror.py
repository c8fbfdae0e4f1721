"""Output-error fit: free runs against recordings, all derivatives exact, every run from a start of its own.

    min over p, x0_r of  sum_r sum_c |y_rc - h_c(x(t; p, x0_r))|^2 / sigma_c^2  +  prior,

sigma_c the standard deviation of channel c's residual, found along (Ljung, System Identification, 2nd ed., ch. 7 and
10; equal to maximum likelihood under independent normal errors of each channel).

Rules of this file: numbers in, numbers out; no files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from hoopd.ident.experiments import STATES, Run
from hoopd.ident.parameters import Prior, Scale, scale_of
from hoopd.physics.plant import ExtraForce
from hoopd.physics.simulate import Model

Array = NDArray[np.float64]

# Where a robust loss begins to count less: 1.345 sigma keeps 95 % of the efficiency under normal errors (Huber).
ROBUST_SIGMA = 1.345
# A state that a run's channels do not see is not estimated: its column would be zero.
SIGMA_CHANGE = 0.01
SIGMA_ROUNDS = 8
# A search that has not ended by then will not.
MOST_EVALUATIONS = 200
# Far above any speed of the device: a wild step of the search is turned back instead of overflowing.
LARGEST_RESIDUAL = 1e6

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Solution:
    """What a fit found: parameters, starts, residuals and their derivatives at the solution."""

    names: tuple[str, ...]
    values: dict[str, float]  # every parameter of the structure, fitted or not
    scale: Scale
    z: Array  # (m,) search coordinates of the fitted ones
    starts: list[Array]  # (4,) of every run
    sigma: dict[str, float]  # by channel
    residuals: list[dict[str, Array]]  # by run and channel, in the channel's unit
    jacobian: list[dict[str, Array]]  # d residual / d (z, free starts of the run)
    cost: float
    evaluations: int
    converged: bool
    message: str = ""
    priors: Mapping[str, Prior] = field(default_factory=dict)


class _Problem:
    """Residuals and Jacobian of all runs, in units of sigma."""

    def __init__(
        self,
        structure: str,
        values: Mapping[str, float],
        runs: Sequence[Run],
        scale: Scale,
        priors: Mapping[str, Prior],
        extra_forces: tuple[ExtraForce, ...],
    ) -> None:
        self.runs, self.scale, self.priors = list(runs), scale, priors
        kinds = {run.moving for run in runs}
        self.models = {m: Model(structure, values, scale.names, extra_forces, moving=m) for m in kinds}
        self.free = [free_starts(run) for run in runs]
        offsets = np.cumsum([len(scale.names), *(len(free) for free in self.free)])
        self.slots = [slice(int(a), int(b)) for a, b in pairwise(offsets)]
        self.size = int(offsets[-1])
        self.sigma = {name: _first_sigma(name, runs) for name in _channels(runs)}

    def first(self, z: Array) -> Array:
        """Search vector from parameters' coordinates and the runs' own starts."""
        return np.concatenate([z, *(run.start[free] for run, free in zip(self.runs, self.free, strict=True))])

    def starts(self, v: Array) -> list[Array]:
        out = []
        for run, free, slot in zip(self.runs, self.free, self.slots, strict=True):
            start = run.start.copy()
            start[free] = v[slot]
            out.append(start)
        return out

    def parameters(self, v: Array) -> Array:
        return self.scale.parameters(v[: len(self.scale.names)])

    def residual_parts(self, v: Array) -> list[dict[str, Array]]:
        p, parts = self.parameters(v), []
        for run, start in zip(self.runs, self.starts(v), strict=True):
            x = self.models[run.moving].run(p, start, run.t, run.u)
            parts.append({name: one.of(x) - one.values for name, one in run.series.items()})
        return parts

    def jacobian_parts(self, v: Array) -> list[dict[str, Array]]:
        """By run and channel: (k, m + free starts)."""
        z = v[: len(self.scale.names)]
        p, dp = self.scale.parameters(z), self.scale.derivative(z)
        parts = []
        for run, start, free in zip(self.runs, self.starts(v), self.free, strict=True):
            found = self.models[run.moving].run_with_sensitivity(p, start, run.t, run.u)
            by = np.concatenate([found.by_parameters * dp, found.by_start[:, :, free]], axis=2)
            parts.append({name: one.of(by) for name, one in run.series.items()})
        return parts

    def residual(self, v: Array) -> Array:
        parts = [e / self.sigma[name] for run in self.residual_parts(v) for name, e in run.items()]
        z = v[: len(self.scale.names)]
        stacked = np.concatenate([*parts, self._prior_residual(z)])
        return np.asarray(np.clip(np.nan_to_num(stacked, nan=LARGEST_RESIDUAL), -LARGEST_RESIDUAL, LARGEST_RESIDUAL))

    def jacobian(self, v: Array) -> Array:
        m, blocks = len(self.scale.names), []
        for part, slot in zip(self.jacobian_parts(v), self.slots, strict=True):
            for name, by in part.items():
                block = np.zeros((len(by), self.size))
                block[:, :m], block[:, slot] = by[:, :m], by[:, m:]
                blocks.append(block / self.sigma[name])
        prior = np.zeros((len(self.priors), self.size))
        prior[:, :m] = self._prior_jacobian()
        return np.nan_to_num(np.vstack([*blocks, prior]))

    def update_sigma(self, v: Array, robust: bool) -> float:
        """New standard deviations from the residuals; the largest relative change."""
        change = 0.0
        for name in self.sigma:
            e = np.concatenate([part[name] for part in self.residual_parts(v) if name in part])
            # robust: 1.4826 median |e| is sigma under normal errors
            new = float(1.4826 * np.median(np.abs(e)) if robust else np.sqrt(np.mean(e**2)))
            new = max(new, 1e-12)
            change = max(change, abs(new / self.sigma[name] - 1.0))
            self.sigma[name] = new
        return change

    def _prior_residual(self, z: Array) -> Array:
        centre = self.scale.coordinates(
            np.array(
                [
                    self.priors[n].value if n in self.priors else v
                    for n, v in zip(self.scale.names, self.scale.nominal, strict=True)
                ]
            )
        )
        return np.asarray(self._prior_jacobian() @ (z - centre))

    def _prior_jacobian(self) -> Array:
        rows = [name for name in self.scale.names if name in self.priors]
        out = np.zeros((len(rows), len(self.scale.names)))
        for row, name in enumerate(rows):
            column = self.scale.names.index(name)
            size = 1.0 if self.scale.positive[column] else abs(self.scale.nominal[column]) or 1.0
            out[row, column] = size / self.priors[name].sigma
        return out


def fit_output_error(
    structure: str,
    values: Mapping[str, float],
    names: Sequence[str],
    runs: Sequence[Run],
    *,
    priors: Mapping[str, Prior] | None = None,
    loss: str = "linear",
    extra_forces: tuple[ExtraForce, ...] = (),
    progress: Progress = lambda text: None,
) -> Solution:
    """Parameters `names` (start: `values`) and the runs' initial states; loss: linear, huber, soft_l1 or cauchy."""
    priors = {name: prior for name, prior in (priors or {}).items() if name in names}
    problem = _Problem(structure, values, runs, scale_of(structure, names, values), priors, extra_forces)
    v = problem.first(np.zeros(len(names)))
    evaluations = 0
    for round_ in range(SIGMA_ROUNDS):
        scale = 1.0 if loss == "linear" else ROBUST_SIGMA
        found = least_squares(
            problem.residual,
            v,
            problem.jacobian,
            x_scale="jac",
            loss=loss,
            f_scale=scale,
            max_nfev=MOST_EVALUATIONS,
            ftol=1e-10,
            xtol=1e-10,
            gtol=1e-10,
        )
        v, evaluations = found.x, evaluations + int(found.nfev)
        progress(f"round {round_ + 1}: cost {found.cost:.6g} after {evaluations} runs")
        if problem.update_sigma(v, loss != "linear") < SIGMA_CHANGE:
            break
    p = problem.parameters(v)
    return Solution(
        names=tuple(names),
        values={**values, **{name: float(value) for name, value in zip(names, p, strict=True)}},
        scale=problem.scale,
        z=v[: len(names)],
        starts=problem.starts(v),
        sigma=dict(problem.sigma),
        residuals=problem.residual_parts(v),
        jacobian=problem.jacobian_parts(v),
        cost=float(found.cost),
        evaluations=evaluations,
        converged=bool(found.status > 0),
        message=str(found.message),
        priors=priors,
    )


def _channels(runs: Sequence[Run]) -> list[str]:
    return [name for name in STATES if any(name in run.series for run in runs)]


def _first_sigma(name: str, runs: Sequence[Run]) -> float:
    """A fifth of the signal: what a rough model leaves."""
    values = np.concatenate([run.series[name].values for run in runs if name in run.series])
    return max(float(np.std(values)) / 5.0, 1e-9)


def free_starts(run: Run) -> list[int]:
    """Components of the initial state that the run's channels see."""
    hoop = [0, 1] if "theta" in run.series else [1]
    return {"both": [*hoop, 2, 3], "hoop": hoop, "ball": [2, 3]}[run.moving]
