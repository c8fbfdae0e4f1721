"""Units of quantities: texts such as "N s/m" as exponents of base units with a factor, and what expressions have.

A unit text is a product of units, each with an exponent ("kg m2", "m/s^2", "N/(m s)"); all behind a stroke stands below
the line. An angle is no dimension of its own: rad is 1, deg a factor.

Rules of this file: a mistake in an expression is its `ExpressionError`; a unit that nobody knows is a `ValueError`. A
package for quantities would bring prefixes for all of physics and a grammar of its own; this is a table and a sum.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType

from hoopd.files.expressions import CONSTANTS, Expression, Name, Node, Number, Operation

BASE = ("kg", "m", "s", "A", "K")
# Factors that are closer are the same one.
SAME = 1e-9


@dataclass(frozen=True)
class Unit:
    """A product of powers of the base units, times a factor."""

    powers: tuple[Fraction, ...] = (Fraction(0),) * len(BASE)
    factor: float = 1.0

    def __mul__(self, other: Unit) -> Unit:
        powers = tuple(a + b for a, b in zip(self.powers, other.powers, strict=True))
        return Unit(powers, self.factor * other.factor)

    def __truediv__(self, other: Unit) -> Unit:
        return self * other**-1

    def __pow__(self, exponent: float) -> Unit:
        by = Fraction(exponent).limit_denominator(100)
        return Unit(tuple(power * by for power in self.powers), self.factor**exponent)

    @property
    def is_plain(self) -> bool:
        """Whether it is a number's: no dimension, factor 1."""
        return self.same_kind(PLAIN) and math.isclose(self.factor, 1.0, rel_tol=SAME)

    def same_kind(self, other: Unit) -> bool:
        """Whether both measure the same kind of thing, the factor apart."""
        return self.powers == other.powers

    def same(self, other: Unit) -> bool:
        """Whether numbers of both may be added."""
        return self.same_kind(other) and math.isclose(self.factor, other.factor, rel_tol=SAME)

    def __str__(self) -> str:
        parts = [(name, power) for name, power in zip(BASE, self.powers, strict=True) if power]
        above = [f"{name}{power if power != 1 else ''}" for name, power in parts if power > 0]
        below = [f"{name}{-power if power != -1 else ''}" for name, power in parts if power < 0]
        text = " ".join(above) or ("1" if below else "-")
        text += f"/{below[0]}" if len(below) == 1 else f"/({' '.join(below)})" if below else ""
        factor = "" if math.isclose(self.factor, 1.0, rel_tol=SAME) else f"{self.factor:g} "
        return factor + (_COMMON.get(self.powers, text) if self.powers != PLAIN.powers else "without unit")


def _unit(m: int = 0, kg: int = 0, s: int = 0, a: int = 0, k: int = 0, factor: float = 1.0) -> Unit:
    return Unit(tuple(Fraction(power) for power in (kg, m, s, a, k)), factor)


PLAIN = Unit()
ENERGY = _unit(2, 1, -2)

# A kelvin in differences and slopes; as a temperature it counts from elsewhere, so that nothing converts between both.
CELSIUS = ("degC", "°C")
# With prefixes: mm, kN, mA ...
_PREFIXED: Mapping[str, Unit] = {
    "m": _unit(m=1), "g": _unit(kg=1, factor=1e-3), "s": _unit(s=1), "A": _unit(a=1), "K": _unit(k=1),
    "N": _unit(1, 1, -2), "J": ENERGY, "W": _unit(2, 1, -3), "Pa": _unit(-1, 1, -2), "C": _unit(s=1, a=1),
    "V": _unit(2, 1, -3, -1), "ohm": _unit(2, 1, -3, -2), "F": _unit(-2, -1, 4, 2), "H": _unit(2, 1, -2, -2),
    "Wb": _unit(2, 1, -2, -1), "T": _unit(0, 1, -2, -1), "Hz": _unit(s=-1), "l": _unit(m=3, factor=1e-3),
    "bar": _unit(-1, 1, -2, factor=1e5), "rad": PLAIN,
}  # fmt: skip
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "k": 1e3, "M": 1e6, "G": 1e9}
_ALONE: Mapping[str, Unit] = {
    "1": PLAIN, "%": Unit(factor=0.01), "deg": Unit(factor=math.pi / 180), "turn": Unit(factor=2 * math.pi),
    "in": _unit(m=1, factor=0.0254), "ft": _unit(m=1, factor=0.3048), "lb": _unit(kg=1, factor=0.45359237),
    "lbf": _unit(1, 1, -2, factor=4.4482216152605), "psi": _unit(-1, 1, -2, factor=6894.757293168),
    **{name: _unit(k=1) for name in CELSIUS}, "°": Unit(factor=math.pi / 180),
    "rpm": _unit(s=-1, factor=2 * math.pi / 60), "min": _unit(s=1, factor=60.0), "h": _unit(s=1, factor=3600.0),
}  # fmt: skip
UNITS: Mapping[str, Unit] = MappingProxyType(
    {
        **{f"{p}{name}": Unit(u.powers, u.factor * f) for name, u in _PREFIXED.items() for p, f in _PREFIXES.items()},
        **_PREFIXED,
        **_ALONE,
    }
)
# How a product of powers is shown.
_COMMON = {UNITS[name].powers: name for name in ("N", "W", "Pa", "V", "ohm", "F", "H", "Wb")} | {
    ENERGY.powers: "N m",
    (ENERGY * UNITS["s"]).powers: "N m s",
    (UNITS["N"] * UNITS["s"] / UNITS["m"]).powers: "N s/m",
}
_TERM = re.compile(r"(°C|°|[A-Za-z]+|%|1)\^?(-?[0-9])?")
_ANY_TERM = re.compile(r"([^\d^-]+)\^?(-?[0-9]+)?")


def parse_unit(text: str) -> Unit:
    """Unit of a text; "-" and "" are a number's. ValueError names the part that nobody knows.

    Examples
    --------
    >>> str(parse_unit("kg m/s2")), str(parse_unit("kN")), parse_unit("V s/rad").same(parse_unit("N m/A"))
    ('N', '1000 N', True)
    """
    if text.strip() in ("-", ""):
        return PLAIN
    if len(text) > 60:
        raise ValueError("a unit has at most 60 signs")
    above, *below = text.split("/")
    unit = _product(above)
    for part in below:
        unit = unit / _product(part.strip().removeprefix("(").removesuffix(")"))
    return unit


def _product(text: str) -> Unit:
    unit, terms = PLAIN, re.split(r"[ *]+", text.strip())
    for term in terms:
        match = _TERM.fullmatch(term)
        if match is None or match[1] not in UNITS:
            raise ValueError(f"unknown unit {term!r}{_meant(term)}" if term else "a unit is missing")
        unit = unit * UNITS[match[1]] ** int(match[2] or 1)
    return unit


def _meant(term: str) -> str:
    """Two units that somebody wrote together; empty where it is none."""
    for end in range(1, len(term)):
        rest = _TERM.fullmatch(term[end:])
        if term[:end] in UNITS and rest is not None and rest[1] in UNITS and rest[1] != "1":
            return f": is it '{term[:end]} {term[end:]}'?"
    return ""


def product_text(*parts: tuple[str, int]) -> str:
    """Text of a product of units with whole exponents; below the line an angle is 1.

    Examples
    --------
    >>> product_text(("N", 1), ("m/s", -3)), product_text(("N m", 1), ("rad/s", -1)), product_text(("V", 1), ("V", -1))
    ('N s3/m3', 'N m s', '-')
    """
    powers = dict[str, int]()
    for text, exponent in parts:
        for line, part in enumerate(text.split("/")):
            for name, own in _terms(part.strip(" ()")):
                powers[name] = powers.get(name, 0) + exponent * own * (-1 if line else 1)
    above, below = (
        [name if sign * power == 1 else f"{name}{sign * power}" for name, power in powers.items() if sign * power > 0]
        for sign in (1, -1)
    )
    below = [one for one in below if not one.startswith("rad")]
    top = " ".join(above) or ("1" if below else "-")
    return top + (f"/{below[0]}" if len(below) == 1 else f"/({' '.join(below)})" if below else "")


def _terms(product: str) -> Iterator[tuple[str, int]]:
    """Names and exponents of a product, of units that nobody knows, too; what is a number alone has none."""
    for term in re.split(r"[ *]+", product):
        match = _ANY_TERM.fullmatch(term)
        if term not in ("", "1", "-"):
            yield (match[1], int(match[2] or 1)) if match is not None else (term, 1)


def unit_of(expression: Expression, units: Callable[[Name], Unit | None]) -> Unit | None:
    """Unit of an expression from those of its names; None where it may be any. ExpressionError for a sum of two."""
    return _Walk(expression, units).of(expression.root)


class _Walk:
    def __init__(self, expression: Expression, units: Callable[[Name], Unit | None]) -> None:
        self._expression, self._units = expression, units

    def of(self, node: Node) -> Unit | None:
        if isinstance(node, Number):
            return None if node.value == 0.0 else PLAIN
        if isinstance(node, Name):
            return PLAIN if node.name in CONSTANTS else self._units(node)
        parts = [self.of(part) for part in node.parts]
        if node.name == "^":
            exponent = node.parts[1]
            assert isinstance(exponent, Number)
            return _mapped(lambda unit: unit**exponent.value, parts[0])
        if node.name in ("*", "/"):
            return _combined(node.name, *parts)
        return self._law(node, parts)

    def _law(self, node: Operation, parts: list[Unit | None]) -> Unit | None:
        if node.name in ("+", "-", "min", "max", "abs"):
            return self._alike(node, parts)
        if node.name == "sqrt":
            return _mapped(lambda unit: unit**0.5, parts[0])
        if node.name != "sign" and parts[0] is not None and not parts[0].is_plain:
            reason = f"{node.name} takes a number or rad, this is in {parts[0]}"
            raise self._expression.error(node.parts[0].at, reason)
        return PLAIN

    def _alike(self, node: Operation, parts: list[Unit | None]) -> Unit | None:
        first = next((unit for unit in parts if unit is not None), None)
        for part, unit in zip(node.parts, parts, strict=True):
            if unit is not None and first is not None and not unit.same(first):
                raise self._expression.error(part.at, _differ(unit, first, part))
        return first


def _differ(unit: Unit, wanted: Unit, part: Node) -> str:
    if isinstance(part, Number):
        return f"a number beside what is in {wanted}: make it a parameter with a unit"
    alike = " (equations convert no prefixes: give it in plain units)" if unit.same_kind(wanted) else ""
    return f"this is in {unit}, what it is added to or compared with in {wanted}{alike}"


def _mapped(law: Callable[[Unit], Unit], unit: Unit | None) -> Unit | None:
    return None if unit is None else law(unit)


def _combined(name: str, left: Unit | None, right: Unit | None) -> Unit | None:
    if left is None or right is None:
        return None
    return left * right if name == "*" else left / right
