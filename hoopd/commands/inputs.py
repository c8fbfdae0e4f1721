"""What a command of the bench is given as text: recordings with a slice, starting states.

Rules of this file: from text to checked objects; everything unusable is one `InputError`; no mathematics.
"""

from __future__ import annotations

from hoopd.files.reading import InputError
from hoopd.recording.edit import aged
from hoopd.recording.recording import Recording
from hoopd.recording.slices import finite
from hoopd.recording.slices import read_recording as read_slice

AGES = ("psi", "y")  # of the ball's angle, of the board's readings


def read_recording(text: str, columns: str | None = None, age: str = "") -> Recording:
    """Recording of "FILE[:EXPERIMENT][@START:END]"; age: how much older samples are than their row (`read_ages`)."""
    ages = read_ages(age)
    recording = read_slice(text, columns)
    try:
        return aged(recording, **{f"{name}_s": age for name, age in ages.items()}) if ages else recording
    except ValueError as error:
        raise InputError("--age", "", str(error)) from None


def read_ages(text: str) -> dict[str, float]:
    """Seconds by name of "psi=0.03,y=0.02"; InputError for an unknown name or what is no number."""
    return read_values("--age", text, AGES) if text else {}


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
