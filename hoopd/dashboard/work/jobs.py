"""The bench's commands as jobs: one at a time, in a queue that a restart does not lose.

Rules of this file: a job is a folder (its order, its state, its output, what it wrote); it runs as another process, in
time that nobody else wants; only a process that was started here is ended here. What a restart interrupted begins
again, once.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import msgspec

from hoopd.dashboard.work.background import background
from hoopd.dashboard.work.forms import CONTROLLER, FIGURE, MODEL, REPORT, RESULT, JobOrder
from hoopd.files.reading import InputError, read_bytes
from hoopd.files.whole_files import replace_file
from hoopd.shell.child import end

STATE, OUTPUT, PROGRESS = "job.json", "output.txt", "progress.json"
FILES = {
    REPORT: "text/html", FIGURE: "image/svg+xml", RESULT: "application/json", MODEL: "application/yaml",
    CONTROLLER: "application/yaml", OUTPUT: "text/plain",
}  # fmt: skip
WAITING_AT_MOST = 20
KEPT = 200  # jobs that are over
LONGEST_S = 4 * 3600.0
LOOK_S = 0.2
TAIL_BYTES = 4096
OUTPUT_BYTES = 2**20
RESULT_BYTES = 2**24  # of a diagnosis of many recordings some megabytes
SUMMARY_CHARACTERS = 2000
STARTS = 2  # of one job: what ends the page's server itself must not do so for ever
State = Literal["waiting", "running", "done", "failed", "cancelled"]
OVER: tuple[State, ...] = ("done", "failed", "cancelled")


class ResultSummary(msgspec.Struct):
    """Of a job's result what a person reads first."""

    summary: str = ""


class Job(msgspec.Struct):
    """One command that somebody asked for."""

    number: int
    order: JobOrder
    words: list[str]
    who: str
    asked: float  # s since 1970
    state: State = "waiting"
    starts: int = 0
    begun: float | None = None
    ended: float | None = None
    line: str = ""  # why it failed


class Jobs:
    """The queue and what is over."""

    def __init__(self, folder: Path, starting: Callable[[], Sequence[str]] = background) -> None:
        """`folder` exists; `starting`: what stands before every command."""
        self.folder, self._starting = folder, starting
        self._lock = threading.Condition()
        self._jobs: dict[int, Job] = {}
        self._next = 1
        self._ending: set[int] = set()
        self._summaries: dict[int, str] = {}
        self._closed = False
        self._worker: threading.Thread | None = None
        for path in sorted(folder.glob(f"*/{STATE}")):
            self._take_up(path)

    def start(self) -> None:
        """Work from now on."""
        self._worker = threading.Thread(target=self._work, name="jobs")
        self._worker.start()

    def close(self) -> None:
        """End what runs; it begins again with the next start."""
        with self._lock:
            self._closed = True
            self._lock.notify_all()
        if self._worker is not None:
            self._worker.join()

    def add(self, order: JobOrder, words: list[str], who: str) -> Job:
        """Put a command in the queue; InputError when that is full, or the disk."""
        with self._lock:
            if sum(one.state == "waiting" for one in self._jobs.values()) >= WAITING_AT_MOST:
                raise InputError("jobs", "", f"{WAITING_AT_MOST} wait already")
            job = Job(self._next, order, words, who, time.time())
            self._make(job)
            self._next += 1
            self._jobs[job.number] = job
            self._tidy()
            self._lock.notify_all()
            return job

    def cancel(self, number: int) -> None:
        """End one that waits or runs; InputError for any other."""
        with self._lock:
            job = self._job(number)
            if job.state == "waiting":
                job.state, job.ended = "cancelled", time.time()
                self._keep(job)
            elif job.state == "running":
                self._ending.add(number)
            else:
                raise InputError("job", str(number), "is over")

    def remove(self, number: int) -> None:
        """Throw one that is over away, with its results."""
        with self._lock:
            job = self._job(number)
            if job.state not in OVER:
                raise InputError("job", str(number), "is not over")
            self._drop(job)

    def file(self, number: int, name: str) -> Path:
        """One of a job's files; InputError when there is none."""
        with self._lock:
            self._job(number)
        path = self.of(number) / name
        if name not in FILES or path.is_symlink() or not path.is_file():
            raise InputError(f"job {number}", name[:40], "no such file")
        return path

    def of(self, number: int) -> Path:
        """A job's folder."""
        return self.folder / f"{number:05}"

    def told(self) -> list[dict[str, Any]]:
        """All of them, the newest first, with progress and with the files that are there."""
        with self._lock:
            jobs = [msgspec.structs.replace(one) for one in self._jobs.values()]
        return [self._told(one) for one in sorted(jobs, key=lambda one: -one.number)]

    def _told(self, job: Job) -> dict[str, Any]:
        folder = self.of(job.number)
        told: dict[str, Any] = msgspec.to_builtins(job)
        told["files"] = [name for name in FILES if (folder / name).is_file()] if job.state in OVER else []
        told["progress"] = _progress(folder / PROGRESS) if job.state == "running" else None
        told["summary"] = self._summary(job.number) if RESULT in told["files"] else ""
        del told["words"]
        return told

    def _summary(self, number: int) -> str:
        """What the result of a job that is over says in plain words; looked up once."""
        if number not in self._summaries:
            self._summaries[number] = _summary(self.of(number) / RESULT)
        return self._summaries[number]

    # ---- the folder

    def _take_up(self, path: Path) -> None:
        """What an earlier process left."""
        try:
            job = msgspec.json.decode(path.read_bytes(), type=Job)
        except (OSError, msgspec.MsgspecError, UnicodeDecodeError) as error:
            raise InputError(path, "", str(error)) from None
        if path.parent != self.of(job.number):
            raise InputError(path, "number", f"{job.number} is not the folder's")
        if job.state == "running":
            again = job.starts < STARTS
            job.state, job.line = ("waiting", "") if again else ("failed", "ended with the page's server, twice")
            job.ended = None if again else time.time()
        self._jobs[job.number] = job
        self._next = max(self._next, job.number + 1)

    def _make(self, job: Job) -> None:
        try:
            self.of(job.number).mkdir()
        except OSError as error:
            raise InputError(self.of(job.number), "", (error.strerror or str(error)).lower()) from None
        try:
            self._write(job)
        except InputError:
            shutil.rmtree(self.of(job.number), ignore_errors=True)
            raise

    def _write(self, job: Job) -> None:
        replace_file(self.of(job.number) / STATE, msgspec.json.encode(job))

    def _keep(self, job: Job) -> None:
        """A disk that is full loses the state and not the queue."""
        with contextlib.suppress(InputError):
            self._write(job)

    def _job(self, number: int) -> Job:
        if number not in self._jobs:
            raise InputError("job", str(number), "no such job")
        return self._jobs[number]

    def _drop(self, job: Job) -> None:
        del self._jobs[job.number]
        self._summaries.pop(job.number, None)
        shutil.rmtree(self.of(job.number), ignore_errors=True)

    def _tidy(self) -> None:
        over = sorted((one for one in self._jobs.values() if one.state in OVER), key=lambda one: one.number)
        for job in over[: max(0, len(over) - KEPT)]:
            self._drop(job)

    # ---- the worker

    def _work(self) -> None:
        while (job := self._await_one()) is not None:
            try:
                state, line = self._run(job)
            except OSError as error:
                state, line = "failed", (error.strerror or str(error)).lower()
            with self._lock:
                self._ending.discard(job.number)
                job.state, job.line, job.ended = state, line, time.time()
                if state == "waiting":  # ended in order, with the server: it was not at fault
                    job.starts, job.begun, job.ended = job.starts - 1, None, None
                self._keep(job)

    def _await_one(self) -> Job | None:
        with self._lock:
            while not self._closed:
                waiting = [one for one in self._jobs.values() if one.state == "waiting"]
                if waiting:
                    job = min(waiting, key=lambda one: one.number)
                    job.state, job.begun, job.starts = "running", time.time(), job.starts + 1
                    self._keep(job)
                    return job
                self._lock.wait()
            return None

    def _run(self, job: Job) -> tuple[State, str]:
        """Run the command in the job's folder; how it ended and why."""
        folder = self.of(job.number)
        command = [*self._starting(), sys.executable, "-m", "hoopd", *job.words]
        environment = {**os.environ, "HOOPD_PROGRESS": str(folder / PROGRESS), "COLUMNS": "100"}
        limit = time.monotonic() + LONGEST_S
        with (folder / OUTPUT).open("wb") as output:
            child = subprocess.Popen(
                command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                start_new_session=True,
            )  # fmt: skip
            try:
                while child.poll() is None:
                    with self._lock:
                        cancelled, closed = job.number in self._ending, self._closed
                    if closed:
                        return "waiting", ""
                    if cancelled:
                        return "cancelled", ""
                    if time.monotonic() > limit or (folder / OUTPUT).stat().st_size > OUTPUT_BYTES:
                        return "failed", f"took more than {LONGEST_S / 3600:g} h, or {OUTPUT_BYTES} bytes of output"
                    time.sleep(LOOK_S)
            finally:
                end(child)
        if child.returncode == 0:
            return "done", ""
        return "failed", _last_line(folder / OUTPUT) or f"ended with {child.returncode}"


def _last_line(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - TAIL_BYTES))
        lines = [line for line in file.read().decode("utf-8", "replace").splitlines() if line.strip()]
    said = [line for line in lines if line.startswith("hoopd: ")]
    return (said or lines or [""])[-1].removeprefix("hoopd: ")[:300]


def _summary(path: Path) -> str:
    """Empty where the result has none, or is none."""
    try:
        return msgspec.json.decode(read_bytes(path, RESULT_BYTES), type=ResultSummary).summary[:SUMMARY_CHARACTERS]
    except (InputError, msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return ""


def _progress(path: Path) -> dict[str, Any] | None:
    with contextlib.suppress(OSError, msgspec.MsgspecError, UnicodeDecodeError):
        told: dict[str, Any] = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
        return {"share": told.get("share"), "step": str(told.get("step", ""))[:200]}
    return None
