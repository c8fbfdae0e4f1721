"""Which surprise the best of the library reaches where nothing is hidden: the threshold that is shipped.

A null says how large a surprise gets by chance, by disturbances that are no Ornstein-Uhlenbeck process and by noise
with heavy tails. Beyond its upper quartile the largest surprise of a null falls off exponentially (a tail of
log-likelihood ratios): P(S > s) = P(S > u) exp(-(s - u)/m), m the mean excess over u.

Rules of this file: pure; tuning seeds only. An alarm that no threshold of a name governs (an unknown curve, a fault of
the camera) is counted apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from concealed.judged import Judged
from concealed.proportions import rate

AIM = 0.02  # false alarms
TAIL_FROM = 0.75  # quantile beyond which the tail is taken to be exponential
THRESHOLDS = (6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 20.0)  # nats


def calibration(cases: Sequence[Judged], aim: float = AIM) -> dict[str, Any]:
    """Rates by threshold of nulls, decoys and singles, and the threshold that the tail of the nulls asks for."""
    nulls = [case for case in cases if case.said and case.family("null", "decoy")]
    singles = [case for case in cases if case.said and case.family("single") and case.truth]
    largest = np.array([largest_surprise(case.said or {}) for case in nulls])
    return {
        "nulls": len(nulls),
        "singles": len(singles),
        "largest": sorted(round(float(one), 3) for one in largest),
        "by_threshold": [
            {
                "threshold": threshold,
                "alarms": rate(bool(one > threshold) for one in largest),
                "seen": rate(largest_surprise(case.said or {}) > threshold for case in singles),
            }
            for threshold in THRESHOLDS
        ],
        "other_alarms": rate(_other_alarm(case) for case in nulls),
        "recommended": None if len(largest) < 2 else tail_threshold(largest, aim),
        "aim": aim,
    }


def largest_surprise(said: Mapping[str, Any]) -> float:
    """Nats, of all names that were tried; 0 when none has a surprise."""
    return max((float(one.get("surprise") or 0.0) for one in said.get("candidates", [])), default=0.0)


def tail_threshold(largest: np.ndarray, aim: float) -> float:
    """The surprise that nulls exceed with the chance `aim`, by the exponential tail of `largest` (n,)."""
    start = float(np.quantile(largest, TAIL_FROM))
    beyond = largest[largest > start]
    if not len(beyond):
        return start
    mean_excess = float((beyond - start).mean())
    return start + mean_excess * float(np.log(len(beyond) / len(largest) / aim))


def _other_alarm(case: Judged) -> bool:
    """A null that was called something although no name's surprise asked for it."""
    threshold = max((one.get("threshold") or 0.0 for one in (case.said or {}).get("candidates", [])), default=0.0)
    return case.alarm and largest_surprise(case.said or {}) <= threshold
