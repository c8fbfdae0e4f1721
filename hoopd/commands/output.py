"""How a command's result leaves the program: a table for a person, JSON for a program.

Rules of this file: nothing is computed here; a file that cannot be written is one InputError. The table has the keys
of the JSON, so that what is read in one is found in the other; `notes` follow it as sentences.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hoopd.files.reading import InputError

# What a person compares; the JSON has every digit. A matrix of six columns fits a terminal of 80 with four.
DIGITS = 7
MATRIX_DIGITS = 4
LARGEST_MATRIX = 6


def print_result(result: dict[str, Any]) -> None:
    """A table of keys and values on standard output, one section to each nested record, then the notes."""
    from rich.console import Console
    from rich.text import Text

    console, table = Console(), _two_columns()
    for key, value in result.items():
        if key == "notes":
            continue
        if lines := table_rows(value):
            if table.row_count:
                console.print(table)
            console.print(_columns(key, lines))
            table = _two_columns()
            continue
        if _is_record(value):
            table.add_section()
        for name, text in rows(key, value):
            table.add_row(Text(name, style="" if text else "bold"), Text(text))
        if _is_record(value):
            table.add_section()
    if table.row_count:
        console.print(table)
    for note in result.get("notes", []):
        console.print(Text(f"- {note}"))


def _two_columns() -> Any:
    """Keys and values; a name that is too long goes on in the next line, whole."""
    from rich.table import Column, Table

    return Table(Column(overflow="fold"), Column(overflow="fold"), show_header=False)


def table_rows(value: Any, label: str = "") -> list[tuple[str, dict[str, Any]]]:
    """Records that have the same keys, with their names joined; empty when the value is no such thing."""
    if not _is_record(value) or not all(_is_record(one) for one in value.values()):
        return []
    if all(not _is_record(item) for one in value.values() for item in one.values()):
        return [(f"{label}{name}", one) for name, one in value.items()] if _alike(list(value.values())) else []
    lines = [line for name, one in value.items() for line in table_rows(one, f"{label}{name} ") or [("", {})]]
    return lines if _alike([one for _, one in lines]) else []


def _alike(records: list[dict[str, Any]]) -> bool:
    return len({tuple(one) for one in records}) == 1 and len(records[0]) > 1


def _columns(title: str, lines: list[tuple[str, dict[str, Any]]]) -> Any:
    """One row a record, one column a key."""
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title, title_justify="left")
    table.add_column("", no_wrap=True)
    for key in lines[0][1]:
        table.add_column(key.replace("_", " "))
    for name, one in lines:
        table.add_row(Text(name), *(Text(shown(item, MATRIX_DIGITS + 1)) for item in one.values()))
    return table


def rows(key: str, value: Any, depth: int = 0) -> list[tuple[str, str]]:
    """Lines of a table for a value: a record becomes its name and its entries, indented."""
    name = "  " * depth + str(key)
    if not _is_record(value):
        return [(name, shown(value))]
    return [(name, ""), *(row for inner, item in value.items() for row in rows(inner, item, depth + 1))]


def _is_record(value: Any) -> bool:
    return isinstance(value, dict) and bool(value) and value.keys() != {"re", "im"}


def shown(value: Any, digits: int = DIGITS) -> str:
    """A value as a person reads it: few digits, a complex number as one, a matrix in columns."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{digits}g}"
    if isinstance(value, dict):
        return _complex(value) if value.keys() == {"re", "im"} else _nested(value)
    if isinstance(value, list | tuple):
        return _listed(list(value), digits)
    return str(value)


def _complex(value: dict[str, float]) -> str:
    if value["im"] == 0.0:
        return shown(value["re"])
    return f"{shown(value['re'])} {'+' if value['im'] > 0 else '-'} {shown(abs(value['im']))}j"


def _nested(value: dict[str, Any]) -> str:
    return "\n".join(f"{key}: {shown(item)}" for key, item in value.items()) or "-"


def _listed(values: list[Any], digits: int) -> str:
    if values and all(isinstance(row, list) for row in values):
        if max(len(values), len(values[0])) > LARGEST_MATRIX:
            return f"{len(values)} x {len(values[0])} matrix (--json has it)"
        return _matrix([[shown(item, MATRIX_DIGITS) for item in row] for row in values])
    separator = "\n" if any(isinstance(item, dict) for item in values) else ", "
    return separator.join(shown(item, digits) for item in values) or "-"


def _matrix(cells: list[list[str]]) -> str:
    """Rows under one another, columns to the right, each as wide as it needs."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=False)]
    return "\n".join(" ".join(f"{cell:>{w}}" for cell, w in zip(row, widths, strict=False)) for row in cells)


def write_json(path: Path | None, result: dict[str, Any]) -> None:
    """The result as JSON, when a path is given: the whole file or none."""
    if path is None:
        return
    from hoopd.files import json_files

    json_files.write_json(path, result)


def check_json(path: Path | None) -> None:
    """InputError where the result could not be written: said before a run, not after it."""
    if path is not None and not path.parent.is_dir():
        raise InputError(path, "--json", "no such folder")
