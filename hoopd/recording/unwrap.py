"""Angles without the jumps of the sensor that wraps them.

Rules of this file: pure; only an angle that stays within its sensor's range has jumps to take out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from hoopd.recording.recording import Column, Recording
from hoopd.recording.tick_columns import PERIODS_RAD

ANGLE_UNIT, TURN_RAD = "rad", 2 * math.pi


def unwrapped(recording: Recording) -> Recording:
    """Angles without their jumps of a turn (of 1024 turns where the board wraps), through gaps of NaN too.

    Between two samples the shorter way is taken. An angle that leaves its range has been unwrapped and stays as it is.
    """
    changes = {name: _unwrapped(recording.column(name), period) for name, period in _periods(recording).items()}
    return recording.replaced(**changes)


def jumps(recording: Recording) -> dict[str, int]:
    """How often each angle is wrapped; angles without a jump are left out."""
    whole = unwrapped(recording)
    found = {}
    for name, period in _periods(recording).items():
        turned = whole.column(name) - recording.column(name)
        # the unwrapping goes on by whole periods: it changes at a jump and nowhere else
        steps = np.diff(turned[np.isfinite(turned)])
        if count := int((np.abs(steps) > period / 2).sum()):
            found[name] = count
    return found


def _periods(recording: Recording) -> Mapping[str, float]:
    """Channels that come round, and after how much: every other plant's angles after a turn."""
    if recording.is_tick:
        return PERIODS_RAD
    return {name: TURN_RAD for name, signal in recording.channels.items() if signal.unit == ANGLE_UNIT}


def _unwrapped(column: Column, period: float) -> Column:
    there = np.isfinite(column)
    values = column[there]
    if not len(values) or np.abs(values).max() > period / 2 * (1 + 1e-6):
        return column
    result = column.copy()
    result[there] = np.unwrap(values, period=period)
    return result
