"""A glance at one recording: how long it is, what it holds, and a small curve of it; one line of JSON.

Rules of this file: a process of its own (`python -m hoopd.dashboard.work.glance FILE`), so that a file that cannot be
read, or is large, holds up no page; what is wrong with it is its reader's one line.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hoopd.files.reading import InputError
from hoopd.recording.recording import Column, Recording
from hoopd.recording.slices import read_recording

BITS = 120  # a thumbnail's width, px
SHOWN = ("psi", "dtheta")  # of the hoop; of another plant its first two channels


def glance(recording: Recording) -> dict[str, Any]:
    """Rows, seconds, channels, modes in the order of their first row, and extremes of two channels over time."""
    modes = recording.extra.get("mode")
    names = [name for name in SHOWN if name in recording.channels] or [*recording.channels][: len(SHOWN)]
    curves = {name: extremes(recording.channels[name].t, recording.channels[name].values) for name in names}
    return {
        "rows": len(recording),
        "seconds": float(recording.t[-1] - recording.t[0]),
        "channels": [name for name, one in recording.signals.items() if np.isfinite(one.values).any()],
        "modes": [] if modes is None else list(dict.fromkeys(str(mode) for mode in modes)),
        "curves": {name: curve for name, curve in curves.items() if curve},
        "lost": recording.lost,
    }


def extremes(t: Column, values: Column, bits: int = BITS) -> list[list[float] | None]:
    """Smallest and largest value of every bit of time, None where a bit has none; empty without any value."""
    known = np.isfinite(t) & np.isfinite(values)
    t, values = t[known], values[known]
    if not len(t):
        return []
    place = np.clip(((t - t[0]) / max(float(t[-1] - t[0]), 1e-12) * bits).astype(int), 0, bits - 1)
    found: list[list[float] | None] = [None] * bits
    for bit in np.unique(place):
        part = values[place == bit]
        found[bit] = [float(f"{part.min():.4g}"), float(f"{part.max():.4g}")]
    return found


def main(path: str) -> None:
    """Print the line."""
    try:
        told = glance(read_recording(path))
    except InputError as error:
        told = {"wrong": str(error).replace(f"{Path(path).parent}/", "")}
    sys.stdout.buffer.write(msgspec.json.encode(told))


if __name__ == "__main__":
    main(sys.argv[1])
