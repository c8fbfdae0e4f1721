"""Recordings in CSV: a header line with the names of the signals, a row a sample, an empty cell for a missing number.

Cells stand between commas; where the header has semicolons, tabs or blanks between them, a comma is a decimal one.

Of another plant than the daemon's own the unit stands behind the name, "x [m]", and `x_t` where a signal has times of
its own; which signals are inputs and how they go on is not in such a file: the plant says it.

Rules of this file: numbers are written with the shortest digits that give the same bits back; lines are read one by
one, so a file may be larger than the memory that its text would take; every refusal names line and column.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from functools import partial
from io import TextIOWrapper
from itertools import chain
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from hoopd.files.reading import InputError, os_reason
from hoopd.files.whole_files import opened
from hoopd.recording.by_name import built
from hoopd.recording.column_choice import TICK, TIME, Pick, SignalLayout, by_name, choose, split_unit
from hoopd.recording.recording import Recording
from hoopd.recording.tables import MAX_ROWS, NAME_THEM, NAMES, SKIP, Columns, column_names, recording_of, refuse_double
from hoopd.recording.tick_columns import FILE_ORDER

# Behind numbers a sign begins a remark; behind names it does after a blank, but for the unit in a bracket.
_REMARK, _REMARK_OF_NAMES = re.compile("[%#]"), re.compile(r"\s[%#](?![^\[(]*[\])])")
MAX_FILE_BYTES = 2**32
MAX_LINE_CHARS = 2**14  # nine numbers of 25 digits are 250
BLOCK_ROWS = 2**14  # rows that wait as text
_MISSING = frozenset(("", "nan", "NaN", "NAN"))
_DECIMAL_COMMA = re.compile(r"([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)")


def read(
    path: Path, columns: Columns | None = None, layout: SignalLayout | None = None, hold: str = "zero"
) -> Recording:
    """Recording of a .csv file, or of text between blanks or tabs; InputError names line and column of what is wrong.

    columns: what the columns after `t` hold, in order, against the header's names; or CHANNEL=COLUMN[:UNIT], as
    `column_choice.choose` takes it. layout: the plant's signals.
    """
    try:
        with TextIOWrapper(opened(path, MAX_FILE_BYTES), encoding="utf-8-sig", newline="") as file:
            return _read(file, path, columns, layout, hold)
    except UnicodeDecodeError:
        raise _not_utf8(path) from None
    except OSError as error:
        raise InputError(path, "", os_reason(error)) from None


def _not_utf8(path: Path) -> InputError:
    """Which line of the file it is."""
    with opened(path, MAX_FILE_BYTES) as file:
        for number, line in enumerate(iter(partial(file.readline, MAX_LINE_CHARS), b""), start=1):
            try:
                line.decode("utf-8-sig")
            except UnicodeDecodeError as error:
                sign = line[error.start : error.start + 1].hex()
                return InputError(path, f"line {number}", f"is no UTF-8 (byte {sign}): save the file as UTF-8 text")
    return InputError(path, "", "not a text file")


def encode(recording: Recording, fields: dict[str, Any]) -> bytes:
    """The file's bytes; `fields`: further signals by name."""
    names = FILE_ORDER if recording.is_tick else tuple(recording.signals)
    units = {} if recording.is_tick else {name: signal.unit for name, signal in recording.signals.items()}
    columns = {"t": recording.t, **{name: recording.column(name) for name in names}, **fields}
    texts = [[repr(x) if x == x else "" for x in column.tolist()] for column in columns.values()]  # noqa: PLR0124
    header = [_cell(f"{name} [{units[name]}]" if units.get(name) else name) for name in columns]
    lines = [",".join(header), *map(",".join, zip(*texts, strict=True))]
    return ("\n".join(lines) + "\n").encode()


def _cell(text: str) -> str:
    """The text as a cell, in quotes where it holds what separates cells."""
    return '"' + text.replace('"', '""') + '"' if any(sign in text for sign in ',"\r\n') else text


def _read(file: TextIO, path: Path, columns: Columns | None, layout: SignalLayout | None, hold: str) -> Recording:
    rows = _rows(file, path) if path.suffix.lower() == ".csv" else _blank_rows(file, path)
    number, cells = next(rows, (1, []))
    header = [cell.strip() for cell in cells]
    if layout is not None or by_name(columns):
        return _by_name(rows, header, columns, layout or TICK, hold, path, number)
    names = _names(header, None if columns is None else str(columns), path, number)
    line, data = _table(rows, names, path)
    table = {name: data[:, k] for k, name in enumerate(names) if name != SKIP}
    return recording_of(table, path, lambda index: f"line {line[index]}")


def _by_name(
    rows: Iterator[tuple[int, list[str]]],
    header: list[str],
    columns: Columns | None,
    layout: SignalLayout,
    hold: str,
    path: Path,
    number: int,
) -> Recording:
    """The columns that are asked for; what stands in the others need not be numbers."""
    place = f"line {number}"
    if _is_of_numbers(header):  # no names: columns are called by their place
        rows, header = chain([(number, header)], rows), [str(k + 1) for k in range(len(header))]
    named = [name for name in header if name]
    refuse_double(named, path, place)
    picks = choose({name: split_unit(name)[1] for name in named}, columns, layout, path)
    rows, dated = _begun(rows, header, picks[TIME].column)
    if dated:  # a date says its own unit
        picks[TIME] = Pick(picks[TIME].column)
    wanted = {pick.column for pick in picks.values()}
    names = [name if name in wanted else SKIP for name in header]
    line, data = _table(rows, names, path, picks[TIME].column if dated else None)
    arrays = {name: data[:, k] for k, name in enumerate(names) if name != SKIP}
    return built(picks, arrays, layout, hold, path, lambda index: f"line {line[index]}")


def _begun(
    rows: Iterator[tuple[int, list[str]]], header: list[str], time: str | None
) -> tuple[Iterator[tuple[int, list[str]]], bool]:
    """All rows, and whether the time of the first one is a date."""
    first = next(rows, None)
    if first is None:
        return rows, False
    dated = time in header and len(first[1]) == len(header) and _is_instant(first[1][header.index(time)])
    return chain([first], rows), dated


def _is_of_numbers(header: list[str]) -> bool:
    try:
        return bool(header) and not any(np.isnan(_number(cell)) for cell in header)
    except ValueError:
        return False


def _table(
    rows: Iterator[tuple[int, list[str]]], names: list[str], path: Path, dates: str | None = None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Line numbers, and numbers (rows, columns) of the columns that are not skipped; `dates`: the one of dates."""
    blocks, lines = [], []
    for found, block in _blocks(rows, names, path, dates):
        lines.append(found)
        blocks.append(block)
        if len(blocks) * BLOCK_ROWS > MAX_ROWS:
            raise InputError(path, "", f"more than {MAX_ROWS} rows")
    if not blocks:
        raise InputError(path, "", "holds a header and no rows")
    return np.concatenate(lines), np.concatenate(blocks)


def _names(header: list[str], columns: str | None, path: Path, line: int) -> list[str]:
    """What each column holds; InputError when the header does not say."""
    place = f"line {line}"
    if "t" not in header:
        raise InputError(path, place, f"expected a header with t and signals (t,{','.join(FILE_ORDER)}){_hint(header)}")
    refuse_double(header, path, place)
    if columns is not None:
        return _asked(header, column_names(columns, FILE_ORDER, path), path)
    unknown = [name for name in header if name != "t" and name not in NAMES]
    if unknown:
        raise InputError(path, place, f"unknown column {unknown[0]!r}; known: t, {', '.join(NAMES)}; or {NAME_THEM}")
    return header


def _asked(header: list[str], names: tuple[str, ...], path: Path) -> list[str]:
    if len(names) != len(header) - 1:
        raise InputError(path, "columns", f"{len(names)} names for {len(header) - 1} columns beside t")
    others = iter(names)
    return ["t" if name == "t" else next(others) for name in header]


def _hint(header: list[str]) -> str:
    return f", found {','.join(header)!r}" if header else ""


def _lines(file: TextIO, path: Path) -> Iterator[str]:
    number = 0
    while line := file.readline(MAX_LINE_CHARS + 1):
        number += 1
        if len(line) > MAX_LINE_CHARS:
            raise InputError(path, f"line {number}", f"longer than {MAX_LINE_CHARS} characters: no CSV of numbers")
        yield line


def _rows(file: TextIO, path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of every line that is not blank; between commas, or between semicolons as in the header."""
    lines, before = _lines(file, path), list[str]()
    for line in lines:
        before.append(line)
        if line.strip():
            break
    semicolons = bool(before) and _has_semicolons(before[-1])
    reader = csv.reader(chain(before, lines), strict=True, delimiter=";" if semicolons else ",")
    try:
        for cells in reader:
            if cells and (len(cells) > 1 or cells[0].strip()):
                yield reader.line_num, [_pointed(cell) for cell in cells] if semicolons else cells
    except csv.Error as error:
        raise InputError(path, f"line {reader.line_num}", f"not CSV: {error}") from None


def _blank_rows(file: TextIO, path: Path) -> Iterator[tuple[int, list[str]]]:
    """The same of cells between tabs, semicolons, blanks or commas; % and # begin a remark: a line of its own, or what
    follows numbers."""
    width = 0  # cells of the first row
    for number, line in enumerate(_lines(file, path), start=1):
        text = line.strip()
        if text and text[0] not in "%#":
            cells, whole = _cells(text), line.strip(" \r\n")
            if remark := (_REMARK if _is_of_numbers(cells[:1]) else _REMARK_OF_NAMES).search(text):
                whole = text[: remark.start()].rstrip(" ")
                cells = _cells(whole.rstrip(" \t,;"))
            if "\t" in whole and len(cells) < width:
                cells = _with_empty_ends(cells, whole, width)
            width = width or len(cells)
            yield number, cells


def _with_empty_ends(cells: list[str], line: str, width: int) -> list[str]:
    """As many empty cells before and behind as tabs at the ends of the line tell, and the row lacks."""
    behind = min(len(line) - len(line.rstrip("\t")), width - len(cells))
    before = min(len(line) - len(line.lstrip("\t")), width - len(cells) - behind)
    return [""] * before + cells + [""] * behind


def _cells(text: str) -> list[str]:
    """Of one line."""
    if "\t" in text or ";" in text:
        return [_pointed(cell) for cell in text.split("\t" if "\t" in text else ";")]
    parts = text.split()
    if len(parts) > 1 and all(_DECIMAL_COMMA.fullmatch(part) for part in parts if "," in part):
        return [_pointed(part) for part in parts]
    return [cell.strip() for cell in (re.split(r"[\s,]+", text) if _is_of_numbers(parts[:1]) else text.split(","))]


def _has_semicolons(line: str) -> bool:
    """Whether a file's first line has cells between semicolons: more of them than commas, or numbers between them."""
    numbers = ";" in line and _is_of_numbers([_pointed(cell.strip().strip('"')) for cell in line.split(";")])
    return numbers or line.count(";") > line.count(",")


def _pointed(cell: str) -> str:
    """With a point where a number has a decimal comma."""
    bare = cell.strip()
    match = _DECIMAL_COMMA.fullmatch(bare) if "," in bare else None
    return f"{match[1]}.{match[2]}" if match else bare


def _blocks(
    rows: Iterable[tuple[int, list[str]]], names: list[str], path: Path, dates: str | None
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Line numbers and numbers (rows, columns) of the file, some thousand rows at a time."""
    block: list[tuple[int, list[str]]] = []
    for number, cells in rows:
        if len(cells) != len(names):
            raise InputError(path, f"line {number}", f"has {len(cells)} cells, the header has {len(names)}")
        block.append((number, cells))
        if len(block) == BLOCK_ROWS:
            yield _numbers(block, names, path, dates)
            block = []
    if block:
        yield _numbers(block, names, path, dates)


def _numbers(
    block: list[tuple[int, list[str]]], names: list[str], path: Path, dates: str | None
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    data = np.empty((len(block), len(names)))
    for k, name in enumerate(names):
        if name == SKIP:
            continue
        read = _instant if name == dates else _number
        try:
            data[:, k] = [read(cells[k]) for _, cells in block]
        except ValueError:
            raise _no_number(block, k, read, name, path) from None
    return np.array([number for number, _ in block]), data


def _number(cell: str) -> float:
    """The number in a cell, NaN when empty; ValueError when it is none."""
    text = cell.strip()
    if text in _MISSING:
        return float("nan")
    if "_" in text:  # Python reads 1_000, nobody else does
        raise ValueError(text)
    return float(text)


def _instant(cell: str) -> float:
    """Seconds since 1970 of an ISO 8601 date with its time of day, in UTC unless it says its zone; else ValueError."""
    found = datetime.fromisoformat(cell.strip())
    return (found if found.tzinfo is not None else found.replace(tzinfo=UTC)).timestamp()


def _is_instant(cell: str) -> bool:
    """Whether it is a date and no number."""
    try:
        _instant(cell)
    except ValueError:
        return False
    return not _is_of_numbers([cell])


def _no_number(
    block: list[tuple[int, list[str]]], k: int, read: Callable[[str], float], name: str, path: Path
) -> InputError:
    for number, cells in block:
        try:
            read(cells[k])
        except ValueError:
            expected = "a number" if read is _number else "a date"
            return InputError(path, f"line {number}, column {name}", f"expected {expected}, found {cells[k]!r}")
    raise AssertionError("no cell was refused")
