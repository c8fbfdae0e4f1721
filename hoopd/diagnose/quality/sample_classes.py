"""Samples of a channel split into fresh, late and false ones: robust start, then rounds of course and mixture.

Rules of this file: long stretches without a sample are left out, not bridged; the drives' coefficients are learnt from
believed samples only, and anew in every round.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.channel_course import Course, Differences, Explained, explained, leave_one_out
from hoopd.diagnose.quality.mixture import (
    FALSE_SIGMAS,
    State,
    course_of,
    densities,
    expected,
    gain_of,
    normal_errors,
    scaled,
    standard_errors,
)
from hoopd.diagnose.quality.outliers import stretches
from hoopd.recording.recording import PAUSE_STEPS

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FIRST_SHARES = np.array([0.9, 0.05, 0.05])
WITHOUT_LATE = np.array([0.95, 0.0, 0.05])
# Enough for a fifth of bad samples; more change nothing (measured on simulated recordings).
ROBUST_STEPS, ROUNDS, EM_STEPS = 5, 3, 4
# The first round starts from half the noise that all samples together show: from there the good ones win it back,
# while bad ones that were once believed stay believed.
STRICT = 0.5
# With fewer of the rows seen the sensor is slower than the rows: its samples alone are the course's instants.
SPARSE = 0.6
# Fewer samples teach nothing about the drives.
FEWEST = 12
# Where fewer than this part of the samples of a sensor without late ones is believed, its body moves faster than a
# course follows it (a sensor of a micrometre, rows that are far apart): the classes mean nothing.
LEAST_BELIEVED = 0.5


class NotFollowedError(ValueError):
    """No course through these samples says which of them are false."""


@dataclass(frozen=True)
class Split:
    """What each sample is, and how sure the shares are."""

    fresh: Array  # (n,) probabilities; 0 where missing
    late: Array
    false: Array
    course: Array  # (n,) prediction without the sample, at its row
    variance: Array  # (n,) of that prediction
    normal: Array  # (n,) error of that prediction over what is expected of it; NaN where there is none
    path: Array  # (n,) what the drives do at once
    sigma: float  # of a fresh sample
    jitter_s: float  # of the instants of sampling, where asked for
    shares: Array  # fresh, late, false: of the samples seen
    errors: Array  # standard errors of the shares of late and false
    gains: Array  # log-likelihood that late and false add, nats


def split(t: Array, values: Array, paths: Callable[[Array], Array], *, late: bool, floor: float) -> Split:
    """Split samples (n,), NaN where missing or not to be used, taken at t (n,) s.

    paths: course (n,) -> what drives do at once (n, k); late: whether a sample may be that of the row before; floor:
    the least sigma that a sample of this sensor can have. Needs FEWEST samples or more; NotFollowedError.
    """
    seen = np.isfinite(values)
    rows = np.flatnonzero(~_long_gaps(values) if seen.mean() > SPARSE else seen)
    part = _split(t[rows], values[rows], lambda course: paths(_spread(course, rows, len(t)))[rows], late, floor)
    return _whole(part, rows, len(t))


def _long_gaps(values: Array) -> Mask:
    """Rows (n,) of stretches without a sample that are too long to draw a course through, or at an end."""
    gap = np.zeros(len(values), dtype=bool)
    for first, last in stretches(~np.isfinite(values)):
        at_end = first == 0 or last == len(values) - 1
        gap[first : last + 1] = at_end or last - first + 2 > PAUSE_STEPS
    return gap


def _spread(course: Array, rows: NDArray[np.int64], n: int) -> Array:
    """The course on all rows, straight lines where there is none."""
    return np.interp(np.arange(n), rows, course)


def _whole(part: Split, rows: NDArray[np.int64], n: int) -> Split:
    """The same with all rows: nothing known of the others."""
    changes: dict[str, Any] = {}
    for name, blank in (("fresh", 0.0), ("late", 0.0), ("false", 0.0), ("variance", np.inf), ("normal", np.nan)):
        column = np.full(n, blank)
        column[rows] = getattr(part, name)
        changes[name] = column
    return replace(part, **changes, course=_spread(part.course, rows, n), path=_spread(part.path, rows, n))


def _split(t: Array, values: Array, paths: Callable[[Array], Array], late: bool, floor: float) -> Split:
    gram, seen = Differences(t).gram(), np.isfinite(values)
    filled = np.interp(t, t[seen], values[seen])
    span = float(np.ptp(filled))
    push = _first_path(t, filled, paths(filled), seen, floor)
    weight, course, sigma = _robust(gram, filled - push, seen, floor)
    course = course + push
    state = _first(weight, seen, sigma, late)
    for turn in range(ROUNDS):
        fresh = _believed(state, seen, late, span)
        drive = explained(t, filled, paths(course), fresh, floor)
        if turn == 0:
            state = replace(state, sigma=max(STRICT * min(drive.sigma, state.sigma), floor))
        elif state.jitter_s > 0.0:  # the drive's sigma is that of all speeds together, q stays as it is
            drive = drive._replace(ratio=drive.ratio * (state.sigma / drive.sigma) ** 2)
        rate = None if late or turn == 0 else np.gradient(course, t)
        for step in range(EM_STEPS):
            found = course_of(gram, drive, filled, state)
            if turn == ROUNDS - 1 and step % 2 == 0:
                state = scaled(found, drive, filled, seen, state)
            state = expected(found, drive, filled, seen, state, floor, rate)
        course = found.own + drive.path
    _believed(state, seen, late, span)
    return _result(found, drive, filled, seen, state)


def _believed(state: State, seen: Mask, late: bool, span: float) -> Mask:
    """Fresh samples (n,); NotFollowedError where they are too few, or err by more than all that was read spans."""
    fresh = state.fresh > 0.5
    if fresh.sum() < FEWEST or (not late and fresh.sum() < LEAST_BELIEVED * seen.sum()) or state.sigma > span:
        raise NotFollowedError(f"{fresh.sum()} of {seen.sum()} samples are believed, within {state.sigma:.3g}")
    return fresh


def _first_path(t: Array, filled: Array, paths: Array, seen: Mask, floor: float) -> Array:
    """What the drives do (n,) by all samples, bad ones too; nothing, where that makes samples agree less."""
    path = explained(t, filled, paths, seen, floor).path
    without, with_it = (np.abs(x - _voted(x))[seen] for x in (filled, filled - path))
    scale = max(min(float(np.median(without)), float(np.median(with_it))), floor)
    better = np.log1p((with_it / scale) ** 2).sum() < np.log1p((without / scale) ** 2).sum()
    return path if better else np.zeros(len(path))


def _robust(gram: Array, filled: Array, seen: Mask, floor: float) -> tuple[Array, Array, float]:
    """Weights of samples that agree with their neighbours, the course through them, and the spread about it."""
    none, error = np.zeros(len(filled)), np.abs(filled - _voted(filled))
    for _ in range(ROBUST_STEPS):
        sigma = max(1.4826 * float(np.median(error[seen])), floor)
        # Geman and McClure's weight
        weight = np.where(seen, 1.0 / (1.0 + (error / (3.0 * sigma)) ** 2) ** 2, 0.0)
        course = leave_one_out(gram, 1.0, filled, filled, weight, none)
        error = np.abs(filled - course.own) / np.sqrt(1.0 + course.own_variance)
    return weight, course.own, sigma


def _voted(x: Array) -> Array:
    """The median of what neighbours say by straight lines and parabolas (n,): most of them may be good."""
    n, padded = len(x), np.pad(x, 3, mode="reflect", reflect_type="odd")
    at = {k: padded[3 + k : 3 + k + n] for k in range(-3, 4)}
    votes = [(at[-k] + at[k]) / 2 for k in (1, 2)]
    for s in (-1, 1):
        votes += [2 * at[s] - at[2 * s], 3 * at[s] - 3 * at[2 * s] + at[3 * s], 1.5 * at[s] - 0.5 * at[3 * s]]
        votes += [(2 * at[s] + at[-2 * s]) / 3, at[s] + (at[-s] - at[2 * s]) / 3, 3 * at[2 * s] - 2 * at[3 * s]]
    return np.asarray(np.median(np.array(votes), axis=0))


def _first(weight: Array, seen: Mask, sigma: float, late: bool) -> State:
    good = np.where(seen, (weight > 0.5).astype(float), 0.0)
    none = np.zeros(len(weight))
    shares = FIRST_SHARES if late else WITHOUT_LATE
    return State(good, none, seen - good, shares, sigma, 10.0 * FALSE_SIGMAS * sigma, none + 1.0, none + 1.0, 0.0)


def _result(found: Course, drive: Explained, filled: Array, seen: Mask, state: State) -> Split:
    each = densities(found, drive, filled, state)[:, seen]
    return Split(
        state.fresh,
        state.late,
        state.false,
        found.own + drive.path,
        (state.sigma * state.scale) ** 2 * found.own_variance,
        np.where(seen, normal_errors(found, drive, filled, state), np.nan),
        drive.path,
        state.sigma,
        state.jitter_s,
        state.shares,
        standard_errors(each, state.shares),
        np.array([gain_of(each, state.shares, 1), gain_of(each, state.shares, 2)]),
    )
