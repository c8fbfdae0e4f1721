"""Whether an effect holds inside the training data: blocks of every recording, judged by what the others say.

Each stretch is cut into as many blocks as there are folds. The parameters that the other blocks ask for are those of
the fit after one Gauss-Newton step on their rows alone: the fit is linear about its solution, and no fit is repeated.

    delta = (X'X + W)^-1 (X'r + W c) over the other blocks,   loss = (|r - X delta|^2 + log det S) / 2 over this one

Noise levels are those of all the data. Rules of this file: fits in, nats out; what follows from them is decided in
candidates.py.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.priors import inverse, prior, ranges
from hoopd.plants.likelihood.recording_parameters import plain
from hoopd.plants.likelihood.stretches import Stretch

Array = NDArray[np.float64]

FOLDS = 3
# What the other blocks know of a parameter less than this share of is not tested by a block.
LEAST_KNOWN = 0.1


def fold_gain(before: HypothesisFit, after: HypothesisFit) -> float | None:
    """Nats by which the second explains each block better, its parameters from the others; None: no block can say.

    A block that alone shows what only one of the two has (a push, a limit that is reached once) is left out.
    """
    own = {e.name for e in before.effects} ^ {e.name for e in after.effects}
    pairs = zip(_losses(before, own), _losses(after, own), strict=True)
    gains = [a - b for a, b in pairs if a is not None and b is not None]
    return float(sum(gains)) if gains else None


def fold_values(found: HypothesisFit) -> list[dict[str, float]]:
    """The parameters that the other blocks ask for, block by block."""
    if not found.free:
        return [dict(found.values)] * FOLDS
    moves = (_within(found, one.known @ one.right) for one in _folds(found))
    return [{**found.values, **dict(zip(found.free, _values(found) + move, strict=True))} for move in moves]


def _values(found: HypothesisFit) -> Array:
    return np.array([found.values[name] for name in found.free])


def _losses(found: HypothesisFit, own: Collection[str]) -> Iterator[float | None]:
    """Of each fold; None where the rest does not know the effects `own`."""
    rows, log_s = found.stacked(), _log_s(found)
    r, x = rows[:, 0], -rows[:, 1:]
    weight, _ = prior(found.effects, found.tracks, found.free, found.values)
    asked = [i for i, name in enumerate(found.free) if plain(name).rpartition(".")[0] in own]
    whole = np.diag(inverse(x.T @ x + np.diag(weight)))
    for one in _folds(found):
        if any(whole[i] < LEAST_KNOWN * one.known[i, i] for i in asked):
            yield None
            continue
        delta = _within(found, one.known @ one.right)
        left = r[one.rows] - x[one.rows] @ delta
        yield float(left @ left + log_s[one.rows].sum()) / 2.0


class _Fold(NamedTuple):
    """A block left out: its rows, and the normal equations of the others."""

    rows: NDArray[np.bool_]
    known: Array  # (m, m) covariance
    right: Array  # (m,)


def _folds(found: HypothesisFit) -> Iterator[_Fold]:
    rows, fold = found.stacked(), fold_of_rows(found)
    r, x = rows[:, 0], -rows[:, 1:]
    weight, centre = prior(found.effects, found.tracks, found.free, found.values)
    for k in range(FOLDS):
        rest = fold != k
        yield _Fold(~rest, inverse(x[rest].T @ x[rest] + np.diag(weight)), x[rest].T @ r[rest] + weight * centre)


def _log_s(found: HypothesisFit) -> Array:
    """(rows,) log of the innovation's variance of each reading; 0 where nothing was read."""
    parts = []
    for columns, gain in zip(found.columns, found.gains, strict=True):
        size = np.einsum("nii->ni", gain.whiten)
        parts.append(np.where(columns.model.seen, -2.0 * np.log(np.where(columns.model.seen, size, 1.0)), 0.0).ravel())
    return np.concatenate(parts)


def fold_of_rows(found: HypothesisFit) -> NDArray[np.int64]:
    """(rows,) which block of its recording each row belongs to: as many seconds in each."""
    spans, parts = spans_of([track.stretch for track in found.tracks]), []
    for track in found.tracks:
        low, high = spans[track.stretch.recording]
        block = np.clip((FOLDS * (track.stretch.t - low) / (high - low)).astype(np.int64), 0, FOLDS - 1)
        parts.append(np.repeat(block, track.stretch.y.shape[1]))
    return np.concatenate(parts)


def spans_of(stretches: Sequence[Stretch]) -> dict[str, tuple[float, float]]:
    """By recording: where its first stretch begins and its last one ends, s."""
    spans: dict[str, tuple[float, float]] = {}
    for one in stretches:
        low, high = spans.get(one.recording, (np.inf, -np.inf))
        spans[one.recording] = min(low, float(one.t[0])), max(high, float(one.t[-1]))
    return spans


def _within(found: HypothesisFit, delta: Array) -> Array:
    """The step cut at the ends of the parameters' ranges."""
    bounds = ranges(found.effects, found.tracks)
    out = delta.copy()
    for i, name in enumerate(found.free):
        low, high = bounds.get(plain(name), (-np.inf, np.inf))
        out[i] = np.clip(found.values[name] + delta[i], low, high) - found.values[name]
    return out
