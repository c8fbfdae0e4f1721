"""Which assertions the clock judges: what is late may be the machine's, what is wrong is ours.

Rules of this file: only times and rates are asserted within `on_the_clock`; torque, modes, counts and messages never.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

NOTE = "judged by the clock"


@contextmanager
def on_the_clock() -> Iterator[None]:
    """Mark an AssertionError that is raised within as one of time."""
    try:
        yield
    except AssertionError as error:
        error.add_note(NOTE)
        raise


def is_late(error: BaseException | None) -> bool:
    """Was it raised within `on_the_clock`?"""
    return NOTE in getattr(error, "__notes__", ())
