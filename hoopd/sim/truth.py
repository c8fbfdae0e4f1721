"""The plant's true state every 20 ms: what tests and figures judge a controller by.

Rules of this file: comma separated, one header, full precision; times in s, angles in rad. In lock-step a row belongs
to a tick and `t` is its run time; in real time the board writes the rows and `t` is the machine's monotonic clock.
"""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]
State = tuple[float, float, float, float]


class Truth(NamedTuple):
    """Columns of one length."""

    t: Column  # s, the tick's deadline (lock-step) or the monotonic clock
    theta: Column  # rad, unwrapped
    dtheta: Column  # rad/s
    psi: Column  # rad, unwrapped
    dpsi: Column  # rad/s
    distance: Column  # of the ball from the axis, in shares of what it is on the hoop; below 1 it flies


class TruthFile:
    """A sink that writes one row per call."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="ascii")
        self._file.write(",".join(Truth._fields) + "\n")

    def __call__(self, t: float, state: State, distance: float) -> None:
        """Write the plant's state at run time `t`."""
        self._file.write(",".join(map(repr, (t, *state, distance))) + "\n")

    def __enter__(self) -> TruthFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Write what is left."""
        self._file.close()


def read(path: Path) -> Truth:
    """The rows of a finished run."""
    return Truth(*np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).T)
