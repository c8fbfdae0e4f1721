"""The plant's last states in a small shared file: written by the board's process, read by the camera's.

Rules of this file: one writer, any number of readers, nobody waits. Each row carries its number; the writer zeroes it
before it touches the row and sets it after, the reader takes the numbers before and after the data and drops rows whose
number changed meanwhile. Times are the machine's monotonic clock.
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

# 1 s at one row each 2 ms: the camera looks back two frames (40 ms), and a late picture some more.
DEFAULT_ROWS: Final = 512
_MAGIC: Final = b"hoopring"
_HEAD: Final = struct.Struct("@8sQ")  # magic, rows
_NUMBER: Final = struct.Struct("@Q")
_DATA: Final = struct.Struct("@6d")
_ROW_BYTES: Final = _NUMBER.size + _DATA.size
_ROW: Final = np.dtype([("number", np.uint64), ("data", np.float64, (6,))])


class PlantState(NamedTuple):
    """State of the plant at one instant."""

    t: float  # s, monotonic clock
    theta: float
    dtheta: float
    psi: float
    dpsi: float
    distance: float = 1.0  # of the ball from the axis, in shares of what it is on the hoop


class StateRingWriter:
    """Creates the file and appends rows, the oldest falling out."""

    def __init__(self, path: Path, rows: int = DEFAULT_ROWS) -> None:
        self._rows = rows
        self._count = 0
        with path.open("wb+") as file:
            file.truncate(_HEAD.size + rows * _ROW_BYTES)
            self._map = mmap.mmap(file.fileno(), 0)
        _HEAD.pack_into(self._map, 0, _MAGIC, rows)

    def push(self, t: float, state: tuple[float, float, float, float], distance: float = 1.0) -> None:
        """Append one row; times must rise."""
        start = _HEAD.size + (self._count % self._rows) * _ROW_BYTES
        self._count += 1
        _NUMBER.pack_into(self._map, start, 0)
        _DATA.pack_into(self._map, start + _NUMBER.size, t, *state, distance)
        _NUMBER.pack_into(self._map, start, self._count)

    def close(self) -> None:
        self._map.close()


class StateRingReader:
    """Looks up the state at an instant of the recent past."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ)
        magic, rows = _HEAD.unpack_from(self._map, 0)
        if magic != _MAGIC or len(self._map) != _HEAD.size + rows * _ROW_BYTES:
            raise ValueError(f"{path}: not a state ring")

    def rows(self) -> NDArray[np.float64]:
        """(n, 6) t, theta, dtheta, psi, dpsi, distance: all consistent rows, oldest first."""
        before, data, after = (np.frombuffer(self._map[_HEAD.size :], _ROW) for _ in range(3))
        number = before["number"]
        good = (number != 0) & (number == after["number"])
        values: NDArray[np.float64] = data["data"][good][np.argsort(number[good])]
        return values

    def latest(self) -> PlantState | None:
        """The newest row."""
        rows = self.rows()
        return PlantState(*map(float, rows[-1])) if len(rows) else None

    def at(self, t: float) -> PlantState | None:
        """State at monotonic time `t`, between rows by their angles and rates; None outside of what the ring holds."""
        rows = self.rows()
        if not len(rows) or not rows[0, 0] <= t <= rows[-1, 0]:
            return None
        index = min(max(int(np.searchsorted(rows[:, 0], t)), 1), len(rows) - 1)
        return _between(t, rows[index - 1].tolist(), rows[index].tolist()) if len(rows) > 1 else self.latest()

    def close(self) -> None:
        self._map.close()


def _between(t: float, a: list[float], b: list[float]) -> PlantState:
    """Cubic Hermite for the angles (error below 1e-9 rad on a 2 ms grid), straight line for the rates."""
    h = b[0] - a[0]
    s = (t - a[0]) / h
    weights = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2 * h, s * s * (3 - 2 * s), s * s * (s - 1) * h
    theta, psi = (sum(w * q for w, q in zip(weights, (a[i], a[i + 1], b[i], b[i + 1]), strict=True)) for i in (1, 3))
    dtheta, dpsi = (a[i] + s * (b[i] - a[i]) for i in (2, 4))
    return PlantState(t, theta, dtheta, psi, dpsi, a[5] + s * (b[5] - a[5]))
