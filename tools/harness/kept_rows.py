"""Rows of a bench that takes hours, in a file: what was asked for stands in it, and the bench goes on where it ends."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hoopd.files.reading import InputError
from hoopd.files.whole_files import file_bytes, replace_file


class KeptRows:
    """A table that grows; without a file it is in memory alone."""

    def __init__(self, path: Path | None, asked: dict[str, Any]) -> None:
        """`asked`: what every row depends on; InputError for a file whose rows were asked for otherwise."""
        self._path, self._asked = path, asked
        self.rows: list[dict[str, Any]] = []
        if path is None or not path.exists():
            return
        try:
            held = json.loads(file_bytes(path))
            before, self.rows = held["asked"], held["rows"]
        except (ValueError, KeyError, TypeError):
            raise InputError(path, "", "is no file of this bench") from None
        for key, value in asked.items():
            if before.get(key) != value:
                raise InputError(path, key, f"its rows are of {before.get(key)!r}, not {value!r}: another file")

    def add(self, row: dict[str, Any]) -> None:
        """One more; the file has it before the next begins."""
        self.rows.append(row)
        if self._path is not None:
            replace_file(self._path, json.dumps({"asked": self._asked, "rows": self.rows}, indent=1).encode())
