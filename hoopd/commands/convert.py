"""`hoopd convert`: a recording from one format to another, cut and resampled on the way.

Rules of this file: from file to file; no mathematics. The source is never written; the target is whole or untouched.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.commands.options.convert import ConvertOptions
from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.hoop.recordings.suspicions import suspicions
from hoopd.plants.layout import layout_of
from hoopd.plants.recording_doubts import plant_doubts
from hoopd.plants.registry import resolve_plant
from hoopd.recording import Recording, load, save
from hoopd.recording.doubts import doubts
from hoopd.recording.edit import between, resampled
from hoopd.recording.formats import extension_of, split_path
from hoopd.recording.recording import rounded_step_s
from hoopd.recording.tick_columns import FILE_ORDER

# Formats of columns alone.
NO_HOLD = (".csv", ".mat")


def run(options: ConvertOptions) -> dict[str, Any]:
    """Write the recording of `source` to `target`; what was written, and what in it is worth a doubt."""
    source, target = options.source, options.target
    extension = extension_of(target)  # before the source is read
    _refuse_same(source, target)
    plant = None if options.plant is None else resolve_plant(options.plant)
    layout = None if plant is None else layout_of(plant)
    recording = load(source, options.columns, options.experiment, layout=layout, hold=options.hold)
    recording = edited(recording, source, options.start, options.end, options.step)
    save(recording, target)
    told = summary(recording, plant)
    told["notes"] = [*told["notes"], *_untold_hold(recording, extension)]
    return {"source": str(source), "target": str(target), **told}


def _untold_hold(recording: Recording, extension: str) -> list[str]:
    """What a file's format cannot say of how inputs go on between their rows."""
    holds = sorted({signal.hold for signal in recording.inputs.values()} - {"zero"})
    if extension not in NO_HOLD or not holds:
        return []
    return [f"a {extension} file does not say how inputs go on between rows: read it with --hold {holds[0]}"]


def edited(
    recording: Recording, source: Path, start: float | None = None, end: float | None = None, step: float | None = None
) -> Recording:
    """The recording cut to its wanted seconds and resampled; InputError when that leaves nothing."""
    try:
        cut = recording if start is None and end is None else between(recording, start, end)
        return cut if step is None else resampled(cut, step)
    except ValueError as error:
        raise InputError(source, "", str(error)) from None


def summary(recording: Recording, plant: Plant | None = None) -> dict[str, Any]:
    """Rows, span, signals and doubts of a recording."""
    names = (*FILE_ORDER, "current") if recording.is_tick else tuple(recording.signals)
    missing = {name: int(np.isnan(recording.column(name)).sum()) for name in names}
    present = [name for name in names if missing[name] < len(recording)]
    return {
        "rows": len(recording),
        "seconds": float(recording.t[-1] - recording.t[0]),
        "step_s": None if len(recording) < 2 else rounded_step_s(recording),
        "signals": present,
        "missing": {name: missing[name] for name in present},
        "notes": _doubts(recording, plant),
    }


def _doubts(recording: Recording, plant: Plant | None) -> list[str]:
    if recording.is_tick:
        return suspicions(recording)
    return doubts(recording) if plant is None else plant_doubts(recording, plant)


def _refuse_same(source: Path, target: Path) -> None:
    file, _ = split_path(source)
    with contextlib.suppress(OSError):  # one of them is not there: they are not the same
        if file.samefile(target):
            raise InputError(target, "", "is the source itself: a recording is never overwritten by its own copy")
