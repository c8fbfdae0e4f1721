"""Free runs over blocks of the training data, each with parameters that were fitted to the other blocks.

A simulation of the data that it was fitted to says little of the next recording; one of a block that was held back says
as much as a held-out recording, and spends none. Blocks are those of `search.folds`.

Rules of this file: fits in, runs out; what follows from them is decided elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.fit_tables import Played, start_weights
from hoopd.diagnose.proof.simulation import fitted_starts, windows_of
from hoopd.diagnose.proof.window_lengths import WINDOW_S, window_of
from hoopd.diagnose.search.folds import FOLDS, fold_values, spans_of
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Stretch

Array = NDArray[np.float64]

Values = Sequence[Mapping[str, float]]


class HeldBlock(NamedTuple):
    """What of a stretch is in one block, and the smoother's states there."""

    stretch: Stretch
    reference: Array  # (nodes, nz)
    track: Track


def blocks_of(found: HypothesisFit) -> list[list[HeldBlock]]:
    """Of each fold: the parts that are long enough for a run."""
    spans = spans_of([track.stretch for track in found.tracks])
    return [[part for track in found.tracks if (part := _part(track, spans, k)) is not None] for k in range(FOLDS)]


def _part(track: Track, spans: Mapping[str, tuple[float, float]], k: int) -> HeldBlock | None:
    low, high = spans[track.stretch.recording]
    first, last = (low + (high - low) * edge / FOLDS for edge in (k, k + 1))
    part = track.stretch.seconds(first, last)
    if len(part.t) < 3 or part.t[-1] - part.t[0] < window_of([part.plant]) / 2.0:
        return None
    begin = int(np.searchsorted(track.stretch.t, part.t[0]))
    return HeldBlock(part, track.z[begin : begin + len(part.t)], track)


def fold_runs(found: HypothesisFit, values: Values | None = None, length_s: float | None = WINDOW_S) -> Played:
    """A hypothesis on every block, in windows of this length (None: in one run over each).

    `values`: of each block, fitted without it; not given: those of the likelihood.
    """
    values, runs = fold_values(found) if values is None else values, []
    for own, blocks in zip(values, blocks_of(found), strict=True):
        for one in blocks:
            windows = windows_of(one.stretch, length_s)
            sigma = start_weights(one.stretch)
            runs.append(fitted_starts(windows, found.effects, one.track.local(own), one.reference, sigma))
    return Played(found, runs)
