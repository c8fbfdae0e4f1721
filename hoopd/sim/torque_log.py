"""The torque that the simulated board really applied: written by the board, read by the tests that judge safety.

Rules of this file: one JSON object a line, each written with one system call, so that a killed process loses nothing;
a row holds from its `t` until the next row's. `t` is the board's clock: the machine's monotonic clock in real time
(compare with `time.monotonic()` of any process), virtual seconds in lock-step.
"""

from __future__ import annotations

import json
import math
import os
from bisect import bisect_right
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Protocol


class TorqueRow(NamedTuple):
    """From `t` on the motor gets `torque_nm`."""

    t: float
    torque_nm: float
    enabled: bool
    reason: str  # start | request | cleared | refused | timeout | fault | reset | end


class TorqueSink(Protocol):
    """Where a board hands its rows."""

    def __call__(self, row: TorqueRow, /) -> None: ...


class TorqueLogFile:
    """A sink that appends JSON lines without buffering."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND | os.O_CLOEXEC, 0o644)

    def __call__(self, row: TorqueRow) -> None:
        enabled = "true" if row.enabled else "false"
        text = f'{{"t":{row.t:.6f},"torque_nm":{row.torque_nm!r},"enabled":{enabled},"reason":"{row.reason}"}}\n'
        os.write(self._fd, text.encode())

    def close(self) -> None:
        os.close(self._fd)

    def __enter__(self) -> TorqueLogFile:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self.close()


class TorqueLog:
    """Rows in the order of time, and the questions a test asks of them."""

    def __init__(self, rows: list[TorqueRow]) -> None:
        self.rows = rows
        self._times = [row.t for row in rows]

    def __len__(self) -> int:
        return len(self.rows)

    def row_at(self, t: float) -> TorqueRow | None:
        """The row in force at `t`; None before the first."""
        index = bisect_right(self._times, t) - 1
        return self.rows[index] if index >= 0 else None

    def torque_at(self, t: float) -> float:
        """Torque in N m in force at `t`; zero before the board started."""
        row = self.row_at(t)
        return row.torque_nm if row else 0.0

    def enabled_at(self, t: float) -> bool:
        row = self.row_at(t)
        return row.enabled if row else False

    def max_abs(self, start: float = -math.inf, stop: float = math.inf) -> float:
        """Largest |torque| in N m in force anywhere in [start, stop]; NaN in the log gives NaN."""
        values = [abs(row.torque_nm) for begin, end, row in self._spans(stop) if end > start or begin >= start]
        return math.nan if any(map(math.isnan, values)) else max(values, default=0.0)

    def longest_nonzero_after(self, t: float, stop: float = math.inf) -> float:
        """Seconds of the longest unbroken stretch of torque that lies after `t`; a last row counts up to `stop`."""
        longest, begin = 0.0, None
        for start, end, row in self._spans(stop):
            if end <= t:
                continue
            if row.torque_nm == 0.0:
                begin = None
                continue
            begin = max(start, t) if begin is None else begin
            longest = max(longest, end - begin)
        return longest

    def zero_from(self, t: float) -> float:
        """Seconds after `t` until the torque is zero for the first time; inf when the log never shows it."""
        if self.torque_at(t) == 0.0:
            return 0.0
        return next((row.t - t for row in self.rows if row.t > t and row.torque_nm == 0.0), math.inf)

    def zero_for_good_from(self, t: float) -> float:
        """Seconds after `t` from which the torque is zero in all that follows; inf when the log ends with torque."""
        if self.rows and self.rows[-1].torque_nm != 0.0:
            return math.inf
        last = max((end for _, end, row in self._spans() if row.torque_nm != 0.0), default=-math.inf)
        return max(last - t, 0.0)

    def reasons(self) -> dict[str, int]:
        """How often each reason stands in the log."""
        counts: dict[str, int] = {}
        for row in self.rows:
            counts[row.reason] = counts.get(row.reason, 0) + 1
        return counts

    def _spans(self, stop: float = math.inf) -> Iterator[tuple[float, float, TorqueRow]]:
        """(begin, end, row) for every row up to `stop`; the last one ends at `stop`, or where it began without one."""
        for row, following in zip_longest(self.rows, self._times[1:]):
            if row.t > stop:
                return
            end = following if following is not None else (stop if math.isfinite(stop) else row.t)
            yield row.t, min(end, stop), row


def read(path: Path) -> TorqueLog:
    """The log of a finished, killed or still running board; a torn last line is left out."""
    rows = []
    for line in Path(path).read_text().splitlines():
        try:
            data = json.loads(line)
        except ValueError:
            break
        rows.append(TorqueRow(data["t"], data["torque_nm"], data["enabled"], data["reason"]))
    return TorqueLog(rows)
