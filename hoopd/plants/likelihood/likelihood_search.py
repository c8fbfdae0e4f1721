"""The search for the maximum of a likelihood: scipy's trust region, then BFGS, told gradients and the information.

The expected information leads to the neighbourhood in a few steps; then, where the innovations are not quite white,
it only takes a quarter off the distance with each, and BFGS goes on from it: 5 runs instead of 20.

Rules of this file: it knows values and derivatives, no model. Everything is in units of one standard deviation, so that
half the square of a gradient's norm is about the likelihood still to be gained.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hoopd.plants.fits.output_error import Progress
from hoopd.plants.likelihood.innovation_likelihood import Evaluation, Likelihood
from hoopd.plants.likelihood.quasi_newton import SearchEnds, lowest, positive

Array = NDArray[np.float64]

NEAR_GRADIENT = 0.5
MOST_STEPS = 60
# Curvatures of the information below this share of the largest are rounding.
LEAST_SHARE = 1e-6
ENDS = SearchEnds(gain=1e-7, steps=MOST_STEPS)


class Search:
    """Search in units of standard deviations: noise alone, everything by scoring, everything by BFGS."""

    def __init__(self, problem: Likelihood, progress: Progress) -> None:
        self.problem, self.progress, self.evaluations = problem, progress, 0
        self._cache: tuple[bytes, Evaluation] | None = None

    def minimum(self, v: Array) -> tuple[Array, bool]:
        """Search vector at the maximum of the likelihood, and whether the search ended by its rules."""
        noise = np.arange(self.problem.m, self.problem.size)
        # wrong parameters first show as large noise, under which all of them can then be told
        v = self._scoring(v, noise, 10 * NEAR_GRADIENT)
        v = self._scoring(v, np.arange(self.problem.size), NEAR_GRADIENT)
        return self._quasi_newton(v)

    def at(self, v: Array) -> Evaluation:
        """The last point's evaluation is remembered."""
        key = v.tobytes()
        if self._cache is None or self._cache[0] != key:
            self._cache = key, self.problem.evaluate(v)
            self.evaluations += 1
        return self._cache[1]

    def _scoring(self, v: Array, moved: NDArray[np.int64], small: float) -> Array:
        """Trust region with the expected information as second derivative, over some of the coordinates."""
        unit = units(self.at(v).information)[moved]

        def point(y: Array) -> Array:
            out = v.copy()
            out[moved] += unit * y
            return out

        found = minimize(
            lambda y: self.at(point(y)).value,
            np.zeros(len(moved)),
            jac=lambda y: unit * self.at(point(y)).gradient[moved],
            hess=lambda y: unit[:, None] * self.at(point(y)).information[np.ix_(moved, moved)] * unit,
            method="trust-exact",
            options={"gtol": small, "maxiter": MOST_STEPS, "initial_trust_radius": 30.0, "max_trust_radius": 1e5},
        )
        self.progress(f"scoring: -log likelihood {found.fun:.6g} after {self.evaluations} runs")
        return point(found.x)

    def _quasi_newton(self, v: Array) -> tuple[Array, bool]:
        """BFGS that begins with the information as second derivatives."""
        information = self.at(v).information
        unit = units(information)

        def evaluate(y: Array) -> tuple[float, Array]:
            self.evaluations += 1
            found = self.problem.with_gradient(v + unit * y)
            return found.value, unit * found.gradient

        curvature = positive(unit[:, None] * information * unit, LEAST_SHARE)
        found = lowest(evaluate, np.zeros(len(v)), curvature, ends=ENDS)
        self.progress(f"BFGS: -log likelihood {found.value:.6g} after {self.evaluations} runs")
        return v + unit * found.v, found.converged


def units(information: Array) -> Array:
    """One standard deviation of each coordinate with the others held; 1 where the data say nothing."""
    return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(information), 1.0)))
