"""Output-error fit: free runs against recordings, all derivatives exact, every run from a start of its own.

    min over p, x0_r of  sum_r sum_c |y_rc - h_c(x(t; p, x0_r))|^2 / sigma_c^2  +  prior,

sigma_c the standard deviation of channel c's residual, found along (Ljung, System Identification, 2nd ed., ch. 7 and
10; equal to maximum likelihood under independent normal errors of each channel).

Rules of this file: numbers in, numbers out; no files.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.fits.free_parameters import Prior, Scale
from hoopd.plants.fits.robust_least_squares import SMALLEST_GAIN, Block, Found, loss_value, minimise
from hoopd.plants.fits.runs import Run, System

Array = NDArray[np.float64]

# The standard deviations are found when they change by less than this.
SIGMA_CHANGE = 0.01
SIGMA_ROUNDS = 12
# Until they change by less than this, a search to the last digit would be for another problem's solution.
SIGMA_NEAR = 0.1
ROUGH_GAIN = 1e-2
# Far above any residual in units of sigma: a wild step of the search is turned back instead of overflowing.
LARGEST_RESIDUAL = 1e6

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Solution:
    """What a fit found: parameters, starts, residuals and their derivatives at the solution."""

    names: tuple[str, ...]
    values: dict[str, float]  # every parameter, fitted or not
    scale: Scale
    z: Array  # (m,) search coordinates of the fitted ones
    starts: list[Array]  # (nx,) of every run
    sigma: dict[str, float]  # by channel
    residuals: list[dict[str, Array]]  # by run and channel, in the channel's unit
    jacobian: list[dict[str, Array]]  # d residual / d (z, free starts of the run)
    cost: float
    steps: int  # of the search
    converged: bool
    priors: Mapping[str, Prior] = field(default_factory=dict)


class Problem:
    """Residuals and derivatives of all runs, in units of sigma."""

    def __init__(self, system: System, runs: Sequence[Run], scale: Scale) -> None:
        self.runs, self.scale, self.columns = list(runs), scale, system.columns
        self.models = {moving: system.model(moving, scale.names) for moving in {run.moving for run in runs}}
        self.free = [system.free_starts(run) for run in runs]
        seen = [name for name in system.columns if any(name in run.series for run in runs)]
        self.sigma = {name: _first_sigma(name, runs) for name in seen}

    def each_alone(self) -> list[Problem]:
        """The same problem run by run; models and standard deviations are shared."""
        found = []
        for run, free in zip(self.runs, self.free, strict=True):
            found.append(copy(self))
            found[-1].runs, found[-1].free = [run], [free]
        return found

    def first_starts(self) -> list[Array]:
        """The runs' own guesses of what is free in their starts."""
        return [run.start[free] for run, free in zip(self.runs, self.free, strict=True)]

    def whole_starts(self, starts: Sequence[Array]) -> list[Array]:
        """(nx,) states from their free components."""
        whole = [run.start.copy() for run in self.runs]
        for state, free, start in zip(whole, self.free, starts, strict=True):
            state[free] = start
        return whole

    def errors(self, z: Array, starts: Sequence[Array]) -> list[dict[str, Array]]:
        """Simulated less measured, by run and channel, in the channel's unit."""
        p, parts = self.scale.parameters(z), []
        for run, start in zip(self.runs, self.whole_starts(starts), strict=True):
            x = self.models[run.moving].run(p, start, run.t, run.u)
            parts.append({name: one.of(x[:, self.columns[name]]) - one.values for name, one in run.series.items()})
        return parts

    def derivatives(self, z: Array, starts: Sequence[Array]) -> tuple[list[dict[str, Array]], list[dict[str, Array]]]:
        """Errors, and their derivatives (k, m + free starts) by z and the run's free start."""
        p, dp = self.scale.parameters(z), self.scale.derivative(z)
        errors, by = [], []
        for run, start, free in zip(self.runs, self.whole_starts(starts), self.free, strict=True):
            found = self.models[run.moving].run_with_sensitivity(p, start, run.t, run.u)
            both = np.concatenate([found.by_parameters * dp, found.by_start[:, :, free]], axis=2)
            at = {name: (one, self.columns[name]) for name, one in run.series.items()}
            errors.append({name: one.of(found.x[:, column]) - one.values for name, (one, column) in at.items()})
            by.append({name: one.of(both[:, column]) for name, (one, column) in at.items()})
        return errors, by

    def residuals(self, z: Array, starts: Sequence[Array]) -> list[Array]:
        """By run, in units of sigma; finite whatever the search tries."""
        return [self._stacked(part) for part in self.errors(z, starts)]

    def blocks(self, z: Array, starts: Sequence[Array]) -> list[Block]:
        """Residuals with their derivatives, in units of sigma."""
        m, out = len(self.scale.names), []
        for errors, by in zip(*self.derivatives(z, starts), strict=True):
            stacked = np.nan_to_num(np.concatenate([by[name] / self.sigma[name] for name in by]))
            out.append(Block(self._stacked(errors), stacked[:, :m], stacked[:, m:]))
        return out

    def update_sigma(self, errors: list[dict[str, Array]], robust: bool) -> float:
        """New standard deviations from the errors; the largest relative change."""
        change = 0.0
        for name, old in self.sigma.items():
            e = np.concatenate([part[name] for part in errors if name in part])
            # robust: 1.4826 median |e| is sigma under normal errors
            new = max(float(1.4826 * np.median(np.abs(e)) if robust else np.sqrt(np.mean(e**2))), 1e-12)
            change = max(change, abs(new / old - 1.0))
            self.sigma[name] = new
        return change

    def size(self, found: Found, prior: tuple[Array, Array], loss: str, sigma: Mapping[str, float]) -> float:
        """What a search makes least, at a point, with these deviations of the channels."""
        other = copy(self)
        other.sigma = dict(sigma)
        e, (centre, weight) = np.concatenate(other.residuals(found.p, found.starts)), prior
        return float(loss_value(e, loss).sum() + np.sum(((found.p - centre) * weight) ** 2))

    def _stacked(self, part: dict[str, Array]) -> Array:
        e = np.concatenate([error / self.sigma[name] for name, error in part.items()])
        return np.asarray(np.clip(np.nan_to_num(e, nan=LARGEST_RESIDUAL), -LARGEST_RESIDUAL, LARGEST_RESIDUAL))


def prior_of(scale: Scale, priors: Mapping[str, Prior]) -> tuple[Array, Array]:
    """Centre (m,) and 1 / sigma (m,) of the priors on the search's scale; 0 where there is none."""
    values = [priors[n].value if n in priors else v for n, v in zip(scale.names, scale.nominal, strict=True)]
    width = [priors[n].sigma if n in priors else np.inf for n in scale.names]
    size = np.where(scale.positive, 1.0, scale.size)
    return scale.coordinates(np.array(values)), size / np.array(width)


def fit_output_error(
    system: System,
    names: Sequence[str],
    runs: Sequence[Run],
    *,
    priors: Mapping[str, Prior] | None = None,
    loss: str = "linear",
    rounds: int = SIGMA_ROUNDS,
    smallest_gain: float = SMALLEST_GAIN,
    progress: Progress = lambda text: None,
) -> Solution:
    """Parameters of a plant and the initial states of its runs.

    Parameters
    ----------
    system
        The plant; its values are where the search begins.
    names
        Parameters that are fitted; none: only the starts are.
    runs
        Stretches of recordings.
    priors
        What is believed beforehand, by name.
    loss
        linear, huber, soft_l1 or cauchy.
    rounds
        How often the channels' standard deviations are estimated anew at most.
    smallest_gain
        The search ends where a step gains less than this share of the cost.
    progress
        Is told a line a round.

    Returns
    -------
    Solution

    Raises
    ------
    ArithmeticError
        Where the plant leaves every bound from the first guess on.
    """
    priors = {name: prior for name, prior in (priors or {}).items() if name in names}
    problem = Problem(system, runs, system.scale(names))
    prior = prior_of(problem.scale, priors)
    asked = _Asked(prior, loss, rounds, smallest_gain, progress)
    found = _in_rounds(problem, problem.first_starts(), asked)
    if names and not found.converged:  # not worse than the parameters that were given, with starts of their own
        given = _with_given(problem, system, asked)
        size = partial(problem.size, prior=prior, loss=loss, sigma=dict(problem.sigma))
        if size(given) < size(found):
            again = _in_rounds(problem, given.starts, asked)
            found = min((given, again), key=size)._replace(steps=found.steps + again.steps)
    z, starts = found.p, found.starts
    errors, jacobian = problem.derivatives(z, starts)
    fitted = dict(zip(names, problem.scale.parameters(z).tolist(), strict=True))
    return Solution(
        names=tuple(names),
        values={**system.values, **fitted},
        scale=problem.scale,
        z=z,
        starts=problem.whole_starts(starts),
        sigma=dict(problem.sigma),
        residuals=errors,
        jacobian=jacobian,
        cost=found.cost,
        steps=found.steps,
        converged=found.converged,
        priors=priors,
    )


class _Asked(NamedTuple):
    """How a search is made."""

    prior: tuple[Array, Array]
    loss: str
    rounds: int
    smallest_gain: float
    progress: Progress


def _in_rounds(problem: Problem, starts: list[Array], asked: _Asked) -> Found:
    """The search from the given parameters and these starts; the channels' deviations are estimated anew by round."""
    z, steps, change = np.zeros(len(problem.scale.names)), 0, np.inf
    for number in range(1, asked.rounds + 1):
        fine = change < SIGMA_NEAR or number == asked.rounds
        # a robust loss needs the end of each search: what is far off depends on sigma
        least = max(asked.smallest_gain, ROUGH_GAIN if asked.loss == "linear" and not fine else 0.0)
        found = _searched(problem, z, starts, asked.prior, asked.loss, least)
        z, starts, steps = found.p, found.starts, steps + found.steps
        asked.progress(f"round {number}: cost {found.cost:.6g} after {steps} steps")
        change = problem.update_sigma(problem.errors(z, starts), asked.loss != "linear")
        if fine and change < SIGMA_CHANGE:
            break
    return found._replace(steps=steps)


def _with_given(problem: Problem, system: System, asked: _Asked) -> Found:
    """The starts alone, of the parameters as they were given, in the problem's deviations."""
    alone = Problem(system, problem.runs, system.scale(()))
    alone.sigma = dict(problem.sigma)
    nothing = prior_of(alone.scale, {})
    found = _searched(alone, np.zeros(0), alone.first_starts(), nothing, asked.loss, asked.smallest_gain)
    return found._replace(p=np.zeros(len(problem.scale.names)))


def _searched(
    problem: Problem, z: Array, starts: list[Array], prior: tuple[Array, Array], loss: str, least: float
) -> Found:
    if len(z) > 0:
        return minimise(z, starts, problem.residuals, problem.blocks, prior, loss, least)
    # the runs share nothing: each is searched for itself, and a stubborn one does not keep the others moving
    each = [
        minimise(z, [start], alone.residuals, alone.blocks, prior, loss, least)
        for alone, start in zip(problem.each_alone(), starts, strict=True)
    ]
    return Found(
        z,
        [found.starts[0] for found in each],
        sum(found.cost for found in each),
        max(found.steps for found in each),
        all(found.converged for found in each),
    )


def _first_sigma(name: str, runs: Sequence[Run]) -> float:
    """A fifth of the signal: what a rough model leaves."""
    values = np.concatenate([run.series[name].values for run in runs if name in run.series])
    return max(float(np.std(values)) / 5.0, 1e-9)
