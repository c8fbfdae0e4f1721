"""Every sample of a channel is one of three: fresh, that of the row before, or false. Shares and verdicts by EM.

    p(y_k) = (1 - l - o) N(y_k; x_k, S) + l N(y_k; x_k-1, S') + o N(y_k; x_k, S + tau^2)

x is the channel's own course (motion.py), each sample judged by the others; a late sample is a good one of the row
before and is used as such.
Rules of this file: no plant; robust from the first step, because a fifth of the samples may be bad; a stretch that
moves faster than the rest has a scale of its own there, so that motion is not called false.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.motion import GAP_STEPS, Course, Differences, Explained, explained, leave_one_out

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
FIRST_SHARES = np.array([0.9, 0.05, 0.05])
ROBUST_STEPS, ROUNDS, EM_STEPS = 5, 3, 4
# Within so many sigma of the course a false value would be no false one.
HOLE_SIGMAS = 3.0
# The first round starts from half the noise that all samples together show: from there the good ones win it back,
# while bad ones that were once believed stay believed.
STRICT = 0.5
PROBABILITY_FLOOR = 1e-300
# Variance of a prediction, over a sample's, from which on it says nothing.
UNPREDICTED = 100.0


@dataclass(frozen=True)
class Split:
    """What each sample is, and how sure the shares are."""

    fresh: Array  # (n,) probabilities; 0 where missing
    late: Array
    false: Array
    course: Array  # (n,) prediction without the sample, at its row
    variance: Array  # (n,) of that prediction
    path: Array  # (n,) what the drives do at once
    sigma: float  # of a fresh sample
    jitter_s: float  # of the instants of sampling, where asked for
    shares: Array  # fresh, late, false: of the samples seen
    errors: Array  # standard errors of the shares of late and false
    gains: Array  # log-likelihood that late and false add, nats


@dataclass(frozen=True)
class _State:
    fresh: Array
    late: Array
    false: Array
    shares: Array
    sigma: float
    spread: float  # tau
    scale: Array  # (n,) of all errors, by neighbourhood
    noise: Array  # (n,) variance of a sample where it moves, over that at rest
    jitter_s: float  # of the instants of sampling


def split(t: Array, values: Array, paths: Callable[[Array], Array], *, late: bool, floor: float) -> Split:
    """Split samples (n,), NaN where missing or not to be used; `paths`: course (n,) -> what drives do
    at once (n, k).

    floor: the least sigma that a sample of this sensor can have. Needs 12 samples or more.
    """
    rows = np.flatnonzero(~_long_gaps(values))
    part = _split(t[rows], values[rows], lambda course: paths(_spread(course, rows, len(t)))[rows], late, floor)
    return _whole(part, rows, len(t))


def _long_gaps(values: Array) -> Mask:
    """Rows (n,) of stretches without a sample that are too long to draw a course through."""
    missing = ~np.isfinite(values)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], missing, [True]]).astype(int)))
    lengths = np.diff(np.concatenate([[0], edges, [len(values)]]))
    gap = np.zeros(len(values), dtype=bool)
    first = 0
    for length in lengths:
        gap[first : first + length] = length >= GAP_STEPS - 1.0 or first == 0 or first + length == len(values)
        first += length
    return gap & missing


def _spread(course: Array, rows: NDArray[np.int64], n: int) -> Array:
    """The course on all rows, straight lines where there is none."""
    return np.interp(np.arange(n), rows, course)


def _whole(part: Split, rows: NDArray[np.int64], n: int) -> Split:
    """The same with all rows: nothing known of the others."""
    changes: dict[str, Any] = {}
    for name, blank in (("fresh", 0.0), ("late", 0.0), ("false", 0.0), ("variance", np.inf)):
        column = np.full(n, blank)
        column[rows] = getattr(part, name)
        changes[name] = column
    return replace(part, **changes, course=_spread(part.course, rows, n), path=_spread(part.path, rows, n))


def _split(t: Array, values: Array, paths: Callable[[Array], Array], late: bool, floor: float) -> Split:
    gram, seen = Differences(t).gram(), np.isfinite(values)
    filled = np.interp(t, t[seen], values[seen])
    push = _first_path(t, filled, paths(filled), seen)
    weight, course, sigma = _robust(gram, filled - push, seen)
    course = course + push
    state = _first(weight, seen, max(sigma, floor), late)
    for turn in range(ROUNDS):
        drive = explained(t, filled, paths(course), state.fresh > 0.5)
        first = STRICT * min(drive.sigma, state.sigma)
        state = replace(state, sigma=max(drive.sigma if turn else first, floor))
        rate = None if late or turn == 0 else np.gradient(course, t)
        for step in range(EM_STEPS):
            found = _course(gram, drive, filled, state)
            if turn and step % 2 == 0:
                state = _scaled(found, drive, filled, seen, state)
            state = _expected(found, drive, filled, seen, state, floor, rate)
        course = found.own + drive.path
    return _result(found, drive, filled, seen, state)


def _first_path(t: Array, filled: Array, paths: Array, seen: Mask) -> Array:
    """What the drives do (n,) by all samples, bad ones too; nothing, where that makes samples agree less."""
    path = explained(t, filled, paths, seen).path
    without, with_it = (np.abs(x - _voted(x))[seen] for x in (filled, filled - path))
    scale = max(min(float(np.median(without)), float(np.median(with_it))), 1e-300)
    better = np.log1p((with_it / scale) ** 2).sum() < np.log1p((without / scale) ** 2).sum()
    return path if better else np.zeros(len(path))


def _robust(gram: Array, filled: Array, seen: Mask) -> tuple[Array, Array, float]:
    """Weights of samples that agree with their neighbours, the course through them, and the spread about it."""
    none, error = np.zeros(len(filled)), np.abs(filled - _voted(filled))
    for _ in range(ROBUST_STEPS):
        sigma = max(1.4826 * float(np.median(error[seen])), 1e-300)
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


def _first(weight: Array, seen: Mask, sigma: float, late: bool) -> _State:
    good = np.where(seen, (weight > 0.5).astype(float), 0.0)
    none = np.zeros(len(weight))
    shares = FIRST_SHARES if late else np.array([0.95, 0.0, 0.05])
    return _State(good, none, seen - good, shares, sigma, 10.0 * FALSE_SIGMAS * sigma, *np.ones((2, len(weight))), 0.0)


def _course(gram: Array, drive: Explained, filled: Array, state: _State) -> Course:
    before = np.append(drive.path[0], drive.path[:-1])
    late = state.late / state.noise
    late[0] = 0.0
    return leave_one_out(gram, drive.ratio, filled - drive.path, filled - before, state.fresh / state.noise, late)


def _errors(found: Course, drive: Explained, filled: Array) -> tuple[Array, Array]:
    before = np.append(drive.path[0], drive.path[:-1])
    return filled - drive.path - found.own, filled - before - found.before


def _densities(found: Course, drive: Explained, filled: Array, state: _State) -> Array:
    """Of fresh, late and false (3, n)."""
    own, before = _errors(found, drive, filled)
    unit = (state.sigma * state.scale) ** 2
    spread = unit * (state.noise + found.own_variance)
    wide = spread + state.spread**2
    # wide N(0, s^2) with a hole of width g: (1 - exp(-e^2 / 2 g^2)) / (1 - g / sqrt(g^2 + s^2))
    hole = HOLE_SIGMAS**2 * spread
    holed = (1.0 - np.exp(-(own**2) / (2.0 * hole))) / (1.0 - np.sqrt(hole / (hole + wide)))
    densities = [
        _normal(own, spread),
        _normal(before, unit * (state.noise + found.before_variance)),
        _normal(own, wide) * holed,
    ]
    return np.where(_known(found), np.maximum(np.array(densities), PROBABILITY_FLOOR), 1.0)


def _known(found: Course) -> Mask:
    """Samples (n,) that others predict at all; of the rest nothing can be said."""
    return np.asarray(np.maximum(found.own_variance, found.before_variance) < UNPREDICTED)


def _normal(error: Array, variance: Array) -> Array:
    return np.asarray(np.exp(-(error**2) / (2.0 * variance)) / np.sqrt(2.0 * pi * variance))


def _expected(
    found: Course, drive: Explained, filled: Array, seen: Mask, state: _State, floor: float, rate: Array | None
) -> _State:
    """One step of EM; with a `rate` (n,) instants of sampling may be uneven: S = sigma^2 + (jitter rate)^2."""
    own, before = _errors(found, drive, filled)
    joint = state.shares[:, None] * _densities(found, drive, filled, state)
    joint /= joint.sum(axis=0)
    joint[:, ~seen] = 0.0
    fresh, _, false = joint * _known(found)
    if rate is None:
        total = fresh / ((state.noise + found.own_variance) * state.scale**2)
        sigma, jitter_s = sqrt(float(total @ own**2) / max(float(fresh.sum()), 1.0)), 0.0
    else:
        sigma, jitter_s = _uneven(own / state.scale, fresh, found.own_variance, state, rate)
    sigma = max(sigma, floor)
    noise = state.noise if rate is None else 1.0 + (jitter_s * rate / sigma) ** 2
    tau = sqrt(float(false @ own**2) / max(float(false.sum()), 1e-12))
    shares = joint.sum(axis=1) / max(int(seen.sum()), 1)
    return _State(*joint, shares, sigma, max(tau, FALSE_SIGMAS * sigma), state.scale, noise, jitter_s)


def _uneven(error: Array, fresh: Array, variance: Array, state: _State, rate: Array) -> tuple[float, float]:
    """sigma and jitter by weighted least squares of e^2 - sigma^2 v on (1, rate^2), neither below 0."""
    weight = fresh / (state.noise + variance) ** 2
    target = error**2 - state.sigma**2 * variance
    columns = np.stack([np.ones(len(rate)), rate**2])
    gram, right = (columns * weight) @ columns.T, (columns * weight) @ target
    still = max(float(right[0] / max(gram[0, 0], 1e-300)), 0.0)
    if np.linalg.det(gram) <= 1e-9 * gram[0, 0] * gram[1, 1]:
        return sqrt(still), 0.0
    constant, by_rate = np.linalg.solve(gram, right)
    if by_rate <= 0.0:
        return sqrt(still), 0.0
    if constant <= 0.0:
        return 0.0, sqrt(max(float(right[1] / gram[1, 1]), 0.0))
    return sqrt(float(constant)), sqrt(float(by_rate))


def _scaled(found: Course, drive: Explained, filled: Array, seen: Mask, state: _State) -> _State:
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
    return np.where(local > LOCAL_SCALE, local, 1.0)


def _result(found: Course, drive: Explained, filled: Array, seen: Mask, state: _State) -> Split:
    densities = _densities(found, drive, filled, state)[:, seen]
    return Split(
        state.fresh,
        state.late,
        state.false,
        found.own + drive.path,
        (state.sigma * state.scale) ** 2 * found.own_variance,
        drive.path,
        state.sigma,
        state.jitter_s,
        state.shares,
        _standard_errors(densities, state.shares),
        np.array([_gain(densities, state.shares, 1), _gain(densities, state.shares, 2)]),
    )


def _standard_errors(densities: Array, shares: Array) -> Array:
    """Of the shares of late and false: I_ij = sum (f_i - f_0)(f_j - f_0) / f^2."""
    score = (densities[1:] - densities[0]) / (shares @ densities)
    used = shares[1:] > 0.0
    information = score[used] @ score[used].T
    errors = np.zeros(2)
    errors[used] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(information)), 0.0))
    return errors


def _gain(densities: Array, shares: Array, which: int, steps: int = 10) -> float:
    """Log-likelihood of the three against that without one of them, whose share the others take over."""
    if shares[which] == 0.0:
        return 0.0
    full = np.log(shares @ densities).sum()
    others = np.delete(shares, which)
    rest = np.delete(densities, which, axis=0)
    others = others / others.sum()
    for _ in range(steps):
        joint = others[:, None] * rest
        others = (joint / joint.sum(axis=0)).mean(axis=1)
    return max(float(full - np.log(others @ rest).sum()), 0.0)
