"""Expressions of plant files as trees of numbers, names, functions and arithmetic; nothing is executed.

Rules of this file: what a tree is and what it amounts to; how a text becomes one is in `expression_parser`. What names
and functions stand for is said by the caller of `value`.
"""

from __future__ import annotations

import difflib
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

# A longer name is a typing error.
MAX_NAME_CHARS = 40
# How much of the text is shown on either side of a mistake.
SHOWN_CHARS = 30

# Function -> fewest and most arguments.
FUNCTIONS: Mapping[str, tuple[int, int]] = MappingProxyType(
    {
        **dict.fromkeys(("sin", "cos", "sqrt", "abs", "sign", "tanh", "exp"), (1, 1)),
        **dict.fromkeys(("min", "max"), (2, 10)),
    }
)
CONSTANTS: Mapping[str, float] = MappingProxyType({"pi": math.pi})
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class ExpressionError(ValueError):
    """What is wrong in an expression, and where: `place` is its column and the text with the mistake in brackets."""

    def __init__(self, text: str, begin: int, end: int, reason: str) -> None:
        self.reason, self.place = reason, f"column {begin + 1}"
        before, after = text[max(0, begin - SHOWN_CHARS) : begin], text[end : end + SHOWN_CHARS]
        shown = f"{'...' * (begin > SHOWN_CHARS)}{before}[{text[begin:end]}]{after}"
        shown += "..." * (len(text) > end + SHOWN_CHARS)
        super().__init__(f"{self.place}: {reason}, in {shown}")


class TextSpan(NamedTuple):
    """Where a part stands in its text."""

    begin: int
    end: int


@dataclass(frozen=True)
class Number:
    """A number as it is written."""

    at: TextSpan
    value: float
    depth: int = 1


@dataclass(frozen=True)
class Name:
    """A name; `primes` counts its derivatives by time."""

    at: TextSpan
    name: str
    primes: int = 0
    depth: int = 1


@dataclass(frozen=True)
class Operation:
    """`+ - * / ^` of two parts, `-` of one, or a function of some."""

    at: TextSpan
    name: str
    parts: tuple[Node, ...]
    depth: int


Node = Number | Name | Operation


@dataclass(frozen=True)
class Expression:
    """A text and its tree."""

    text: str
    root: Node

    def error(self, at: TextSpan, reason: str) -> ExpressionError:
        """What is wrong with a part of it."""
        return ExpressionError(self.text, at.begin, at.end, reason)


def parts_of(node: Node) -> Iterator[Node]:
    """The node and everything below it."""
    yield node
    if isinstance(node, Operation):
        for part in node.parts:
            yield from parts_of(part)


def names_in(expression: Expression) -> Iterator[Name]:
    """Every name that stands in an expression, as often as it does."""
    return (part for part in parts_of(expression.root) if isinstance(part, Name))


ARITHMETIC: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv, "^": operator.pow}
)


def value(expression: Expression, name: Callable[[str, int], Any], functions: Mapping[str, Callable[..., Any]]) -> Any:
    """What an expression amounts to: `name(name, primes)` and `functions` say what its words stand for.

    Examples
    --------
    >>> from hoopd.files.expression_parser import parse_expression
    >>> value(parse_expression("2*x' + max(1, 3)"), lambda name, primes: 10.0 * primes, {"max": max})
    23.0
    """

    def of(node: Node) -> Any:
        if isinstance(node, Number):
            return node.value
        if isinstance(node, Name):
            return CONSTANTS[node.name] if node.name in CONSTANTS else name(node.name, node.primes)
        arguments = [of(part) for part in node.parts]
        if node.name in ARITHMETIC:
            return -arguments[0] if len(arguments) == 1 else ARITHMETIC[node.name](*arguments)
        return functions[node.name](*arguments)

    return of(expression.root)


def check_names(expression: Expression, known: Mapping[str, int]) -> None:
    """ExpressionError unless every name is among the known ones, with at most so many primes."""
    for one in names_in(expression):
        if one.name in CONSTANTS and not one.primes:
            continue
        if one.name not in known:
            raise expression.error(one.at, f"unknown name {one.name!r}{_near(one.name, known)}")
        if one.primes > known[one.name]:
            allowed = ("no derivative", "a first derivative at most", "a second derivative at most")[known[one.name]]
            raise expression.error(one.at, f"{one.name} has {allowed} here")


def _near(name: str, known: Mapping[str, int]) -> str:
    rate = name[1:]
    if name.startswith("d") and known.get(rate):
        return f"; the rate of {rate} is written {rate}'"
    close = difflib.get_close_matches(name, known, 2, 0.5)
    return f"; did you mean {' or '.join(close)}?" if close else f"; known: {', '.join(known)}"
