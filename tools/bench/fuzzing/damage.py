"""Ways to spoil a file: by its bytes, by its words, by its tree, by what stands in its place.

Rules of this file: pure but for `put`; everything random comes from the case's generator. No path outside of the case's
own folder is ever written by what is made here.
"""

from __future__ import annotations

import os
import random
import re
import socket
import struct
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec
import yaml

from hoopd.files.yaml_text import text_of

LONG = 40_000
# What is put in the place of a value, as text of YAML.
RUBBISH = (
    "9" * 400, "-" + "9" * 400, "1e400", "-1e400", "1e308", "-1e308", "1e-320", ".nan", ".inf", "-.inf", "0", "-0.0",
    "-1", "1", "2", "65536", "2147483648", "9223372036854775808", "18446744073709551616", "1e18", "1e-12", "true",
    "null", "''", "x", '"\\0"', '"\\u202e"', '"\\ud800"', '"a\\nb"', "[]", "{}", "[1]", "[[[1]]]", "{a: 1}", "[x, 2]",
    "[.nan, 1, 2]", "20 ms", "20 parsecs", "1e308 h", "0x1F", "0o17", "0x" + "f" * 300, "010", "1_000", "1:30:00",
    "2024-01-01", "!!python/object:os.system x", "!!binary aaaa", "&a [*a]", "*b", "&a x", "{<<: {a: 1}}", "<<", "'''",
    "\"", "%", "@x", "`", "- - - 1", "? 1", "|\n x", "é", "\u2028", "\ufeff", "😀", "x" * LONG, "[" * 60 + "]" * 60,
    "[" * 3000, "{a: " * 60 + "1" + "}" * 60, "[" + "1," * LONG + "]", "/dev/null", "/dev/zero", "/proc/self/mem",
    "no/such/file", "x" * 300 + "/x", "fifo", "folder", "link", "%s%n{}", "hoop; x", "tcp/127.0.0.1:0", "psi=0.1",
)  # fmt: skip
_NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.])")
EXTREMES = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{new}: &{new} [{','.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefg", "bcdefgh", strict=True)
)


def value(rng: random.Random) -> str:
    """A value that nobody means, as text of YAML."""
    return rng.choice(RUBBISH)


def spoil(data: bytes, rng: random.Random, *, text: bool, others: list[bytes]) -> bytes:
    """The content with one to three things wrong; `others`: contents of other kinds of file."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        ways = (*_TEXT, *_BYTES) if text else _BYTES
        data = rng.choice(others) if rng.random() < 0.03 else rng.choice(ways)(data, rng)
    return data


def put(path: Path, data: bytes, rng: random.Random) -> None:
    """The file, or once in a while something that is none."""
    if rng.random() < 0.05:
        rng.choice(_INSTEAD)(path)
    else:
        path.write_bytes(data)


# ------------------------------------------------------------------------------------------------ bytes


def _flip(data: bytes, rng: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 30)) if out else 0):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _leave_out(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data) + 1)
    return data[:start] + data[start + rng.choice((1, 4, 100, 5000)) :]


def _twice(data: bytes, rng: random.Random) -> bytes:
    start, size = rng.randrange(len(data) + 1), rng.choice((1, 8, 100, 5000))
    return data[: start + size] + data[start : start + size] * rng.choice((1, 2, 50)) + data[start + size :]


def _rubbish_inside(data: bytes, rng: random.Random) -> bytes:
    start = rng.randrange(len(data) + 1)
    return data[:start] + rng.randbytes(rng.choice((1, 8, 200))) + data[start:]


def _extreme(data: bytes, rng: random.Random) -> bytes:
    """A length, count or number that says too much."""
    size, code = rng.choice(((1, "B"), (2, "H"), (4, "I"), (8, "Q")))
    packed = struct.pack(rng.choice("<>") + code, rng.choice(EXTREMES) & (2 ** (8 * size) - 1))
    limit = rng.choice((200, len(data)))  # heads hold most of the lengths
    start = rng.randrange(max(1, min(limit, len(data) - size + 1)))
    return data[:start] + packed + data[start + size :]


def _noughts(data: bytes, rng: random.Random) -> bytes:
    start, size = rng.randrange(len(data) + 1), rng.choice((1, 16, 1000))
    return data[:start] + b"\0" * size + data[start + size :]


def _empty(data: bytes, rng: random.Random) -> bytes:
    return rng.choice((b"", b"\0", b"\n", b"\xff\xfe", b"\xef\xbb\xbf" + data, rng.randbytes(1000)))


_BYTES = (_flip, _flip, _cut, _leave_out, _twice, _rubbish_inside, _extreme, _extreme, _noughts, _empty)


# ------------------------------------------------------------------------------------------------ words


def _other_number(data: bytes, rng: random.Random) -> bytes:
    text = data.decode(errors="replace")
    found = list(_NUMBER.finditer(text))
    if not found:
        return data
    match = rng.choice(found)
    return (text[: match.start()] + value(rng) + text[match.end() :]).encode(errors="replace")


def _lines(data: bytes, rng: random.Random) -> bytes:
    """A line twice, away, elsewhere, or longer than any."""
    lines = data.split(b"\n")
    index, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.randrange(5)
    if way == 0:
        lines.insert(other, lines[index])
    elif way == 1:
        del lines[index]
    elif way == 2:
        lines[index], lines[other] = lines[other], lines[index]
    elif way == 3:
        lines[index] += lines[index] * rng.choice((1, 50, 2000))
    else:
        lines.insert(index, value(rng).encode(errors="replace"))
    return b"\n".join(lines)


def _bomb(data: bytes, rng: random.Random) -> bytes:
    deep = rng.choice(("[", "{a: ", "- ", "(", "a:\n  "))
    return rng.choice((BOMB.encode(), BOMB.encode() + data, (deep * rng.choice((60, 5000, 100_000))).encode()))


MOST_PLACES = 10_000


def _tree(data: bytes, rng: random.Random) -> bytes:
    """Another value at some place of the tree."""
    try:
        tree = yaml.safe_load(data.decode())
        places = list(islice(_places(tree), MOST_PLACES))  # a bomb of aliases has more than the memory holds
        holder, key = rng.choice(places)
        way = rng.randrange(5)
        if way == 0:
            del holder[key]
        elif way == 1 and isinstance(holder, dict):
            holder[rng.choice(("x", "<<", "", "a.b", "\0", "schema", "\u202e"))] = holder[key]
        elif way == 2:
            source, name = rng.choice(places)
            holder[key] = source[name]
        else:
            return _with_text(tree, holder, key, value(rng))
        return text_of(tree).encode()
    except (ValueError, IndexError, TypeError, RecursionError, yaml.YAMLError, KeyError):
        return data


def _with_text(tree: Any, holder: Any, key: Any, text: str) -> bytes:
    """The tree with a text of YAML at one place."""
    mark = "PLACE7391"
    holder[key] = mark
    return text_of(tree, default_flow_style=None, width=10**6).replace(mark, text).encode(errors="replace")


def _places(tree: Any) -> Any:
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, item in list(pairs):
        yield tree, key
        yield from _places(item)


_TEXT = (_other_number, _other_number, _other_number, _tree, _tree, _tree, _lines, _lines, _bomb)


def row_of_json(row: bytes, rng: random.Random) -> bytes:
    """A JSON object with another value somewhere, or something else."""
    wrong = ("9" * 400, "-" + "9" * 400, "1e400", "1e308", "null", '"x"', "[]", "{}", "true", "-1", "1e30", '"inf"')
    if rng.random() < 0.1:
        return rng.choice((b"", b"null", b"[" * 5000, b'{"a":' * 5000, b"\xff", b"[]", b"{}", row[:-1], row * 2))
    try:
        tree = msgspec.json.decode(row)
    except (msgspec.DecodeError, RecursionError):  # spoiled before
        return row
    holder, key = rng.choice(list(_places(tree)))
    holder[key] = "PLACE7391"
    return msgspec.json.encode(tree).replace(b'"PLACE7391"', rng.choice(wrong).encode())


# ------------------------------------------------------------------------------------------------ no file


def _socket(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # a socket's path has 107 characters at most
    try:
        with socket.socket(socket.AF_UNIX) as listener:
            listener.bind(path.name)
    finally:
        os.chdir(here)


def _loop(path: Path) -> None:
    path.symlink_to(path.name)


_INSTEAD: tuple[Any, ...] = (
    os.mkfifo,
    Path.mkdir,
    _socket,
    _loop,
    lambda path: path.symlink_to("/dev/zero"),
    lambda path: path.symlink_to("/dev/null"),
    lambda path: path.symlink_to("/proc/self/mem"),
    lambda path: path.symlink_to("/nowhere/at/all"),
    lambda path: path.write_bytes(b""),
    lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY | os.O_CLOEXEC), 2**36),
)
