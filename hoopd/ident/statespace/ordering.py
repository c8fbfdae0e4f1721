"""How many samples of past and future a subspace method looks at, and whether the data hold the states asked for.

Rules of this file: whole stretches in; nothing is estimated but lags and correlations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.checks import Orders, check
from hoopd.ident.data import Data, experiments, runs
from hoopd.ident.doubts import warn
from hoopd.ident.statespace import projection, windows
from hoopd.ident.statespace.projection import TriangularFactor, WindowSplit

Array = NDArray[np.float64]

MOST_HORIZON = 25  # samples of past and of future when nobody says so


@dataclass(frozen=True)
class Lags:
    """Lags of an autoregression and the standard deviation of its errors by output."""

    count: int
    level: Array


def check_states(data: Data | Sequence[Data], order: int) -> None:
    """Warn when inputs excite too little for so many states, and when the data hold fewer; for methods with a start.

    Nothing is said of data too short for the test.
    """
    each = experiments(data)
    check(each, orders=Orders(order, 2 * order))
    parts = [part for one in each for part in runs(one)]
    try:
        split = split_of(parts, order, None)[0]
    except ValueError:
        return
    found = projection.factor([joined(part) for part in parts], split)
    if found.count >= len(found.low):
        check_order(found, order)


def check_order(found: TriangularFactor, nx: int) -> None:
    """Warn when the correlation of past and future by state nx is no more than independent ones have."""
    own, chance = projection.correlations(found)[nx - 1], projection.chance(found)
    if own < chance:
        warn(
            f"order too high: order {nx} is more than the data hold; past and future are correlated to {own:.2g} by "
            f"the last state, no more than by chance ({chance:.2g})"
        )


def check_windows(found: TriangularFactor, each: Sequence[Data]) -> None:
    """ValueError for too few windows; a warning when the inputs do not excite as many lags as a window has."""
    rows = len(found.low)
    if found.count < rows:
        raise ValueError(f"too few samples: {found.count} windows for {rows} rows; a shorter horizon needs fewer")
    check(each, orders=Orders(0, found.split.length))


def autoregression(parts: Sequence[Data], most: int) -> Lags:
    """The vector autoregression with inputs of least AIC, all of them from one factor of the moments."""
    z = [joined(part) for part in parts]
    nu, ny = parts[0].nu, parts[0].ny
    m, length = nu + ny, most + 1
    order = _newest_last(length, m, nu)
    low = windows.factor(z, length, order)
    t, rest = windows.count(z, length), low[-ny:]
    best, chosen, level = np.inf, 1, np.ones(ny)
    for lags in range(1, most + 1):
        tail = rest[:, nu + lags * m :]
        aic = np.linalg.slogdet(tail @ tail.T / t + 1e-14 * np.eye(ny))[1] + 2.0 * ny * (lags * m + nu) / t
        if aic < best - 1e-9:
            best, chosen, level = aic, lags, np.linalg.norm(tail, axis=1) / np.sqrt(t)
    return Lags(chosen, level)


def has_direct_term(parts: Sequence[Data], lags: int) -> bool:
    """Whether the inputs of a sample tell its outputs beyond what the samples before do, by BIC of the autoregression.

    T log(det S_without / det S_with) > ny nu log T, S the covariance of the errors.
    """
    nu, ny = parts[0].nu, parts[0].ny
    if not nu:
        return False
    m, z = nu + ny, [joined(part) for part in parts]
    now = lags * m
    order = np.array([*range(now), *range(now, now + m)], dtype=int)
    t, low = windows.count(z, lags + 1), windows.factor(z, lags + 1, order)
    if t <= 2 * (now + m):
        return False
    rest = low[-ny:]
    floor = 1e-14 * float(np.square(rest).sum()) * np.eye(ny)
    told = [float(np.linalg.slogdet(tail @ tail.T + floor)[1]) for tail in (rest[:, now:], rest[:, now + nu :])]
    return bool(t * (told[0] - told[1]) > ny * nu * np.log(t))


def _newest_last(length: int, m: int, nu: int) -> Array:
    """u now, then z of one sample before, two, ..., and y now at the end."""
    now = (length - 1) * m
    before = [s * m + i for s in range(length - 2, -1, -1) for i in range(m)]
    return np.array([*range(now, now + nu), *before, *range(now + nu, now + m)], dtype=int)


def split_of(parts: Sequence[Data], order: int | None, horizon: int | None) -> tuple[WindowSplit, Array]:
    """Past and future, and the noise of each output; ValueError where the stretches are too short for the order."""
    nu, ny = parts[0].nu if parts else 0, parts[0].ny if parts else 0
    if not parts:
        raise ValueError("no sample has every output measured")
    least = -(-(order or 1) // ny) + 1
    # the windows must be more than twice their rows, and the rows of past and future 2 r (nu + ny)
    longest = max(part.n for part in parts)
    most = min(MOST_HORIZON, longest // (6 * (nu + ny) + 2))
    if horizon is not None:
        if horizon < least:
            raise ValueError(f"a horizon of {horizon} samples is too short for order {order}: {least}")
        return WindowSplit(horizon, horizon, nu, ny), autoregression(parts, max(min(horizon, most), 1)).level
    if most < least:
        raise ValueError(
            f"too few consecutive samples with every output measured: the longest run has {longest}, order"
            f" {order or 1} with {nu} inputs and {ny} outputs needs {least * (6 * (nu + ny) + 2)}"
        )
    lags = autoregression(parts, max(most // 2, 1))
    r = int(np.clip(2 * lags.count, min(max(least, 5), most), most))  # twice the lags: Bauer, 2001
    return WindowSplit(r, r, nu, ny), lags.level


def joined(part: Data) -> Array:
    """z = [u, y], (n, nu + ny)."""
    return np.hstack([part.u, part.y])
