"""What a command of the bench is given as text: recordings with a slice, models, starting states.

Rules of this file: from text to checked objects; everything unusable is one `InputError`; no mathematics.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

from hoopd.files import InputError
from hoopd.modelfiles import ModelFile, load_model
from hoopd.recording import Recording, load
from hoopd.recording.edit import between
from hoopd.recording.formats import split_path

_SLICE = re.compile(r"(?s)(.+)@([^@/]*)")
_SPAN = re.compile(r"\s*([^:]*?)\s*:\s*([^:]*?)\s*")


class Span(NamedTuple):
    """Seconds on the recording's own clock; None is open."""

    start_s: float | None
    end_s: float | None


def read_recording(text: str, columns: str | None = None) -> Recording:
    """Recording of "FILE", "FILE.h5:EXPERIMENT" and either with "@START:END" in seconds, one of which may be missing.

    A file of that very name goes first. `columns` as in `hoopd.recording.load`. InputError when it cannot be used.
    """
    path, span = split_slice(text)
    recording = load(path, columns)
    if span is None:
        return recording
    try:
        return between(recording, span.start_s, span.end_s)
    except ValueError as error:
        raise InputError(path, f"@{_text(span)}", str(error)) from None


def split_slice(text: str) -> tuple[str, Span | None]:
    """Path (with its experiment) and seconds of a recording's text."""
    match = _SLICE.fullmatch(text)
    if match is None or split_path(text)[0].exists():
        return text, None
    return match.group(1), _span(match.group(1), match.group(2))


def _span(path: str, text: str) -> Span:
    match = _SPAN.fullmatch(text)
    if match is None:
        raise InputError(path, f"@{text}", "a slice is START:END in seconds, e.g. @2:14, @2: or @:14")
    start_s, end_s = (_seconds(path, text, part) for part in match.groups())
    if start_s is not None and end_s is not None and start_s >= end_s:
        raise InputError(path, f"@{text}", "the slice ends before it begins")
    return Span(start_s, end_s)


def _seconds(path: str, text: str, part: str) -> float | None:
    return _finite(path, f"@{text}", part) if part else None


def _text(span: Span) -> str:
    return ":".join("" if value is None else f"{value:g}" for value in span)


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
        values[name] = _finite(option, name, value)
    return values


def _finite(option: str, key: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise InputError(option, key, f"expected a number, got {text!r}") from None
    if not math.isfinite(number):
        raise InputError(option, key, f"must be a finite number, not {text}")
    return number


def read_model(path: Path, *, without_effects: bool = False) -> ModelFile:
    """A model that the plant can play in full: one with effects is refused unless it shall go without them."""
    model = load_model(path)
    if model.effects and not without_effects:
        names = ", ".join(entry.name for entry in model.effects)
        raise InputError(path, "effects", f"the plant does not play {names} yet; --without-effects leaves them out")
    return model
