"""What a device told in the last minutes: one ring of numbers for each channel, of bounded memory.

Rules of this file: no clock and no network; a missing number is NaN; rows are counted from the first one ever, so that
a reader who was away knows what it has missed.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

ROWS = 30_000  # ten minutes of a loop of 50 Hz
CHANNELS = 48  # a tick has some twenty: what is beyond comes from a stranger
WORDS = 32  # that one channel may have, such as the names of modes
PARTS = 8  # of a list: a state
WORD_CHARACTERS = 64
WALL = "wall"  # s since 1970, of this machine: the only time that a daemon's restart does not set back
_NAME = re.compile(r"[A-Za-z_]\w{0,31}")

Numbers = NDArray[np.float64]


class History:
    """The newest rows of one device."""

    def __init__(self, rows: int = ROWS) -> None:
        self.count = 0  # rows ever
        self.words: dict[str, list[str]] = {}  # channel -> texts, in the order of their numbers
        self._rows = rows
        self._columns: dict[str, Numbers] = {WALL: np.full(rows, np.nan)}

    @property
    def names(self) -> list[str]:
        """Channels in the order in which they came, the wall clock first."""
        return list(self._columns)

    @property
    def first(self) -> int:
        """Number of the oldest row that is kept."""
        return max(0, self.count - self._rows)

    def append(self, wall_s: float, message: Mapping[str, Any]) -> None:
        """Keep the numbers of one message; what is no number, text or list of numbers is left out."""
        place = self.count % self._rows
        for column in self._columns.values():
            column[place] = np.nan
        self._columns[WALL][place] = wall_s
        for name, value in self._numbers(message):
            target = self._column(name)
            if target is not None:
                target[place] = value
        self.count += 1

    def word(self, name: str) -> str:
        """The newest row's text of a channel; empty when it has none."""
        known, column = self.words.get(name, []), self._columns.get(name)
        number = column[(self.count - 1) % self._rows] if column is not None and self.count else np.nan
        return known[int(number)] if number < len(known) else ""

    def since(self, row: int, at_most: int) -> tuple[int, list[list[float]]]:
        """Rows from a number on, the newest ones when there are more; with the number of the first."""
        first = max(row, self.first, self.count - at_most)
        places = np.arange(first, self.count) % self._rows
        table = np.column_stack([column[places] for column in self._columns.values()])
        return first, table.tolist()

    def columns(self, names: Sequence[str]) -> dict[str, Numbers]:
        """All that is kept of these channels; NaN where one was never told."""
        places, missing = np.arange(self.first, self.count) % self._rows, np.full(self._rows, np.nan)
        return {name: self._columns.get(name, missing)[places] for name in names}

    def packed(self) -> bytes:
        """All that is kept, for a browser: length and text of a JSON header, then columns of float64.

        The header is padded so that the columns begin at a multiple of eight.
        """
        places = np.arange(self.first, self.count) % self._rows
        told = {"names": self.names, "words": self.words, "first": self.first, "rows": len(places)}
        header = msgspec.json.encode(told)
        header += b" " * (-(len(header) + 4) % 8)
        columns = (column[places].astype("<f8").tobytes() for column in self._columns.values())
        return struct.pack("<I", len(header)) + header + b"".join(columns)

    def _column(self, name: str) -> Numbers | None:
        column = self._columns.get(name)
        if column is None and len(self._columns) < CHANNELS:
            column = self._columns[name] = np.full(self._rows, np.nan)
        return column

    def _numbers(self, message: Mapping[str, Any]) -> Iterator[tuple[str, float]]:
        for name, value in message.items():
            if not isinstance(name, str) or not _NAME.fullmatch(name) or name == WALL:
                continue
            if isinstance(value, list):
                parts = ((f"{name}_{place}", part) for place, part in enumerate(value[:PARTS]))
                yield from ((part, float(number)) for part, number in parts if isinstance(number, int | float))
            elif isinstance(value, int | float):
                yield name, float(value)
            elif isinstance(value, str):
                yield name, self._word(name, value[:WORD_CHARACTERS])

    def _word(self, name: str, text: str) -> float:
        """The number that stands for a text."""
        known = self.words.setdefault(name, []) if len(self.words) < CHANNELS else self.words.get(name, [])
        if text not in known:
            if len(known) >= WORDS:
                return float("nan")
            known.append(text)
        return float(known.index(text))
