"""YAML texts to plain data and back, by the core schema of YAML 1.2.

Rules of this file: the work is bounded by the text. Nodes and depth are counted while the text is parsed, an alias
costs what it stands for, and nothing in a text is code: no tags, no merge keys. A plain word is a number, `true`,
`false`, `null` or text: `yes` and `on` are text, `010` is ten, and there are no dates and no base 60, where 1 MB of
digits and colons took minutes. Source: YAML 1.2.2, section 10.3.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import yaml

# Thousands of times what any of our files holds; the longest, an experiment's table of 20 minutes, has 60,000 numbers.
MAX_TEXT_CHARS = 2**20
MAX_VALUES = 100_000
MAX_DEPTH = 50
# Beyond these an integer is taken as the float that is nearest to it: no counter of ours needs more.
MAX_INTEGER = 2**63

_WORDS: dict[str, bool | None] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}
_INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"([-+]?)\.(?:inf|Inf|INF)")
_NAN = frozenset((".nan", ".NaN", ".NAN"))
# Digits of an integer that is surely below MAX_INTEGER.
_SHORT = 18

_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # without the C library: the same, ten times slower


class YamlError(ValueError):
    """A text that cannot be used: `where` is the line, empty when there is none."""

    def __init__(self, where: str, reason: str) -> None:
        self.where, self.reason = where, reason
        super().__init__(f"{where}: {reason}" if where else reason)


class _Built(NamedTuple):
    """A value, and how many values it holds with itself, aliases written out."""

    value: Any
    size: int


class _Open:
    """A list or mapping whose end has not come yet."""

    def __init__(self, event: Any) -> None:
        self.anchor: str | None = event.anchor
        self.is_mapping = isinstance(event, yaml.MappingStartEvent)
        self.value: Any = {} if self.is_mapping else []
        self.size = 1
        self.key: str | None = None


def data_of(text: str) -> Any:
    """Plain data of a YAML text: dictionaries with text keys, lists, text, numbers, truths and None.

    Raises YamlError for a text that is no YAML, that holds what these files never do, or that is too large.
    """
    if len(text) > MAX_TEXT_CHARS:
        raise YamlError("", f"longer than {MAX_TEXT_CHARS} characters")
    try:
        return _Builder().build(yaml.parse(text, _Parser))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"line {mark.line + 1}" if mark is not None else ""
        raise YamlError(where, f"not YAML: {getattr(error, 'problem', None) or 'cannot be read'}") from None
    except UnicodeError:
        raise YamlError("", "not YAML: holds characters that are none") from None


class _Builder:
    """Values from the parser's events, without a recursion that a text could make deep."""

    def __init__(self) -> None:
        self._open: list[_Open] = []
        self._anchors: dict[str, _Built] = {}
        self._count = 0
        self._documents = 0
        self._top: Any = None

    def build(self, events: Iterator[Any]) -> Any:
        """The text's one document."""
        for event in events:
            if isinstance(event, yaml.ScalarEvent):
                self._add(_Built(self._scalar(event), 1), event, event.anchor)
            elif isinstance(event, yaml.AliasEvent):
                self._alias(event)
            elif isinstance(event, yaml.SequenceStartEvent | yaml.MappingStartEvent):
                self._enter(event)
            elif isinstance(event, yaml.SequenceEndEvent | yaml.MappingEndEvent):
                self._leave(event)
            elif isinstance(event, yaml.DocumentStartEvent):
                self._documents += 1
                if self._documents > 1:
                    raise _wrong(event, "a second document: one is read")
        return self._top

    def _scalar(self, event: Any) -> Any:
        _refuse_tag(event)
        if not event.implicit[0]:  # in quotes
            return event.value
        if self._expects_key():
            if event.value == "<<":
                raise _wrong(event, "merge keys (<<) are not read: write the keys out")
            return event.value
        try:
            return _plain(event.value)
        except ValueError as error:
            raise _wrong(event, str(error), self._place()) from None

    def _place(self) -> str:
        """Keys and indices that lead to where the parser is."""
        parts = [f".{item.key}" if item.is_mapping else f"[{len(item.value)}]" for item in self._open]
        return "".join(parts).lstrip(".")

    def _alias(self, event: Any) -> None:
        if any(item.anchor == event.anchor for item in self._open):
            raise _wrong(event, f"*{event.anchor} holds itself")
        if event.anchor not in self._anchors:
            raise _wrong(event, f"*{event.anchor} stands for nothing")
        self._add(self._anchors[event.anchor], event, None)

    def _enter(self, event: Any) -> None:
        _refuse_tag(event)
        if len(self._open) == MAX_DEPTH:
            raise _wrong(event, f"nested too deeply: {MAX_DEPTH} levels at most")
        if self._expects_key():
            raise _wrong(event, "not YAML: a key must be a word")
        self._open.append(_Open(event))

    def _leave(self, event: Any) -> None:
        done = self._open.pop()
        self._count -= done.size - 1  # counted again with the whole
        self._add(_Built(done.value, done.size), event, done.anchor)

    def _add(self, built: _Built, event: Any, anchor: str | None) -> None:
        if anchor is not None:
            self._anchors[anchor] = built
        self._count += built.size
        if self._count > MAX_VALUES:
            raise _wrong(event, f"more than {MAX_VALUES} values once its aliases are resolved")
        if not self._open:
            self._top = built.value
            return
        top = self._open[-1]
        top.size += built.size
        if not top.is_mapping:
            top.value.append(built.value)
        elif top.key is None:
            top.key = _key(top, built.value, event)
        else:
            top.value[top.key], top.key = built.value, None

    def _expects_key(self) -> bool:
        return bool(self._open) and self._open[-1].is_mapping and self._open[-1].key is None


def _key(mapping: _Open, value: Any, event: Any) -> str:
    if not isinstance(value, str):
        raise _wrong(event, "not YAML: a key must be a word")
    if value in mapping.value:
        raise _wrong(event, f"{value!r} stands twice")
    return value


def _plain(text: str) -> Any:
    """What a word without quotes stands for; ValueError for a number that no float can hold."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        return int(text) if len(text) <= _SHORT and text[:2] not in ("0o", "0x") else _long_integer(text)
    if _FLOAT.fullmatch(text):
        return _finite(float(text), text)
    if match := _INFINITE.fullmatch(text):
        return float(f"{match.group(1)}inf")
    return math.nan if text in _NAN else text


def _long_integer(text: str) -> int | float:
    base = {"0o": 8, "0x": 16}.get(text[:2], 10)
    if base == 10:
        number = _finite(float(text), text)
        return number if abs(number) >= MAX_INTEGER else int(text)
    whole = int(text[2:], base)
    return whole if whole < MAX_INTEGER else _finite(_as_float(whole), text)


def _as_float(whole: int) -> float:
    try:
        return float(whole)
    except OverflowError:
        return math.inf


def _finite(number: float, text: str) -> float:
    if not math.isfinite(number):
        raise ValueError(f"must be a finite number, not {text}")
    return number


def _refuse_tag(event: Any) -> None:
    if event.tag is not None:
        raise _wrong(event, f"tags ({event.tag}) are not read")


def _wrong(event: Any, reason: str, place: str = "") -> YamlError:
    line = f"line {event.start_mark.line + 1}"
    return YamlError(f"{line}, {place}" if place else line, reason)


class _Dumper(yaml.SafeDumper):
    """Quotes what either version of YAML would not take for text."""


for _pattern, _first in ((_INTEGER, "-+0123456789"), (_FLOAT, "-+.0123456789")):
    _Dumper.add_implicit_resolver("tag:hoopd,1.2:number", re.compile(rf"(?:{_pattern.pattern})\Z"), list(_first))


def text_of(data: Any, **style: Any) -> str:
    """A text that `data_of` reads back as the same data; `style`: width, default_flow_style and others of PyYAML."""
    text: str = yaml.dump(data, Dumper=_Dumper, sort_keys=False, **style)
    return text
