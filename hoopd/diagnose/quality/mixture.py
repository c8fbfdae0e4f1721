"""Every sample of a channel is one of three: fresh, that of the row before, or false. Shares and verdicts by EM.

    p(y_k) = (1 - l - o) N(y_k; x_k, S) + l N(y_k; x_k-1, S') + o N(y_k; x_k, S + tau^2)

x is the channel's own course (channel_course.py), each sample judged by the others; a late sample is a good one of the
row before and is used as such.
Rules of this file: no plant; a stretch that moves faster than the rest has a scale of its own there, so that motion is
not called false.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.channel_course import Course, Explained, leave_one_out

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

# A false value is at least this many sigma wide of the course: nearer ones are noise by any measure.
FALSE_SIGMAS = 5.0
# Samples to each side that say how large errors are in a neighbourhood: half a second at 50 Hz.
NEIGHBOURS = 20
# This quantile of a neighbourhood's errors is nearly free of a fifth of bad ones; of 41 normal errors it stays below
# LOCAL_SCALE times its expectation.
QUANTILE, NORMAL_QUANTILE = 0.4, 0.5244
LOCAL_SCALE = 1.8
# Motion that is harder to follow than the rest is so by a few times; beyond it is a burst of false values.
HARDEST = 4.0
# Within so many sigma of the course a false value would be no false one.
HOLE_SIGMAS = 3.0
PROBABILITY_FLOOR = 1e-300
# Variance of a prediction, over a sample's, from which on it says nothing.
UNPREDICTED = 100.0


@dataclass(frozen=True)
class State:
    """What is believed of the samples, and of the errors they make."""

    fresh: Array  # (n,) probabilities; 0 where missing
    late: Array
    false: Array
    shares: Array  # fresh, late, false: of the samples seen
    sigma: float  # of a fresh sample at rest
    spread: float  # tau
    scale: Array  # (n,) of all errors, by neighbourhood
    noise: Array  # (n,) variance of a sample where it moves, over that at rest
    jitter_s: float  # of the instants of sampling


def course_of(gram: Array, drive: Explained, filled: Array, state: State) -> Course:
    before = np.append(drive.path[0], drive.path[:-1])
    late = state.late / state.noise
    late[0] = 0.0
    return leave_one_out(gram, drive.ratio, filled - drive.path, filled - before, state.fresh / state.noise, late)


def _errors(found: Course, drive: Explained, filled: Array) -> tuple[Array, Array]:
    before = np.append(drive.path[0], drive.path[:-1])
    return filled - drive.path - found.own, filled - before - found.before


def normal_errors(found: Course, drive: Explained, filled: Array, state: State) -> Array:
    """(n,) error of each sample at its own row over what is expected of it; NaN where nothing predicts it."""
    own, _ = _errors(found, drive, filled)
    return np.where(
        _known(found), own / (state.sigma * state.scale * np.sqrt(state.noise + found.own_variance)), np.nan
    )


def densities(found: Course, drive: Explained, filled: Array, state: State) -> Array:
    """Of fresh, late and false (3, n)."""
    own, before = _errors(found, drive, filled)
    unit = (state.sigma * state.scale) ** 2
    spread = unit * (state.noise + found.own_variance)
    wide = spread + state.spread**2
    # wide N(0, s^2) with a hole of width g: (1 - exp(-e^2 / 2 g^2)) / (1 - g / sqrt(g^2 + s^2))
    hole = HOLE_SIGMAS**2 * spread
    holed = (1.0 - np.exp(-(own**2) / (2.0 * hole))) / (1.0 - np.sqrt(hole / (hole + wide)))
    parts = [
        _normal(own, spread),
        _normal(before, unit * (state.noise + found.before_variance)),
        _normal(own, wide) * holed,
    ]
    return np.where(_known(found), np.maximum(np.array(parts), PROBABILITY_FLOOR), 1.0)


def _known(found: Course) -> Mask:
    """Samples (n,) that others predict at all; of the rest nothing can be said."""
    return np.asarray(np.maximum(found.own_variance, found.before_variance) < UNPREDICTED)


def _normal(error: Array, variance: Array) -> Array:
    return np.asarray(np.exp(-(error**2) / (2.0 * variance)) / np.sqrt(2.0 * pi * variance))


def expected(
    found: Course, drive: Explained, filled: Array, seen: Mask, state: State, floor: float, rate: Array | None
) -> State:
    """One step of EM; with a `rate` (n,) instants of sampling may be uneven: S = sigma^2 + (jitter rate)^2."""
    own, _ = _errors(found, drive, filled)
    joint = state.shares[:, None] * densities(found, drive, filled, state)
    joint /= joint.sum(axis=0)
    joint[:, ~seen] = 0.0
    fresh, _, false = joint * _known(found)
    if rate is None:
        total = fresh / ((state.noise + found.own_variance) * state.scale**2)
        sigma, jitter_s = sqrt(float(total @ own**2) / max(float(fresh.sum()), 1.0)), 0.0
    else:
        sigma, jitter_s = _uneven(own / state.scale, fresh, found.own_variance, state, rate, floor)
    sigma = max(sigma, floor)
    noise = state.noise if rate is None else 1.0 + (jitter_s * rate / sigma) ** 2
    tau = sqrt(float(false @ own**2) / max(float(false.sum()), 1e-12))
    shares = joint.sum(axis=1) / max(int(seen.sum()), 1)
    return State(
        joint[0], joint[1], joint[2], shares, sigma, max(tau, FALSE_SIGMAS * sigma), state.scale, noise, jitter_s
    )


def _uneven(
    error: Array, fresh: Array, variance: Array, state: State, rate: Array, floor: float
) -> tuple[float, float]:
    """sigma (floor at least) and jitter (0 at least) by weighted least squares of e^2 - sigma^2 v on (1, rate^2)."""
    weight = fresh / (state.noise + variance) ** 2
    target = error**2 - state.sigma**2 * variance
    columns = np.stack([np.ones(len(rate)), rate**2])
    gram, right = (columns * weight) @ columns.T, (columns * weight) @ target
    constant, by_rate = float(right[0] / max(gram[0, 0], 1e-300)), 0.0
    if np.linalg.det(gram) > 1e-9 * gram[0, 0] * gram[1, 1]:
        both = np.linalg.solve(gram, right)
        if both[1] > 0.0:
            constant, by_rate = float(both[0]), float(both[1])
        if both[1] > 0.0 and constant < floor**2:
            constant, by_rate = floor**2, float(right[1] - floor**2 * gram[0, 1]) / float(gram[1, 1])
    return sqrt(max(constant, floor**2)), sqrt(max(by_rate, 0.0))


def scaled(found: Course, drive: Explained, filled: Array, seen: Mask, state: State) -> State:
    """The state with scales of its neighbourhoods."""
    own, before = _errors(found, drive, filled)
    normal = np.minimum(
        np.abs(own) / np.sqrt(state.noise + found.own_variance),
        np.abs(before) / np.sqrt(state.noise + found.before_variance) if state.shares[1] > 0.0 else np.inf,
    )
    return replace(state, scale=_local_scale(normal / state.sigma, seen))


def _local_scale(normal: Array, seen: Mask) -> Array:
    """Errors of a neighbourhood against what they should be; 1 where the difference is chance."""
    rows = np.flatnonzero(seen)
    width = 2 * NEIGHBOURS + 1
    if len(rows) <= width:
        return np.ones(len(normal))
    windows = np.lib.stride_tricks.sliding_window_view(normal[rows], width)[:: NEIGHBOURS // 4]
    middles = rows[NEIGHBOURS : len(rows) - NEIGHBOURS][:: NEIGHBOURS // 4]
    local = np.interp(np.arange(len(normal)), middles, np.quantile(windows, QUANTILE, axis=1) / NORMAL_QUANTILE)
    return np.where(local > LOCAL_SCALE, np.minimum(local, HARDEST), 1.0)


def standard_errors(each: Array, shares: Array) -> Array:
    """Of the shares of late and false: I_ij = sum (f_i - f_0)(f_j - f_0) / f^2."""
    score = (each[1:] - each[0]) / (shares @ each)
    used = shares[1:] > 0.0
    information = score[used] @ score[used].T
    errors = np.zeros(2)
    errors[used] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information)), 0.0))
    return errors


def gain_of(each: Array, shares: Array, which: int, steps: int = 10) -> float:
    """Log-likelihood of the three against that without one of them, whose share the others take over."""
    if shares[which] == 0.0:
        return 0.0
    full = np.log(shares @ each).sum()
    others = np.delete(shares, which)
    rest = np.delete(each, which, axis=0)
    others = others / others.sum()
    for _ in range(steps):
        joint = others[:, None] * rest
        others = (joint / joint.sum(axis=0)).mean(axis=1)
    return max(float(full - np.log(others @ rest).sum()), 0.0)
