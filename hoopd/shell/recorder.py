"""The recorder: a bounded queue before a thread that writes, so that no disk can delay a tick.

Rules of this file: the loop's side appends and returns; the queue drops its oldest rows and counts them; a failing
disk is one event, a flag and a new file later, never an exception in the loop; closing has a deadline. In lock-step
(`synchronous`) the same rows are written at once, without a thread, a clock or fsync: the same run, the same bytes.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import msgspec

from hoopd.core.records import Inputs, TickRecord
from hoopd.recording.mcap import Header, Writer
from hoopd.recording.schemas import LogEvent
from hoopd.shell.descriptors import opened
from hoopd.shell.helpers import start_helper
from hoopd.shell.run_files import Limits, create, make_room

QUEUE_ROWS = 1500  # 30 s of ticks: longer than the stalls of an SD card (2.5 s were seen), about 2 MB
POLL_S = 0.1  # with the writer's quarter second this bounds what a kill can take: 0.35 s and the write itself
RETRY_S = (5.0, 10.0, 20.0, 60.0)  # after the first, second ... failure in a row; then always the last
ROOM_ROWS = 1500  # rows between two looks at the quota
DESCRIPTORS = 3  # to begin a file: itself, its folder, and one to look at the others
FILE_SHARE = 0.5  # of the quota: a longer run goes on in a next part, so that its own beginning can be deleted

OnEvent = Callable[[str, str, Mapping[str, Any]], None]  # name, level, particulars


class RecorderCounts(NamedTuple):
    """What the recorder did so far."""

    written: int  # rows and events handed to the disk
    dropped: int  # rows and events that no file has
    failures: int  # times that the disk refused
    file: str  # name of the current file, empty without one


Row = LogEvent | tuple[TickRecord, Inputs]


class _Sink:
    """The open file of a run, or none; OSError passes through, and rows not yet safe are kept for the next file."""

    def __init__(self, folder: Path, header: Header, limits: Limits, sync: bool, zero_ns: Callable[[], int]) -> None:
        self._folder, self._header, self._limits, self._sync, self._zero_ns = folder, header, limits, sync, zero_ns
        self._file: BinaryIO | None = None
        self._writer: Writer | None = None
        self._flushes = self._rows = 0
        self.path: Path | None = None
        self.parts = 0
        self.unsafe: list[Row] = []  # taken, but lost if the process ended now: a quarter second of rows

    @property
    def proven(self) -> bool:
        """The open file has taken rows to the disk."""
        return self._writer is not None and self._writer.flushes > 0

    def add(self, row: Row) -> list[str]:
        """Write one row, opening a file when there is none; names of runs deleted on the way."""
        self.unsafe.append(row)
        deleted = opened(self._room, DESCRIPTORS) if self._rows % ROOM_ROWS == ROOM_ROWS - 1 else []
        if self._writer is None:
            return opened(self._open, DESCRIPTORS)
        self._write(self.unsafe[-1:])
        return deleted

    def flush(self) -> None:
        """Make all rows safe on the disk."""
        if self._writer and self.unsafe:
            self._writer.flush()
            self._settle(0)

    def finish(self, keep: int = 0) -> None:
        """Close the file whole; the next row opens another; the last `keep` rows are for that one."""
        if self._writer is None and self.unsafe:
            opened(self._open, DESCRIPTORS)
        writer, file = self._writer, self._file
        if writer is not None and file is not None:
            writer.finish()
            self._settle(keep)
            file.close()
            self._writer = self._file = None

    def abandon(self) -> int:
        """Let the file go without what was half written, which the next one gets whole; remove it when no row of it is
        safe. Returns how many rows went with a file that somebody deleted."""
        gone = self._rows - len(self.unsafe) if self._file is not None and _is_deleted(self._file) else 0
        file, empty, size = self._file, not self.proven, self._writer.size if self._writer is not None else 0
        self._file = self._writer = None
        with contextlib.suppress(OSError):
            if file is not None:
                file.truncate(size)
        with contextlib.suppress(OSError):
            if file is not None:
                file.close()
            if file is not None and self.path is not None and empty:
                self.path.unlink()
                self.parts -= 1
        self.path = None
        return max(gone, 0)

    def _open(self) -> list[str]:
        """The next file, begun with the rows that the last one did not keep."""
        deleted = make_room(self._folder, self._limits)
        self.path, self._file = create(self._folder)
        self.parts += 1
        self._flushes = self._rows = 0
        header = msgspec.structs.replace(self._header, part=self.parts - 1)
        self._writer = Writer(self._file, header, sync=self._sync, zero_ns=self._zero_ns())
        self._write(list(self.unsafe))
        return deleted

    def _write(self, rows: list[Row]) -> None:
        assert self._writer is not None
        for left, row in zip(range(len(rows), 0, -1), rows, strict=True):
            if isinstance(row, LogEvent):
                self._writer.add_event(row)
            else:
                self._writer.add(*row)
            self._rows += 1
            self._settle(left)

    def _settle(self, keep: int) -> None:
        """After a flush only the rows behind it are unsafe."""
        if self._writer is not None and self._writer.flushes != self._flushes:
            if self._file is not None and _is_deleted(self._file):  # it would take rows for ever, and have no name
                raise OSError(errno.ESTALE, "the file was deleted while it was written")
            self._flushes = self._writer.flushes
            self.unsafe = self.unsafe[len(self.unsafe) - keep :]

    def _room(self) -> list[str]:
        if self._writer is not None and self._writer.size > FILE_SHARE * self._limits.quota_bytes:
            self.finish(keep=1)
            return []
        return make_room(self._folder, self._limits, keep=self.path)


def _is_deleted(file: BinaryIO) -> bool:
    return os.fstat(file.fileno()).st_nlink == 0


class Recorder:
    """Takes rows from the tick and keeps them in `run-NNNN.mcap`."""

    def __init__(
        self,
        folder: Path,
        header: Header,
        *,
        limits: Limits | None = None,
        synchronous: bool = False,
        zero_ns: Callable[[], int] = lambda: 0,
        on_event: OnEvent | None = None,
        queue_rows: int = QUEUE_ROWS,
        retry_s: tuple[float, ...] = RETRY_S,
    ) -> None:
        """`zero_ns`: wall clock at run time 0, asked at the beginning of each file."""
        self._sink = _Sink(Path(folder), header, limits or Limits(), not synchronous, zero_ns)
        self._on_event, self._retry_s, self._synchronous = on_event, retry_s, synchronous
        self._queue: deque[tuple[int, Row]] = deque(maxlen=queue_rows)
        self._numbers = itertools.count()
        self._next = self._taken = self._gone = self._lost = self._failures = self._in_row = 0
        self._failing, self._dropping, self._try_at, self._run_s = False, False, 0.0, 0.0
        self._stop = threading.Event()
        self._thread = None if synchronous else start_helper("recorder", self._run)

    @property
    def trouble(self) -> bool:
        """The disk refuses, rows were just dropped, or the queue is full."""
        return self._failing or self._dropping or len(self._queue) == self._queue.maxlen

    @property
    def counts(self) -> RecorderCounts:
        """Counters for the status message."""
        path, unsafe = self._sink.path, len(self._sink.unsafe)
        written = max(0, self._taken - self._lost - unsafe)
        return RecorderCounts(written, self._pushed_out() + self._lost, self._failures, path.name if path else "")

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        """One tick; never waits (lock-step: written before it returns)."""
        self._queue.append((next(self._numbers), (record, inputs)))
        if self._synchronous:
            self._run_s = record.t
            self._drain()

    def event(self, t: float, event: str, level: str = "info", **fields: Any) -> None:
        """One event at run time `t`; never waits, from any thread."""
        self._queue.append((next(self._numbers), LogEvent(t, event, level, fields)))
        if self._synchronous:
            self._drain()

    def close(self, timeout_s: float = 2.0) -> bool:
        """Write the rest and close the file; False when the disk refused or did not let go in time."""
        self._stop.set()
        if self._thread is None:
            self._finish()
            return not self._failing
        self._thread.join(timeout_s)
        return not self._thread.is_alive() and not self._failing

    def _run(self) -> None:
        while not self._stop.wait(POLL_S):
            self._drain()
        self._finish()

    def _finish(self) -> None:
        if self._guarded(self._write_queue):
            self._guarded(self._sink.finish)
        self._lost += len(self._sink.unsafe)
        self._sink.unsafe = []

    def _drain(self) -> None:
        """Write what waits, or leave it waiting while the disk refuses."""
        if not self._failing or self._now() >= self._try_at:
            self._guarded(self._write_queue)

    def _now(self) -> float:
        """Seconds that retries are counted in: of the run in lock-step, so that nothing depends on a clock."""
        return self._run_s if self._synchronous else time.monotonic()

    def _write_queue(self) -> None:
        idle = not self._queue
        while self._queue:
            number, row = self._queue.popleft()
            self._count(number)
            self._tell_deleted(self._sink.add(row))
            if not self._synchronous:
                time.sleep(0)  # lets a waiting tick in: no batch of rows may hold the interpreter
        if idle and not self._synchronous:
            self._sink.flush()  # the loop stands still: nothing else would close this chunk
        self._recovered()

    def _count(self, number: int) -> None:
        """Numbers run on, so what is missing between those taken was pushed out of the queue."""
        self._taken += 1
        self._next = max(self._next, number + 1)
        gone, self._gone = self._gone, self._next - self._taken
        if self._gone > gone and not self._dropping:
            self._tell("recorder_dropped", "warning", rows=self._gone - gone)
        self._dropping = self._gone > gone or (self._dropping and len(self._queue) > 0)

    def _pushed_out(self) -> int:
        with contextlib.suppress(IndexError):  # emptied between the look and the grasp
            return max(self._gone, self._queue[0][0] - self._taken)
        return self._gone

    def _guarded(self, action: Callable[[], object]) -> bool:
        try:
            action()
        except OSError as error:
            self._disk_failed(error)
        except Exception as error:  # a row that cannot be written as text must not end the thread
            self._lost += len(self._sink.unsafe[-1:])
            del self._sink.unsafe[-1:]
            self._tell("recorder_row_unusable", "error", reason=f"{type(error).__name__}: {error}")
        else:
            return True
        return False

    def _disk_failed(self, error: OSError) -> None:
        file = self._sink.path.name if self._sink.path else ""
        self._lost += self._sink.abandon()
        self._try_at = self._now() + self._retry_s[min(self._in_row, len(self._retry_s) - 1)]
        self._failures, self._in_row = self._failures + 1, self._in_row + 1
        if not self._failing:
            self._failing = True
            reason = (error.strerror or type(error).__name__).lower()
            self._tell("recorder_trouble", "error", reason=reason, errno=error.errno, file=file)

    def _recovered(self) -> None:
        """A header fits where rows do not: only rows on the disk prove it."""
        if self._failing and self._sink.proven and self._sink.path is not None:
            self._failing, self._in_row = False, 0
            self._tell("recorder_recovered", "info", file=self._sink.path.name, dropped=self._gone + self._lost)

    def _tell_deleted(self, names: list[str]) -> None:
        if names:
            self._tell("recordings_deleted", "info", files=names)

    def _tell(self, event: str, level: str, **fields: Any) -> None:
        if self._on_event is not None:
            with contextlib.suppress(Exception):  # a failing log must not end the recording
                self._on_event(event, level, fields)
