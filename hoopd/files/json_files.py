"""Records as JSON files that this program keeps for itself: read whole, written whole.

Rules of this file: nothing here knows a particular file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from hoopd.files.reading import InputError
from hoopd.files.whole_files import file_bytes, replace_file


def read_json(path: Path, kind: Any) -> Any:
    """A JSON file that this program wrote; InputError where somebody spoiled it."""
    try:
        return msgspec.json.decode(file_bytes(path), type=kind)
    except msgspec.MsgspecError as error:
        raise InputError(path, "", str(error)) from None


def write_json(path: Path, value: Any) -> None:
    """The whole file or none."""
    replace_file(path, msgspec.json.format(msgspec.json.encode(value), indent=2) + b"\n")
