"""How far the ball was from where it was told to be: by the camera's own measurement, on the rig by its true state too.

Rules of this file: never by the filter's estimate, which believes the very model that is to be judged; an angle counts
at the time at which it was so, against the reference of that time; a sample that is missing is left out.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import isfinite, nan, tau
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.core.modes import Mode
from hoopd.core.records import TickRecord

# The error is that of the last seconds, once a release is over: 0.6 s by the LQG, 2.4 s by the PID.
RELEASE_S, SETTLED_S = 2.5, 5.0
# The rig is asked for its state of so long ago: by then its own process has written it down.
TRUTH_AGE_S = 0.1
REFERENCES = 64  # ticks that are remembered: a picture is two to four old
SAME_TIME_S = 1e-6

# Run time in s -> the plant's true psi in rad at that time, None where it is not known.
Truth = Callable[[float], float | None]


class Sample(NamedTuple):
    """One angle and its distance to the reference."""

    t: float  # s
    psi: float  # rad
    error: float  # rad, to the nearest turn


class TrackingError:
    """Collects the angles of the last settled seconds of control."""

    def __init__(self, truth: Truth | None = None) -> None:
        self.measured: deque[Sample] = deque()
        self.true: deque[Sample] = deque()
        self._truth = truth
        self._references: deque[tuple[float, float]] = deque(maxlen=REFERENCES)
        self._running_t: float | None = None  # since when

    def put(self, record: TickRecord) -> None:
        """Look at one tick."""
        self._references.append((record.t, record.reference))
        if record.mode != Mode.RUNNING:
            self._running_t = None
            return
        if self._running_t is None:
            self._running_t = record.t
        if isfinite(record.psi) and self._settled(record.psi_t):
            self._keep(self.measured, record.psi_t, record.psi)
        t = record.t - TRUTH_AGE_S
        if self._truth is not None and self._settled(t) and (psi := self._truth(t)) is not None:
            self._keep(self.true, t, psi)

    def summary(self) -> dict[str, Any]:
        """By whom the error was judged -> what it was, as plain data; None where nothing was to be judged."""
        measured = _judged(self.measured)
        if measured is not None:
            measured["noise_rad"] = _noise(self.measured)
        return {"measured": measured, "true": _judged(self.true)}

    def _settled(self, t: float) -> bool:
        return self._running_t is not None and t - self._running_t >= RELEASE_S

    def _keep(self, samples: deque[Sample], t: float, psi: float) -> None:
        off = psi - self._reference_at(t)
        samples.append(Sample(t, psi, off - tau * round(off / tau)))
        while t - samples[0].t > SETTLED_S:
            samples.popleft()

    def _reference_at(self, t: float) -> float:
        """The reference that was in force at `t`, the oldest remembered one before that."""
        return next((wanted for since, wanted in reversed(self._references) if since <= t + SAME_TIME_S),
                    self._references[0][1])  # fmt: skip


def _judged(samples: deque[Sample]) -> dict[str, Any] | None:
    if not samples:
        return None
    errors = np.array([sample.error for sample in samples])
    return {
        "over_s": [samples[0].t, samples[-1].t],
        "samples": len(samples),
        "rms_rad": float(np.sqrt(np.mean(errors**2))),
        "mean_rad": float(np.mean(errors)),
    }


def _noise(samples: deque[Sample]) -> float:
    """Standard deviation of what is not motion in four equally spaced angles in a row, in rad; NaN without such."""
    t, psi = np.array([[sample.t, sample.psi] for sample in samples]).T
    gaps = np.diff(t)
    if len(gaps) < 3:
        return nan
    regular: NDArray[np.bool_] = np.abs(gaps - np.median(gaps)) < 0.25 * np.median(gaps)
    rows = regular[:-2] & regular[1:-1] & regular[2:]
    # third differences take any motion of at most second order away: variance (1 + 9 + 9 + 1) sigma^2
    thirds = np.diff(psi, 3)[rows]
    return float(np.sqrt(np.mean(thirds**2) / 20.0)) if len(thirds) else nan
