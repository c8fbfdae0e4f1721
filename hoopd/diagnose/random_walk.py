"""What is known of a number that walks, from what it was on other days.

Between two days that are T apart its variance grows by r^2 T, for all that is older together: what was measured ten
times a year ago has walked once. In the order of days, from the farthest to the nearest,

    P += r^2 T,      K = P / (P + sd^2),      m += K (v - m),      P *= 1 - K

and at the end P += r^2 T to the day that is asked for. What came after that day is followed backwards, and both sides
are independent given the number on the day. Where the values scatter by more than they and the walk say, all that is
known is less sure by as much (Birge's ratio, of the n - 1 normalised innovations, never below one).

Rules of this file: numbers in, numbers out.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple


class DatedValue(NamedTuple):
    """A value with its standard deviation, and the days from it to the day that is asked for: negative, it came
    later."""

    age_days: float
    value: float
    sd: float


class _Side(NamedTuple):
    """What one side of a day tells of it: mean, variance, and the sum of its squared normalised innovations."""

    mean: float
    variance: float
    scatter: float


def walked(told: Sequence[DatedValue], rate: float) -> tuple[float, float]:
    """Mean and deviation on the day from which ages are counted.

    Parameters
    ----------
    told : sequence of DatedValue
        At least one, in any order; independent of each other.
    rate : float
        Deviation by which the number walks in a day, in its unit.

    Returns
    -------
    mean, deviation : float
        In the number's unit.

    Raises
    ------
    ValueError
        Nothing was told.

    Examples
    --------
    >>> from hoopd.diagnose.random_walk import DatedValue, walked
    >>> mean, sd = walked([DatedValue(100.0, 7.0, 0.1), DatedValue(100.0, 7.0, 0.1)], 0.1)
    >>> mean, round(sd, 2)
    (7.0, 1.0)
    """
    if not told:
        raise ValueError("nothing is known of it")
    sides = [[one for one in told if one.age_days >= 0.0], [one for one in told if one.age_days < 0.0]]
    known = [_from(side, rate) for side in sides if side]
    mean, variance, scatter = known[0] if len(known) == 1 else _joined(*known)
    return mean, sqrt(variance * max(1.0, scatter / max(1, len(told) - 1)))


def _from(told: Sequence[DatedValue], rate: float) -> _Side:
    """Of values on one side of the day, by a Kalman filter that begins with the farthest."""
    first, *rest = sorted(told, key=lambda one: -abs(one.age_days))
    mean, variance, away, scatter = first.value, first.sd**2, abs(first.age_days), 0.0
    for age, value, sd in rest:
        variance += rate**2 * (away - abs(age))
        innovation = variance + sd**2
        scatter += (value - mean) ** 2 / innovation
        mean += variance / innovation * (value - mean)
        variance *= sd**2 / innovation
        away = abs(age)
    return _Side(mean, variance + rate**2 * away, scatter)


def _joined(before: _Side, after: _Side) -> _Side:
    """Both sides, which know nothing of each other."""
    both = before.variance + after.variance
    mean = (before.mean * after.variance + after.mean * before.variance) / both
    scatter = before.scatter + after.scatter + (before.mean - after.mean) ** 2 / both
    return _Side(mean, before.variance * after.variance / both, scatter)
