"""A paired test that may be looked at after every pair: evidence and an interval that hold at any time of stopping.

Differences of pairs are taken for normal with unknown mean and scatter. Against "no difference" stands a mean that is
itself normal, of variance `spread` in units of the scatter, with the scale-invariant prior on the scatter. Their ratio
has mean one at every look when there is no difference, whatever the scatter is; so it exceeds 1/alpha at any look with
a probability of alpha at most (Ville's inequality), and whoever stops as soon as it does errs no more often than that.

Rules of this file: pure functions of the differences; no clock and nothing random.

References
----------
Gonen, Johnson, Lu, Westfall, "The Bayesian two-sample t test", The American Statistician 59 (2005).
Lai, "On confidence sequences", The Annals of Statistics 4 (1976): the t statistic looked at again and again.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, inf, log, log1p, sqrt

# A difference worth a change of controllers is some two times the scatter of a pair; smaller ones take longer.
SPREAD = 4.0


def evidence(differences: Sequence[float], spread: float = SPREAD) -> float:
    """How much likelier the differences are with a mean of some size than with none.

    Parameters
    ----------
    differences : sequence of float
        One number of each pair, of any unit.
    spread : float
        Variance of the mean under the alternative, in squared scatters of a pair; above 0.

    Returns
    -------
    float
        1 before the second pair; above 1/alpha the differences are significant at the level alpha, at any look.

    Examples
    --------
    >>> evidence([0.1, -0.1, 0.05, -0.05]) < 1.0
    True
    >>> evidence([-0.5, -0.6, -0.55, -0.45]) > 20.0
    True
    """
    n = len(differences)
    if n < 2:
        return 1.0
    mean, variance = _moments(differences)
    squared = n * mean**2
    share = squared / variance / (n - 1) if variance > 0.0 else inf if squared > 0.0 else 0.0  # t^2 / nu
    # (1 + n g)^(-1/2) ((1 + t^2/nu) / (1 + t^2/(nu (1 + n g))))^((nu + 1)/2)
    wide = 1.0 + n * spread
    gain = log(wide) if share == inf else log1p(share) - log1p(share / wide)
    return exp(0.5 * n * gain - 0.5 * log(wide))


def interval(differences: Sequence[float], alpha: float = 0.05, spread: float = SPREAD) -> tuple[float, float]:
    """Where the mean difference lies: all means against which there is no evidence of 1/alpha.

    Parameters
    ----------
    differences : sequence of float
        One number of each pair.
    alpha : float
        Probability that the interval misses the mean at any look, between 0 and 1.
    spread : float
        As in `evidence`.

    Returns
    -------
    tuple of float
        Lower and upper end in the unit of the differences; infinite while so few pairs exclude nothing.

    Examples
    --------
    >>> low, high = interval([-0.5, -0.6, -0.55, -0.45, -0.5])
    >>> -0.8 < low < -0.5 < high < 0.0
    True
    >>> interval([0.1, 0.2])
    (-inf, inf)
    """
    n = len(differences)
    if n < 2:
        return -inf, inf
    mean, variance = _moments(differences)
    wide = 1.0 + n * spread
    # (1 + s)/(1 + s/wide) < k  <=>  s < (k - 1)/(1 - k/wide)
    most = exp((log(wide) - 2.0 * log(alpha)) / n)
    if most >= wide:
        return -inf, inf
    half = sqrt(variance * (n - 1) / n * (most - 1.0) / (1.0 - most / wide))
    return mean - half, mean + half


def _moments(values: Sequence[float]) -> tuple[float, float]:
    """Mean, and variance of one value."""
    mean = sum(values) / len(values)
    return mean, sum((one - mean) ** 2 for one in values) / (len(values) - 1)
