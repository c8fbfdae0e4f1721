"""The restitution of a touch, from pictures of practice throws: what of the speed across the hoop comes back.

Every throw is simulated from two ticks before its flight, with the torques that were sent; where the ball was then and
how fast are fitted with the restitution e. Only places in the air tell where it came from, and only distances from the
axis how high it came back: what the touch did along the hoop is not asked. chi2(e) of all throws together has its least
at the estimate; where it is 3.84 times its scatter above that, the 95 % interval ends. A throw that no e explains about
as well as it does the best one is left out: something else happened in it. Where the interval is wide the estimate is
the mean over it, and not whichever of equals noise prefers.

Rules of this file: pictures and torques in, a number with an interval out; nothing is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.effects.contact_modes import AIR, ContactCourse, ContactModes
from hoopd.plants.hoop.effects.lift_off import LIFT_OFF

Array = NDArray[np.float64]

# Restitutions that are tried: the estimate lies between two of them.
TRIED = np.arange(0.0, 0.81, 0.01)
# What is looked at after the first touch: the longest bounce of a practice throw.
AFTER_S = 0.12
CHI2_95 = 3.84
# Steps of the fit of a throw's start, and its differences (rad, rad/s).
STEPS, DIFFERENCES = 4, (1e-4, 1e-3)
# A throw's mean square over the best one's from which on it is left out.
WORSE = 6.0
# An interval of so many tried ones is wide.
WIDE = 5
# A camera's scatter is not believed to be smaller, in shares of the track.
LEAST_SCATTER = 5e-4


class RecordedThrow(NamedTuple):
    """One throw as it was recorded.

    Attributes
    ----------
    start : ndarray, shape (4,)
        Estimated state (theta, dtheta, psi, dpsi) while it still rolls.
    start_t : float
        When, s.
    tick_s : float
        Length of a tick in s.
    torques : ndarray, shape (n,)
        Held from then on, N m.
    t, direction, distance : ndarray, shape (m,)
        Pictures after that: when, rad, and in shares of the track.
    """

    start: Array
    start_t: float
    tick_s: float
    torques: Array
    t: Array
    direction: Array
    distance: Array


class Restitution(NamedTuple):
    """An estimate with its 95 % interval, from how many pictures after a touch, and of how many throws."""

    value: float
    low: float
    high: float
    pictures: int
    throws: int


def identify_restitution(found: FoundEffects, throws: Sequence[RecordedThrow]) -> Restitution:
    """The restitution that explains the throws.

    Parameters
    ----------
    found : FoundEffects
        The model; its own restitution, where it has one, counts for nothing.
    throws : sequence of RecordedThrow
        At least one.

    Raises
    ------
    ValueError
        No picture after a touch.
    """
    simulated = _Throws(found)
    fits = _explained([[simulated.fit(one, float(e)) for e in TRIED] for one in throws])
    pictures = sum(row[0].after for row in fits)
    if not pictures:
        raise ValueError("no picture shows a ball after its touch")
    chi2 = np.sum([[one.square for one in row] for row in fits], axis=0)
    freedom = max(sum(row[0].numbers for row in fits) - 2 * len(fits) - 1, 1)
    scatter = max(float(chi2.min()) / freedom, LEAST_SCATTER**2)
    above = (chi2 - chi2.min()) / scatter
    inside = TRIED[above <= CHI2_95]
    weights = np.exp(-above / 2.0)
    value = float(weights @ TRIED / weights.sum()) if len(inside) > WIDE else _vertex(chi2)
    return Restitution(value, float(inside[0]), float(inside[-1]), pictures, len(fits))


def _explained(fits: list[list[_Fit]]) -> list[list[_Fit]]:
    """The throws, a row of fits each, that some restitution explains about as well as it does the best one."""
    own = [min(one.square for one in row) / max(row[0].numbers - 3, 1) for row in fits]
    least = max(min(own), LEAST_SCATTER**2) if own else 0.0
    return [row for row, scatter in zip(fits, own, strict=True) if scatter <= WORSE * least]


def _vertex(chi2: Array) -> float:
    """Of the parabola through the least and its neighbours."""
    k = int(chi2.argmin())
    if not 0 < k < len(chi2) - 1:
        return float(TRIED[k])
    before, least, after = chi2[k - 1 : k + 2]
    return float(TRIED[k] + 0.5 * (TRIED[1] - TRIED[0]) * (before - after) / (before - 2.0 * least + after))


class _Fit(NamedTuple):
    """Sum of squares (shares of the track) of so many numbers, of which so many are of pictures after the touch."""

    square: float
    numbers: int
    after: int


class _Throws:
    """Simulated throws of a model with any restitution."""

    def __init__(self, found: FoundEffects) -> None:
        others = tuple(one for one in found.entries if one.name != LIFT_OFF)
        lift_off = next((one.parameters for one in found.entries if one.name == LIFT_OFF), {})
        self._found = replace(found, entries=(*others, FoundEffect(LIFT_OFF, lift_off)))
        self._modes = ContactModes(self._found.plant, self._found.effects())

    def fit(self, throw: RecordedThrow, e: float) -> _Fit:
        """By where it was and how fast."""
        start = throw.start.copy()
        residuals, after = self._residuals(throw, start, e)
        for _ in range(STEPS):
            slopes = []
            for row, d in zip((2, 3), DIFFERENCES, strict=True):
                moved = start.copy()
                moved[row] += d
                slopes.append((self._residuals(throw, moved, e)[0] - residuals) / d)
            step = np.linalg.lstsq(np.array(slopes).T, -residuals, rcond=None)[0]
            tried = start.copy()
            tried[2:4] += step
            better, _ = self._residuals(throw, tried, e)
            if not float(better @ better) < float(residuals @ residuals):
                break
            start, residuals = tried, better
        _, after = self._residuals(throw, start, e)
        return _Fit(float(residuals @ residuals), int(np.count_nonzero(residuals)), after)

    def _residuals(self, throw: RecordedThrow, start: Array, e: float) -> tuple[Array, int]:
        """Along and across of every picture, zero where it does not count, and how many are of after the touch."""
        values = {**self._found.values, f"{LIFT_OFF}.restitution": e}
        course = ContactCourse(self._modes, values, self._modes.rolling.beginning(start))
        rows, after, touched, t = [], 0, inf, throw.start_t
        for at, direction, distance in zip(throw.t, throw.direction, throw.distance, strict=True):
            t = self._advance(course, throw, t, float(at))
            flights = course.flights(t)
            if flights and (len(flights) > 1 or course.mode != AIR):
                touched = min(touched, flights[0][1])
            off = (direction - course.seen()[2] + np.pi) % tau - np.pi
            along, across = off * course.distance, distance - course.distance
            if at < touched:
                rows.append((along, across))
            elif at < touched + AFTER_S:
                rows.append((0.0, across))
                after += 1
            else:
                rows.append((0.0, 0.0))
        return np.array(rows).ravel(), after

    def _advance(self, course: ContactCourse, throw: RecordedThrow, t: float, until: float) -> float:
        """Tick by tick, with the torque of each."""
        while until - t > 1e-9:
            k = int((t - throw.start_t) / throw.tick_s + 1e-9)
            edge = min(until, throw.start_t + (k + 1) * throw.tick_s)
            course.advance(float(throw.torques[min(k, len(throw.torques) - 1)]), edge - t, t)
            t = edge
        return t
