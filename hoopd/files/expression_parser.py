"""The grammar of plant files: a text becomes a tree.

    equation    sum = sum
    sum         product + product - ...
    product     sign * sign / ...
    sign        - sign | power
    power       item ^ number            (also written **)
    item        number | name | name' | name'' | function(sum, ...) | (sum)

Rules of this file: the work is bounded by the text, and the text by MAX_CHARS; a mistake is an `ExpressionError` with
its column.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from hoopd.files.expressions import (
    ARITHMETIC,
    CONSTANTS,
    FUNCTIONS,
    MAX_NAME_CHARS,
    Expression,
    ExpressionError,
    Name,
    Node,
    Number,
    Operation,
    TextSpan,
)

# Far more than a law of mechanics needs; a tree of this depth is walked without a deep recursion.
MAX_CHARS = 2000
MAX_DEPTH = 60
# A number beyond is a typing error, and products of such numbers leave the computer's.
SMALLEST, LARGEST = 1e-30, 1e30
LARGEST_EXPONENT = 10

_OF_NUMBERS: Mapping[str, Callable[..., float]] = MappingProxyType(
    {
        "sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "abs": abs, "tanh": math.tanh, "exp": math.exp,
        "sign": lambda x: math.copysign(1.0, x) if x else 0.0, "min": min, "max": max,
    }
)  # fmt: skip
_TOKEN = re.compile(
    r"(?P<space>[ \t\n]+)|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)(?P<primes>'*)|(?P<sign>\*\*|[-+*/^(),=])"
)


def parse_expression(text: str) -> Expression:
    """Tree of a text; ExpressionError."""
    parser = _Parser(text)
    root = parser.sum(0)
    parser.expect("end")
    return Expression(text, root)


def parse_equation(text: str) -> tuple[Expression, Expression]:
    """Both sides of `left = right`; ExpressionError."""
    parser = _Parser(text)
    left = parser.sum(0)
    parser.expect("=", "expected an equation: left = right")
    right = parser.sum(0)
    parser.expect("end")
    return Expression(text, left), Expression(text, right)


class _Token(NamedTuple):
    kind: str  # number, name, end, or the sign itself
    at: TextSpan
    text: str = ""
    primes: int = 0


class _Parser:
    """Recursive descent over the tokens of one text."""

    def __init__(self, text: str) -> None:
        if len(text) > MAX_CHARS:
            raise ExpressionError(text, 0, 1, f"longer than {MAX_CHARS} characters")
        self._text, self._tokens, self._next = text, list(_tokens(text)), 0

    def expect(self, kind: str, otherwise: str = "") -> _Token:
        """The next token, which must be of a kind."""
        token = self._tokens[self._next]
        if token.kind != kind:
            raise self._unexpected(token, otherwise)
        self._next += 1
        return token

    def sum(self, level: int) -> Node:
        """product + product - ..."""
        return self._chain(level, ("+", "-"), self._product)

    def _product(self, level: int) -> Node:
        return self._chain(level, ("*", "/"), self._sign)

    def _chain(self, level: int, signs: tuple[str, ...], part: Callable[[int], Node]) -> Node:
        node = part(level)
        while (token := self._tokens[self._next]).kind in signs:
            self._next += 1
            node = self._operation(token.kind, (node, part(level)))
        return node

    def _sign(self, level: int) -> Node:
        token = self._tokens[self._next]
        if token.kind in ("+", "-"):
            self._next += 1
            part = self._sign(self._deeper(level, token))
            return part if token.kind == "+" else self._operation("-", (part,), token.at.begin)
        return self._power(level)

    def _power(self, level: int) -> Node:
        base = self._item(level)
        if self._tokens[self._next].kind not in ("^", "**"):
            return base
        self._next += 1
        exponent = self._sign(self._deeper(level, self._tokens[self._next]))
        size = _constant(exponent)
        if size is None or abs(size) > LARGEST_EXPONENT:
            reason = f"an exponent is a number of at most {LARGEST_EXPONENT}"
            raise ExpressionError(self._text, *exponent.at, reason)
        return self._operation("^", (base, Number(exponent.at, size)))

    def _item(self, level: int) -> Node:
        token = self._tokens[self._next]
        self._next += 1
        if token.kind == "number":
            return Number(token.at, self._finite(token.at, float(token.text)))
        if token.kind == "name":
            return self._call(token, level) if self._tokens[self._next].kind == "(" else self._named(token)
        if token.kind != "(":
            raise self._unexpected(token)
        node = self.sum(self._deeper(level, token))
        self.expect(")")
        return node

    def _named(self, token: _Token) -> Name:
        if token.text in FUNCTIONS:
            raise ExpressionError(self._text, *token.at, f"{token.text} is a function: {token.text}(...)")
        if token.text.startswith("_") or len(token.text) > MAX_NAME_CHARS:
            reason = f"a name begins with a letter and has at most {MAX_NAME_CHARS} signs"
            raise ExpressionError(self._text, *token.at, reason)
        if token.primes > 2:
            raise ExpressionError(self._text, *token.at, "no derivative beyond the second")
        return Name(token.at, token.text, token.primes)

    def _call(self, token: _Token, level: int) -> Node:
        if token.text not in FUNCTIONS or token.primes:
            reason = f"unknown function {token.text!r}; known: {', '.join(FUNCTIONS)}; a product is {token.text}*(...)"
            raise ExpressionError(self._text, *token.at, reason)
        arguments: list[Node] = []
        inner = self._deeper(level, token)
        while not arguments or self._tokens[self._next].kind == ",":
            self._next += 1  # the opening bracket, then the commas
            arguments.append(self.sum(inner))
        end = self.expect(")").at.end
        fewest, most = FUNCTIONS[token.text]
        if not fewest <= len(arguments) <= most:
            count = f"{fewest}" if fewest == most else f"{fewest} to {most}"
            raise ExpressionError(self._text, *token.at, f"{token.text} takes {count} arguments, not {len(arguments)}")
        return self._operation(token.text, tuple(arguments), token.at.begin, end)

    def _operation(self, name: str, parts: tuple[Node, ...], begin: int | None = None, end: int | None = None) -> Node:
        at = TextSpan(parts[0].at.begin if begin is None else begin, parts[-1].at.end if end is None else end)
        depth = 1 + max(part.depth for part in parts)
        self._bounded(depth, at)
        node = Operation(at, name, parts, depth)
        size = _constant(node)
        return node if size is None else Number(at, self._finite(at, size))

    def _finite(self, at: TextSpan, size: float) -> float:
        if size and not SMALLEST <= abs(size) <= LARGEST:
            raise ExpressionError(self._text, *at, f"a number of size {SMALLEST:g} to {LARGEST:g} is expected")
        return size

    def _deeper(self, level: int, token: _Token) -> int:
        self._bounded(level + 1, token.at)
        return level + 1

    def _bounded(self, depth: int, at: TextSpan) -> None:
        if depth > MAX_DEPTH:
            raise ExpressionError(self._text, at.begin, at.begin + 1, f"nested too deeply: {MAX_DEPTH} levels at most")

    def _unexpected(self, token: _Token, otherwise: str = "") -> ExpressionError:
        met = "the end of the text" if token.kind == "end" else repr(self._text[token.at.begin : token.at.end])
        reason = otherwise or f"{met} is not expected here"
        if token.kind in ("number", "name", "("):
            reason = f"{met} is not expected here: a product is written with a sign, a*b"
        return ExpressionError(self._text, *token.at, reason)


def _tokens(text: str) -> Iterator[_Token]:
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ExpressionError(text, at, at + 1, "no sign of an expression")
        begin, at = match.span()
        if number := match["number"]:
            yield _Token("number", TextSpan(begin, at), number)
        elif name := match["name"]:
            yield _Token("name", TextSpan(begin, at), name, len(match["primes"]))
        elif sign := match["sign"]:
            yield _Token("^" if sign == "**" else sign, TextSpan(begin, at))
    yield _Token("end", TextSpan(at, at))


def _constant(node: Node) -> float | None:
    """Value of a law of numbers alone; None for anything else, infinite where there is no such number.

    Parts that are laws of numbers have become numbers before.
    """
    if isinstance(node, Number):
        return node.value
    if isinstance(node, Name):
        return None if node.primes else CONSTANTS.get(node.name)
    values = [None if isinstance(part, Operation) else _constant(part) for part in node.parts]
    numbers = [one for one in values if one is not None]
    if len(numbers) < len(values):
        return None
    try:
        law = ARITHMETIC.get(node.name, _OF_NUMBERS.get(node.name))
        result = -numbers[0] if node.name == "-" and len(numbers) == 1 else law(*numbers)  # type: ignore[misc]
    except (OverflowError, ZeroDivisionError, ValueError):
        return math.inf
    return result if isinstance(result, float) else math.inf  # the root of a negative number is complex
