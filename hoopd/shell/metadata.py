"""Metadata of rpicam-vid, as it comes through its FIFO.

Rules of this file: text in, stamps out; no file and no clock. Records are matched by their values, not parsed as JSON:
the program quotes its values by guess and ends a record only with the next one.
"""

from __future__ import annotations

import re
from math import isfinite
from typing import NamedTuple

# Stamps of pictures that nobody asked for: more is a program that counts otherwise.
METADATA_KEPT = 64


class Stamp(NamedTuple):
    """What is used of one picture's metadata."""

    t: float | None  # s, clock of the camera stack
    exposure_s: float | None


class MetadataStream:
    """Stamps of the n-th picture from a stream of metadata, in JSON or in key=value text.

    The program writes the closing brace of a JSON record only together with the next record, so a record counts as
    soon as both of its values are there, not when the brace is.
    """

    # A number is whole only when something follows it.
    _VALUE = re.compile(r'"?(SensorTimestamp|ExposureTime)"?\s*[:=]\s*([0-9.eE+]+)(?=[^0-9.eE+])|([}])|(\n\s*\n)')
    _TAIL_CHARS = 64

    def __init__(self) -> None:
        self._text = ""
        self._values: dict[str, float | None] = {}
        self._handed = False
        self._count = 0
        self._stamps: dict[int, Stamp] = {}

    def feed(self, text: str) -> None:
        """Take in the next part of the stream, cut anywhere."""
        self._text += text
        end = 0
        for match in self._VALUE.finditer(self._text):
            end = match.end()
            if match[1] is None:
                self._finish()
            else:
                self._add(match[1], _number(match[2]))
        self._text = self._text[max(end, len(self._text) - self._TAIL_CHARS) :]

    def has(self, number: int) -> bool:
        """The stamp of that picture is here."""
        return number in self._stamps

    def take(self, number: int) -> Stamp | None:
        """The stamp of that picture, once; None when it is not here (yet)."""
        found = self._stamps.pop(number, None)
        if found is not None:
            for old in [key for key in self._stamps if key < number]:
                del self._stamps[old]
        return found

    def _add(self, key: str, value: float | None) -> None:
        if key in self._values:
            self._finish()
        self._values[key] = value
        if len(self._values) == 2:
            self._hand()

    def _hand(self) -> None:
        stamp_ns, exposure_us = self._values.get("SensorTimestamp"), self._values.get("ExposureTime")
        self._stamps[self._count] = Stamp(
            stamp_ns * 1e-9 if stamp_ns is not None else None,
            exposure_us * 1e-6 if exposure_us is not None else None,
        )
        self._stamps.pop(self._count - METADATA_KEPT, None)
        self._count += 1
        self._handed = True

    def _finish(self) -> None:
        """The record has ended; hand it over unless its values were complete before."""
        if self._values and not self._handed:
            self._hand()
        self._values = {}
        self._handed = False


def _number(text: str) -> float | None:
    """The finite number, or None for what only looks like one (1.2.3, 1e999)."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if isfinite(value) else None
