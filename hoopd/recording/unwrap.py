"""Angles without the jumps of the sensor that wraps them.

Rules of this file: pure; only an angle that stays within its sensor's range has jumps to take out.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from hoopd.recording.recording import Column, Recording

THETA_TURNS = 1024.0  # the board wraps theta at +-512 turns
PERIODS_RAD = {"theta": THETA_TURNS * 2 * math.pi, "psi": 2 * math.pi}


def unwrapped(recording: Recording) -> Recording:
    """theta without the board's jumps of 1024 turns and psi without its jumps of one turn, through gaps of NaN too.

    Between two samples the shorter way is taken. An angle that leaves its range has been unwrapped and stays as it is.
    """
    changes: dict[str, Any] = {
        name: _unwrapped(getattr(recording, name), period) for name, period in PERIODS_RAD.items()
    }
    return dataclasses.replace(recording, **changes)


def jumps(recording: Recording) -> dict[str, int]:
    """How often each angle is wrapped; angles without a jump are left out."""
    whole = unwrapped(recording)
    found = {}
    for name, period in PERIODS_RAD.items():
        turned = getattr(whole, name) - getattr(recording, name)
        # the unwrapping goes on by whole periods: it changes at a jump and nowhere else
        steps = np.diff(turned[np.isfinite(turned)])
        if count := int((np.abs(steps) > period / 2).sum()):
            found[name] = count
    return found


def _unwrapped(column: Column, period: float) -> Column:
    there = np.isfinite(column)
    values = column[there]
    if not len(values) or np.abs(values).max() > period / 2 * (1 + 1e-6):
        return column
    result = column.copy()
    result[there] = np.unwrap(values, period=period)
    return result
