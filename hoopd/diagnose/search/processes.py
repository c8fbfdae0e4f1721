"""Independent parts of a diagnosis, side by side in processes.

A process is forked for each job beyond the first. It knows all that is there, takes the next task when its last one is
done, and sends what came out through a pipe. Which tasks there are never depends on how many processes share them, and
results stand in the tasks' order: the numbers are the same bit for bit with any number of jobs.

Rules of this file: no mathematics; what a task returns can be pickled, and it changes nothing that others read.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")

_jobs: ContextVar[int] = ContextVar("jobs", default=1)
# A task's number in the queue; a pipe holds 32,768 of them.
NUMBER_BYTES = 2


class _Helper(NamedTuple):
    """A forked process, and where its results come from."""

    process: Any
    results: Connection


@contextmanager
def side_by_side(jobs: int) -> Iterator[None]:
    """So many processes for whatever is `computed` within."""
    token = _jobs.set(jobs)
    try:
        yield
    finally:
        _jobs.reset(token)


def computed(tasks: Sequence[Callable[[], T]]) -> list[T]:
    """What the tasks return, in their order; what one of them raises, raised here."""
    jobs = min(_jobs.get(), len(tasks))
    with side_by_side(1):  # a task that has tasks of its own does them itself
        if jobs < 2:
            return [task() for task in tasks]
        return _shared(tasks, jobs)


def _shared(tasks: Sequence[Callable[[], T]], jobs: int) -> list[T]:
    queue, end = os.pipe()
    os.write(end, b"".join(i.to_bytes(NUMBER_BYTES, "little") for i in range(len(tasks))))
    os.close(end)
    helpers = [_started(tasks, queue) for _ in range(jobs - 1)]
    try:
        found = _taken(tasks, queue)
        for helper in helpers:
            found |= _received(helper)
    finally:
        os.close(queue)
        for helper in helpers:
            helper.process.terminate()
            helper.process.join()
            helper.results.close()
    return [found[i] for i in range(len(tasks))]


def _taken(tasks: Sequence[Callable[[], T]], queue: int) -> dict[int, T]:
    """Results of the tasks that this process took from the queue, until none is left."""
    found = {}
    while number := os.read(queue, NUMBER_BYTES):
        i = int.from_bytes(number, "little")
        found[i] = tasks[i]()
    return found


def _started(tasks: Sequence[Callable[[], T]], queue: int) -> _Helper:
    context = multiprocessing.get_context("fork")
    results, own = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(tasks, queue, own), daemon=True)
    process.start()
    own.close()
    return _Helper(process, results)


def _work(tasks: Sequence[Callable[[], Any]], queue: int, results: Connection) -> None:
    """Of a helper: who waits for it ends it, whatever the keyboard says."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        results.send(_taken(tasks, queue))
    except Exception as error:
        results.send(error)


def _received(helper: _Helper) -> dict[int, Any]:
    try:
        found = helper.results.recv()
    except EOFError:
        raise RuntimeError("a process of the diagnosis ended before it was done") from None
    if isinstance(found, Exception):
        raise found
    assert isinstance(found, dict)
    return found
