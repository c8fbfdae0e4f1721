"""Faults of the camera that are effects: late frames and false detections, over all recordings together.

Rules of this file: an effect is there all the time and in most recordings; gains are judged on the scale of the
search. What a sample is was decided before (`quality`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np

from hoopd.diagnose.quality import population
from hoopd.diagnose.quality.recording_quality import Quality
from hoopd.diagnose.quality.sensor_samples import Share
from hoopd.diagnose.search.surprise import THRESHOLD, needed_gain, surprise
from hoopd.ident.normal import Z95

# Above this share a fault is an effect: below, it costs a fit nothing that setting samples aside does not mend.
EFFECT_SHARE = 0.02
# Late frames: equal to the bit, or measured anew, a share of either.
LATE_COLUMNS = 2


@dataclass(frozen=True)
class CountedFault:
    """One fault over all recordings, of a camera or a drive, that is counted and not fitted."""

    name: str  # slot.effect
    share: float
    ci95: tuple[float, float]
    gain: float  # nats, all recordings together
    surprise: float  # of that gain
    needed: float  # gain that is surprising enough


def camera_faults(qualities: Sequence[Quality], threshold: float = THRESHOLD) -> list[CountedFault]:
    """Those that are effects, the largest gain first."""
    seen = dict.fromkeys((camera.name, one.sensors[camera.name].slot) for one in qualities for camera in one.cameras)
    every = [fault for channel, slot in seen for fault in _of_channel(channel, slot, qualities, threshold)]
    return sorted(every, key=lambda one: -one.gain)


def _of_channel(channel: str, slot: str, qualities: Sequence[Quality], threshold: float) -> Iterator[CountedFault]:
    """Faults of what a camera sees in one channel."""
    every = [one.channels[channel] for one in qualities if channel in one.channels]
    seen = [one for one in every if one.counts.any()]
    late, false = [one.late_share for one in seen], [one.outlier_share() for one in seen]
    both = (
        _fault(f"{slot}.late_frames", late, LATE_COLUMNS, 1, threshold),
        _fault(f"{slot}.outliers", false, population.COLUMNS, population.LOOKED_AT, threshold),
    )
    yield from (one for one in both if one is not None)


def _fault(name: str, shares: Sequence[Share], columns: int, looked_at: int, threshold: float) -> CountedFault | None:
    """None where it is none: too small, in clusters, in less than half of the recordings, or by chance."""
    there = [one for one in shares if min(one.value, one.spread) > EFFECT_SHARE]
    if not shares or 2 * len(there) < len(shares):
        return None
    share, error = pooled(shares)
    gain, columns, looked_at = sum(one.gain for one in shares), columns * len(shares), looked_at ** len(shares)
    told = surprise(gain, columns, looked_at)
    if told <= threshold or share <= EFFECT_SHARE:
        return None
    ends = max(share - Z95 * error, 0.0), min(share + Z95 * error, 1.0)
    return CountedFault(name, share, ends, gain, told, needed_gain(threshold, columns, looked_at))


def pooled(shares: Sequence[Share]) -> tuple[float, float]:
    """Share of all samples and its standard error: what each recording does not know of its own, or, where that is
    more, by how much the recordings differ.

    share = sum w_i p_i, w_i = n_i / sum n;  within: sum w_i^2 e_i^2;  between: sum w_i^2 (p_i - share)^2 k / (k - 1)
    """
    weights = np.array([one.samples for one in shares], dtype=float)
    weights /= max(weights.sum(), 1.0)
    values, errors = np.array([one.value for one in shares]), np.array([one.error for one in shares])
    share, k = float(weights @ values), len(shares)
    within = float(weights**2 @ errors**2)
    between = float(weights**2 @ (values - share) ** 2) * k / (k - 1) if k > 1 else 0.0
    return share, sqrt(max(within, between))
