"""What a command of the bench is given as text: recordings with a slice, starting states.

Rules of this file: from text to checked objects; everything unusable is one `InputError`; no mathematics.
"""

from __future__ import annotations

import numpy as np

from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.layout import layout_of
from hoopd.recording.edit import aged
from hoopd.recording.recording import Recording
from hoopd.recording.slices import finite, read_recording as read_slice
from hoopd.recording.tables import MAX_ROWS

HOOP_TICK_S = 0.02
AGES = ("psi", "y")  # of the ball's angle, of the board's readings


def read_recording(
    text: str, columns: str | None = None, age: str = "", *, plant: Plant | None = None, hold: str = "zero"
) -> Recording:
    """Recording of "FILE[:EXPERIMENT][@START:END]", of a plant, the hoop without one.

    columns: "CHANNEL=COLUMN[:UNIT],..." or names in the file's order. age: how much older samples are than their row
    (`read_ages`). hold: how inputs go on between rows, one of `HOLDS`.
    """
    layout = None if plant is None else layout_of(plant)
    ages = read_ages(age, AGES if layout is None or layout.is_tick else tuple(layout.channels))
    recording = read_slice(text, columns, layout=layout, hold=hold)
    _check_rows(text, recording, HOOP_TICK_S if plant is None else plant.time_scale_s)
    try:
        return aged(recording, **{f"{name}_s": age for name, age in ages.items()}) if ages else recording
    except ValueError as error:
        raise InputError("--age", "", str(error)) from None


def _check_rows(name: str, recording: Recording, sample_time_s: float) -> None:
    """InputError for rows so rare that a plant as fast as this one takes more steps than any recording has rows."""
    apart = np.diff(recording.t)
    if not len(apart):
        return
    usual_s = float(np.median(apart))
    if len(apart) * usual_s > MAX_ROWS * sample_time_s:
        reason = f"{len(apart) + 1} rows {usual_s:g} s apart of a plant that is sampled every {sample_time_s:g} s"
        raise InputError(name, "t", f"{reason}: are they in seconds? Is the plant's sample_time_s right?")


def read_ages(text: str, names: tuple[str, ...] = AGES) -> dict[str, float]:
    """Seconds by name of "psi=0.03,y=0.02"; InputError for an unknown name or what is no number."""
    return read_values("--age", text, names) if text else {}


def read_values(option: str, text: str, names: tuple[str, ...]) -> dict[str, float]:
    """Numbers by name of "psi=0.4,dtheta=0"; InputError on an unknown or repeated name or what is no number."""
    values: dict[str, float] = {}
    for part in text.split(","):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals:
            raise InputError(option, part.strip(), f"expected NAME=VALUE with {', '.join(names)}")
        if name not in names:
            raise InputError(option, name, f"unknown; known: {', '.join(names)}")
        if name in values:
            raise InputError(option, name, "stands twice")
        values[name] = finite(option, name, value)
    return values
