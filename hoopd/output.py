"""How a command's result leaves the program: a table for a person, JSON for a program.

Rules of this file: nothing is computed here; a file that cannot be written is one InputError.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hoopd.files import InputError


def print_result(result: dict[str, Any]) -> None:
    """A table of keys and values on standard output."""
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False)
    for key, value in result.items():
        table.add_row(key, "\n".join(map(str, value)) if isinstance(value, list) and key == "notes" else str(value))
    Console().print(table)


def write_json(path: Path | None, result: dict[str, Any]) -> None:
    """The result as JSON, when a path is given."""
    if path is None:
        return
    import msgspec

    try:
        path.write_bytes(msgspec.json.format(msgspec.json.encode(result), indent=2) + b"\n")
    except OSError as error:
        raise InputError(path, "", (error.strerror or "cannot be written").lower()) from None
