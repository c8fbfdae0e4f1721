"""What in a recording of any plant is worth a doubt, in plain words: printed as warnings, never acted upon.

Rules of this file: nothing is changed and nothing refused; what follows from a device stands with its plant.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.recording.recording import MISSED_STEPS, Column, Recording
from hoopd.recording.timeline import usual_steps
from hoopd.recording.unwrap import jumps


def doubts(recording: Recording) -> list[str]:
    """One sentence for each thing that is worth a doubt; empty when there is none."""
    checks = (wrapped, damaged, gaps, _silent)
    return [sentence for check in checks for sentence in check(recording)]


def wrapped(recording: Recording) -> Iterator[str]:
    """Angles that come round."""
    for name, count in jumps(recording).items():
        yield f"{name} is wrapped (at {count} place{'s' if count > 1 else ''}): fits and simulations unwrap it"


def damaged(recording: Recording) -> Iterator[str]:
    """What the file lost."""
    if recording.lost:
        yield f"the file was damaged: {recording.lost}"


def gaps(recording: Recording) -> Iterator[str]:
    """Missing rows."""
    steps = np.diff(recording.t)
    long = steps[steps > MISSED_STEPS * usual_steps(recording.t)]
    if len(long):
        yield f"rows are missing at {len(long)} place{plural(long)}, the longest step is {long.max():.3g} s"


def _silent(recording: Recording) -> Iterator[str]:
    """Signals that say nothing."""
    for name, signal in recording.signals.items():
        there = finite(signal.values)
        if not len(there):
            yield f"{name} is missing in every row"
        elif name in recording.channels and constant(there):
            yield f"{name} never changes ({there[0]:.4g}{signal.unit and ' ' + signal.unit})"


def finite(column: Column) -> Column:
    """The values that are there."""
    return column[np.isfinite(column)]


def constant(column: Column) -> bool:
    """Whether more than one value is there, and all are the same."""
    return len(column) > 1 and bool(np.ptp(column) == 0)


def plural(items: NDArray[Any]) -> str:
    """The s of a word for these."""
    return "s" if len(items) != 1 else ""
