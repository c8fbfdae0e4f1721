"""Recordings by a text of file, experiment and seconds: "FILE", "FILE.h5:EXPERIMENT", either with "@START:END".

Rules of this file: from text to a `Recording`; everything unusable is one `InputError`.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hoopd.files.reading import InputError
from hoopd.recording.column_choice import SignalLayout
from hoopd.recording.edit import between
from hoopd.recording.formats import load, split_path
from hoopd.recording.recording import Recording
from hoopd.recording.tables import Columns

# The hoop turns 50 000 times in an hour. Squares and sums of what is smaller stay finite.
MAX_VALUE = 1e12
_SLICE = re.compile(r"(?s)(.+)@([^@/]*)")
_SPAN = re.compile(r"\s*([^:]*?)\s*:\s*([^:]*?)\s*")


class Span(NamedTuple):
    """Seconds on the recording's own clock; None is open."""

    start_s: float | None
    end_s: float | None


def read_recording(
    text: str, columns: Columns | None = None, *, layout: SignalLayout | None = None, hold: str = "zero"
) -> Recording:
    """Recording of "FILE", "FILE.h5:EXPERIMENT" and either with "@START:END" in seconds, one of which may be missing.

    A file of that very name goes first. `columns`, `layout` and `hold` as in `hoopd.recording.load`. InputError when it
    cannot be used.
    """
    path, span = split_slice(text)
    recording = load(path, columns, layout=layout, hold=hold)
    if span is None:
        return _usable(recording, path)
    try:
        return _usable(between(recording, span.start_s, span.end_s), path)
    except ValueError as error:
        raise InputError(path, f"@{_text(span)}", str(error)) from None


def _usable(recording: Recording, path: str) -> Recording:
    """The recording; InputError for a number that no sensor gives (a file may hold it, no computation bears it)."""
    for name, signal in recording.signals.items():
        column = signal.values
        if (bad := np.abs(column) > MAX_VALUE).any():
            k = int(np.argmax(bad))
            reason = f"is no value of a sensor (above {MAX_VALUE:g}): {column[k]:.6g} at {recording.t[k]:.6g} s"
            raise InputError(path, f"column {name}", reason)
    return recording


def split_slice(text: str) -> tuple[str, Span | None]:
    """Path (with its experiment) and seconds of a recording's text."""
    match = _SLICE.fullmatch(text)
    if match is None or split_path(text)[0].exists():
        return text, None
    return match.group(1), _span(match.group(1), match.group(2))


def file_of(text: str) -> Path:
    """The file of a recording's text, without its experiment and its seconds."""
    return split_path(split_slice(text)[0])[0]


def finite(option: str, key: str, text: str) -> float:
    """The number of a text; InputError when it is none or not finite."""
    try:
        number = float(text)
    except ValueError:
        raise InputError(option, key, f"expected a number, got {text!r}") from None
    if not math.isfinite(number):
        raise InputError(option, key, f"must be a finite number, not {text}")
    return number


def _span(path: str, text: str) -> Span:
    match = _SPAN.fullmatch(text)
    if match is None:
        raise InputError(path, f"@{text}", "a slice is START:END in seconds, e.g. @2:14, @2: or @:14")
    start_s, end_s = (_seconds(path, text, part) for part in match.groups())
    if start_s is not None and end_s is not None and start_s >= end_s:
        raise InputError(path, f"@{text}", "the slice ends before it begins")
    return Span(start_s, end_s)


def _seconds(path: str, text: str, part: str) -> float | None:
    return finite(path, f"@{text}", part) if part else None


def _text(span: Span) -> str:
    return ":".join("" if value is None else f"{value:g}" for value in span)
