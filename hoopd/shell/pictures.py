"""Pictures as every camera back end hands them over, and what their time stamps mean.

Rules of this file: no camera here; times of `Frame` are run time (seconds since the daemon's start, monotonic clock).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from hoopd.core.records import CameraSample

Image = npt.NDArray[np.uint8]
Clock = Callable[[], float]

# A clock is believed when it makes one of the last pictures this old on arrival: a frame can neither come from the
# future (but for the clocks' reading one after the other) nor do they all wait longer than any queue of a camera.
YOUNGEST_S = -0.002
OLDEST_S = 1.0
LATEST_S = 5.0  # by a clock that is believed; a camera that hangs for longer is started anew
# Lateness only ever adds to a picture's age, and a busy computer catches up with its pictures: so many in a row that
# are all impossible (half a second of them) are no lateness.
DOUBTFUL_PICTURES = 25
# The stamp of a camera on a CSI-2 cable is the frame start: the first row's readout, which ends that row's exposure.
STAMP_TO_MIDDLE = -0.5  # of the exposure time
NO_STAMP = "pictures carry no usable stamp; their time is taken as arrival less camera.delay_s"
# A blocked wait looks this often whether it is to end.
CANCEL_STEP_S = 0.1


class CameraError(RuntimeError):
    """The camera failed while it ran; the text is one line for the log."""


class Frame(NamedTuple):
    """One picture; `data` is valid until the back end has delivered three more."""

    number: int  # of this picture, counted by the back end; the same number again: no new picture came
    t: float  # s, run time of the middle of the exposure
    t_arrival: float  # s, run time at which the whole picture was here
    data: Image  # bgr: (height, width, 3); i420: flat planes Y, U, V
    kind: Literal["bgr", "i420"]
    size: tuple[int, int, int]  # width, height, stride in pixels


class Analysed(NamedTuple):
    """A picture and what was found in it."""

    frame: Frame
    sample: CameraSample


class Backend(Protocol):
    """One way to pictures. `open`, `read` and `close` belong to one thread, `cancel` may come from any."""

    note: str  # one line about a shortcoming found while running, "" when there is none

    def open(self) -> None:
        """Start the camera; InputError when it is not there."""

    def read(self) -> Frame | None:
        """Wait for the next picture; None at the regular end, CameraError when the camera fails."""

    def waiting(self) -> bool:
        """A newer picture waits already: the last one is part of a backlog."""

    def cancel(self) -> None:
        """Let a waiting `read` end soon, where the way to the camera allows it."""

    def close(self) -> None:
        """Let go of the camera; bounded, and harmless when it is not open."""


class Stamps:
    """Brings camera stamps into run time.

    A stamp counts in CLOCK_MONOTONIC or in CLOCK_BOOTTIME, whichever makes the pictures' age possible; they are the
    same on a computer that never sleeps.
    """

    def __init__(self, t0: float, delay_s: float) -> None:
        self._t0 = t0
        self._delay_s = delay_s
        self._doubts = [DOUBTFUL_PICTURES, DOUBTFUL_PICTURES]  # pictures since the clock's last possible age
        self._pictures = 0

    @property
    def unusable(self) -> bool:
        """None of many pictures in a row had a stamp of a clock that we know."""
        return self._pictures >= DOUBTFUL_PICTURES and min(self._doubts) >= DOUBTFUL_PICTURES

    def mid_exposure(self, stamp_s: float | None, to_middle_s: float, t_arrival: float) -> tuple[float, bool]:
        """Run time of the exposure's middle, and whether the stamp gave it.

        A picture that is older than OLDEST_S by a clock that is believed is late, and its stamp says how late. Without
        a usable stamp: arrival less the usual delay.
        """
        self._pictures += 1
        if stamp_s is None:
            self._doubts = [doubts + 1 for doubts in self._doubts]
            return t_arrival - self._delay_s, False
        times = [stamp_s - ahead_s - self._t0 + to_middle_s for ahead_s in (0.0, boottime_ahead_s())]
        for clock, t in enumerate(times):
            possible = YOUNGEST_S <= t_arrival - t <= OLDEST_S
            self._doubts[clock] = 0 if possible else self._doubts[clock] + 1
        for doubts, t in zip(self._doubts, times, strict=True):
            if doubts < DOUBTFUL_PICTURES and YOUNGEST_S <= t_arrival - t <= LATEST_S:
                return min(t, t_arrival), True
        return t_arrival - self._delay_s, False


def boottime_ahead_s() -> float:
    """How far CLOCK_BOOTTIME is ahead of CLOCK_MONOTONIC: the time this computer has slept."""
    before = time.monotonic()
    boot = time.clock_gettime(time.CLOCK_BOOTTIME)
    return boot - (before + time.monotonic()) / 2
