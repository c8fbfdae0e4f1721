"""Reading of YAML files into typed records, with one clear line for everything that is wrong.

Rules of this file: no defaults and no laws here; an unknown key, a wrong unit or an unsafe value raises
`InputError`, whose text is the whole message (file: key: reason); the command line ends with exit code 2 on it,
and with 3 when it is the board's port that is missing.
A number may be written plainly, in the unit that its key ends in, or as text with a unit ("20 ms").
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import os
import re
import stat
import types
import typing
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, TypeVar, Union, get_args, get_origin

import msgspec

from hoopd.files import yaml_text

T = TypeVar("T")

# Beside a type in Annotated: infinities and NaN are meant (the rig's operator sends them to be refused).
ANY_NUMBER = "any number"

# Key ending -> unit -> factor to the unit of the ending.
UNITS: dict[str, dict[str, float]] = {
    "_s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0},
    "_hz": {"Hz": 1.0, "kHz": 1e3},
    "_nm": {"N m": 1.0, "Nm": 1.0, "mN m": 1e-3, "mNm": 1e-3},
    "_rad": {"rad": 1.0, "mrad": 1e-3, "deg": 0.017453292519943295},
    "_rad_s": {"rad/s": 1.0, "deg/s": 0.017453292519943295, "rpm": 0.10471975511965977},
    "_bytes": {"B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9, "KiB": 2**10, "MiB": 2**20, "GiB": 2**30},
    "_px": {"px": 1.0},
    "_a": {"A": 1.0, "mA": 1e-3},
    "_m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "_kg": {"kg": 1.0, "g": 1e-3},
}
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_QUANTITY = re.compile(rf"^\s*({_NUMBER})\s*([A-Za-z][A-Za-z /0-9]*)?\s*$")
_AT = re.compile(r" - at `\$\.?([^`]*)`$")
# Thousands of times what any of our files holds: what is larger (a picture, a device file) is not one of them.
MAX_FILE_BYTES = 2**20
# Of numbers as they are measured zlib and zstd leave a third to a twelfth, of a run at a standstill as little.
UNPACKED_RATIO = 16
UNPACKED_FREE_BYTES = 8 * 2**20
# A line for a person: of a value that is longer its beginning tells enough.
MAX_PART_CHARS = 300


class InputError(ValueError):
    """Unusable input: file, key (or row and column) and reason in one line."""

    def __init__(self, path: object, key: str, reason: str) -> None:
        self.path, self.key, self.reason = str(path), key, reason
        super().__init__(": ".join(_printable(part) for part in (self.path, key, reason) if part))


class PortMissingError(InputError):
    """The board's port cannot be had now: absent, busy, or not ours yet; later it may be, so the exit code is 3."""


def open_regular(path: Path, max_bytes: int) -> BinaryIO:
    """An open file of a disk, of bounded size; InputError for everything else.

    Whatever reads a file that a user names comes here: a pipe may never say a word, a device has no end.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # a pipe is not waited for
    except (OSError, ValueError) as error:
        raise InputError(path, "", os_reason(error)) from None
    status = os.fstat(handle)
    if stat.S_ISREG(status.st_mode) and status.st_size <= max_bytes:
        return os.fdopen(handle, "rb")
    os.close(handle)
    if stat.S_ISREG(status.st_mode):
        raise InputError(path, "", f"larger than {max_bytes} bytes: no file of this kind")
    raise InputError(path, "", "is a directory, not a file" if stat.S_ISDIR(status.st_mode) else "not a file")


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """Content of a file; InputError when it is none, is larger or cannot be read."""
    with open_regular(path, max_bytes) as file:
        # Python takes the memory that it is asked to fill at once; the kernel's own files say a size of 0.
        count = min(max_bytes, max(os.fstat(file.fileno()).st_size, MAX_FILE_BYTES))
        try:
            data = file.read(count + 1)
        except OSError as error:
            raise InputError(path, "", os_reason(error)) from None
    if len(data) > count:
        raise InputError(path, "", f"larger than {max_bytes} bytes: no file of this kind")
    return data


def unpacked_limit(packed_bytes: int) -> int:
    """How many bytes a packed file may become: what claims more is no recording, and would fill the memory."""
    return UNPACKED_FREE_BYTES + UNPACKED_RATIO * packed_bytes


def read_text(path: Path) -> str:
    """Text of a file; InputError when it cannot be read."""
    try:
        return read_bytes(path, MAX_FILE_BYTES).decode()
    except UnicodeDecodeError as error:
        raise InputError(path, "", os_reason(error)) from None


def load_yaml(text: str, path: object) -> Any:
    """Plain data of a YAML text; InputError names the line of a mistake."""
    try:
        return yaml_text.data_of(text)
    except yaml_text.YamlError as error:
        raise InputError(path, error.where, error.reason) from None


def parse_yaml(text: str, path: object) -> dict[str, Any]:
    """Mapping at the top of a YAML text; InputError names the line of a syntax error."""
    data = load_yaml(text, path)
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise InputError(path, "", f"expected keys and values, found {type(data).__name__}")
    return data


def to_struct(data: dict[str, Any], kind: type[T], path: object) -> T:
    """Typed record from plain data: units resolved, keys and values checked."""
    try:
        return msgspec.convert(_resolve(data, kind, path, ""), kind, strict=True)
    except RecursionError:
        raise InputError(path, "", "nested too deeply") from None
    except msgspec.ValidationError as error:
        text = str(error)
        match = _AT.search(text)
        key = _named(data, kind, match.group(1)) if match else ""
        raise InputError(path, key, _AT.sub("", text) + _known_schema(kind, text, key)) from None


def _named(data: dict[str, Any], kind: Any, key: str) -> str:
    """The key with the name of the entry that is wrong, which the library's own message leaves open (`[...]`)."""
    group, open_, rest = key.partition("[...]")
    entries = data.get(group)
    for name, entry in entries.items() if open_ and isinstance(entries, dict) else ():
        try:
            msgspec.convert({**data, group: {name: entry}}, kind, strict=True)
        except msgspec.ValidationError as error:
            if (match := _AT.search(str(error))) and match.group(1) == key:
                return f"{group}.{name}{rest}"
    return key


def _known_schema(kind: Any, text: str, key: str) -> str:
    """What a file of this kind calls itself, where that is what is wrong."""
    if key != "schema" and "field `schema`" not in text:
        return ""
    known = get_args(_hints(kind).get("schema"))
    return f"; write schema: {' or '.join(known)}" if known else ""


def _resolve(data: Any, kind: Any, path: object, key: str) -> Any:
    record, item = _record_type(kind), _item_type(kind)
    if isinstance(data, dict) and record is not None:
        hints = _hints(record)
        return {
            name: _resolve(value, _known(hints, name, path, key), path, _join(key, name))
            for name, value in data.items()
        }
    if isinstance(data, list) and item is not None:
        return [_resolve(value, item, path, f"{key}[{index}]") for index, value in enumerate(data)]
    if isinstance(data, dict) and item is not None:
        return {name: _resolve(value, item, path, _join(key, str(name))) for name, value in data.items()}
    return _number(data, kind, path, key)


@cache
def _hints(record: Any) -> dict[str, Any]:
    """Types of a record's fields; looked up once, for a list may hold thousands of them."""
    return typing.get_type_hints(record, include_extras=True)


def _known(hints: dict[str, Any], name: object, path: object, key: str) -> Any:
    if name in hints:
        return hints[str(name)]
    close = _suggest(str(name), list(hints))
    hint = f"; did you mean {close}?" if close else f"; known: {', '.join(hints)}"
    raise InputError(path, _join(key, str(name)), f"unknown key{hint}")


def _suggest(name: str, names: list[str]) -> str:
    stem = name.rsplit("_", 1)[0]
    by_stem = [other for other in names if other.rsplit("_", 1)[0] == stem]
    close = by_stem or difflib.get_close_matches(name, names, 1, 0.6)
    return close[0] if close else ""


def _number(value: Any, kind: Any, path: object, key: str) -> Any:
    """A quantity text in the unit of its key; integers become floats where a float is wanted."""
    wants = set(_flat_types(kind))
    if ANY_NUMBER in get_args(kind) and isinstance(value, float):
        return value
    if isinstance(value, float):
        return _finite(value, path, key)
    if isinstance(value, int) and not isinstance(value, bool) and float in wants and int not in wants:
        return _finite(value, path, key)
    if not isinstance(value, str) or not wants & {float, int} or str in wants:
        return value
    units = units_of(key)
    match = _QUANTITY.match(value)
    if match is None:
        raise InputError(path, key, f"expected a number, got {value!r}")
    number, unit = _finite(match.group(1), path, key), (match.group(2) or "").strip()
    if not unit:
        return number
    if unit not in units:
        allowed = ", ".join(units) or "no unit"
        raise InputError(path, key, f"wrong unit {unit!r}: this value takes {allowed}")
    scaled = _finite(number * units[unit], path, key)
    return round(scaled) if float not in wants else scaled


def _finite(value: float | str, path: object, key: str) -> float:
    """The number; InputError for NaN and infinities: every comparison with one of them may switch a check off."""
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError(path, key, f"must be a finite number, not {value}")
    return number


def units_of(key: str) -> dict[str, float]:
    """Units that a key may be written in, by its ending (the longest ending wins)."""
    name = re.sub(r"\[\d+\]$", "", key)
    endings = sorted((ending for ending in UNITS if name.endswith(ending)), key=len, reverse=True)
    return UNITS[endings[0]] if endings else {}


def _record_type(kind: Any) -> Any:
    for option in _options(kind):
        if isinstance(option, type) and (issubclass(option, msgspec.Struct) or dataclasses.is_dataclass(option)):
            return option
    return None


def _item_type(kind: Any) -> Any:
    for option in _options(kind):
        origin, args = get_origin(option), get_args(option)
        if origin in (list, tuple) and args:
            return args[0]
        if origin is dict and args:
            return args[1]
    return None


def _options(kind: Any) -> Iterator[Any]:
    if get_origin(kind) in (Union, types.UnionType):
        for option in get_args(kind):
            yield from _options(option)
    elif get_origin(kind) is typing.Annotated:
        yield from _options(get_args(kind)[0])
    else:
        yield kind


def _flat_types(kind: Any) -> list[Any]:
    return list(_options(kind))


def _join(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def os_reason(error: Exception, otherwise: str = "cannot be read") -> str:
    """Why a file cannot be used, in lower case."""
    if isinstance(error, UnicodeDecodeError):
        return "not a text file"
    return (getattr(error, "strerror", None) or otherwise).lower()


def _printable(text: str) -> str:
    """Text that stays on one line and is no longer than a person reads."""
    shown = text if len(text) <= MAX_PART_CHARS else f"{text[:MAX_PART_CHARS]}..."
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in shown)
