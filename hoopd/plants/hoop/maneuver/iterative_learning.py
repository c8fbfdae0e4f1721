"""What a maneuver's next attempt does better: what the model left unexplained of the last ones, answered beforehand.

    w_k = x_k+1 - f(x_k, u_k)                            of an attempt: what the model does not explain
    v_k = w_k - B_k K_k (x^_k - x_k)                     with what feedback does for an estimate that is wrong
    e_k+1 = (A_k - B_k K_k) e_k + B_k c_k + v_k          how far off the plan the next one is with a correction c
    c = argmin sum e'Q e + EFFORT c'R c,  within limits

Whatever comes again in every attempt is in v, to first order about the plan, and is answered before feedback sees it;
of what does not come again a mean over the attempts leaves a part, and what is faster than BELIEVED_HZ is filtered out,
in both directions of time. (Schoellig, Mueller, D'Andrea, Optimization-based iterative learning for precise
quadrocopter trajectory tracking, Autonomous Robots 33, 2012.)

Rules of this file: mathematics; where attempts come from and what is played is not known here.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt

from hoopd.plants.hoop.maneuver.tracking import TrackingWeights

Array = NDArray[np.float64]

# Slower than this, Hz, an attempt is believed; beyond, it is noise of the estimate.
BELIEVED_HZ = 6.0
# Fewer ticks are too short for the filter.
FEWEST_TICKS = 12
# A correction costs so much of what the same feedback would.
EFFORT = 0.1
# Every attempt has at least this weight in the mean: what drifts is followed.
LEAST_WEIGHT = 0.3


def unexplained(step: ca.Function, states: Array, torques: Array, tick_s: float) -> Array:
    """What a model does not explain of an attempt.

    Parameters
    ----------
    step : casadi.Function
        (x, u) to the state after a tick, and its derivatives.
    states : ndarray, shape (n + 1, 4)
        Of the attempt, smoothed, at the edges of the ticks.
    torques : ndarray, shape (n,)
        That were asked for, N m.
    tick_s : float
        Length of a tick, s.

    Returns
    -------
    ndarray, shape (n, 4)
        In the units of the state, low-pass filtered forwards and backwards.
    """
    after = np.array([step(x, u)[0].full().ravel() for x, u in zip(states[:-1], torques, strict=True)])
    return believed(states[1:] - after, tick_s)


def believed(w: Array, tick_s: float) -> Array:
    """Rows (n, 4) without what is faster than BELIEVED_HZ, no later than before; short ones as they are."""
    highest = 0.5 / tick_s
    if highest <= BELIEVED_HZ or len(w) < FEWEST_TICKS:
        return w
    sections = butter(2, BELIEVED_HZ / highest, output="sos")
    return np.asarray(sosfiltfilt(sections, w, axis=0))


@dataclass(frozen=True)
class LearnedMotion:
    """A plan as its attempts see it: linear about it, with its feedback."""

    dynamic: Array  # (n, 4, 4) A - B K
    driven: Array  # (n, 4) B
    gains: Array  # (n, 4) K
    weights: TrackingWeights

    @classmethod
    def about(
        cls, step: ca.Function, states: Array, torques: Array, gains: Array, weights: TrackingWeights
    ) -> LearnedMotion:
        """Of a plan: states (n + 1, 4), torques (n,), gains (n, 4)."""
        parts = [step(x, u) for x, u in zip(states[:-1], torques, strict=True)]
        a, b = np.array([one[1].full() for one in parts]), np.array([one[2].full().ravel() for one in parts])
        return cls(a - b[:, :, None] * gains[:, None, :], b, gains, weights)

    def by_estimate(self, error: Array, tick_s: float) -> Array:
        """(n, 4) what feedback does for errors (n, 4) of the estimate, filtered as what the model leaves."""
        return believed(-self.driven * np.sum(self.gains * error, axis=1)[:, None], tick_s)

    def off_plan(self, correction: Array, w: Array) -> Array:
        """(n, 4) how far off the plan the ends of the ticks are."""
        e, found = np.zeros(4), []
        for a, b, c, left in zip(self.dynamic, self.driven, correction, w, strict=True):
            e = a @ e + b * c + left
            found.append(e)
        return np.array(found)

    def correction(self, w: Array, low: Array | float, high: Array | float) -> Array:
        """(n,) torques beside the plan's, N m, that leave least of w (n, 4), from `low` to `high`."""
        n, root = len(w), np.sqrt(np.diag(self.weights.q))
        answers, here = np.zeros((n, 4, n)), np.zeros((4, n))
        for k in range(n):  # column k: a newton metre in tick k
            here = self.dynamic[k] @ here
            here[:, k] = self.driven[k]
            answers[k] = here
        left = self.off_plan(np.zeros(n), w)
        effort = np.sqrt(EFFORT * self.weights.r) * np.eye(n)
        rows = np.vstack([(answers * root[:, None]).reshape(4 * n, n), effort])
        wanted = np.concatenate([-(left * root).ravel(), np.zeros(n)])
        return np.asarray(lsq_linear(rows, wanted, bounds=(low, high)).x)


def mean_of_attempts(mean: Array, attempts: int, w: Array) -> Array:
    """The mean (n, 4) of what was left unexplained, with one attempt more after so many.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.plants.hoop.maneuver.iterative_learning import mean_of_attempts
    >>> mean_of_attempts(np.zeros((1, 4)), 1, np.ones((1, 4))).tolist()
    [[0.5, 0.5, 0.5, 0.5]]
    """
    return mean + max(LEAST_WEIGHT, 1.0 / (attempts + 1)) * (w - mean)


def tracking_cost(off: Array, weights: TrackingWeights) -> float:
    """Root of the mean cost of being off the plan, rows (n, 4); 1: every state as far off as its weight says.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.plants.hoop.maneuver.iterative_learning import tracking_cost
    >>> from hoopd.plants.hoop.maneuver.tracking import TrackingWeights
    >>> tracking_cost(np.array([[9.0, 6.0, 0.15, 1.5]]), TrackingWeights())
    1.0
    """
    return float(np.sqrt(np.mean(off[:, 1:] ** 2 @ np.diag(weights.q)[1:]) / 3.0))
