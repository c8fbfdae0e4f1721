"""The grammar of plant files: what it says, what it refuses and where, and units."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings, strategies as st

from hoopd.files.dimensions import Unit, parse_unit, unit_of
from hoopd.files.expression_parser import parse_equation, parse_expression
from hoopd.files.expressions import ExpressionError, Name, value

LAWS = {
    "sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "abs": abs, "tanh": math.tanh, "exp": math.exp, "min": min,
    "max": max, "sign": lambda x: math.copysign(1.0, x) if x else 0.0,
}  # fmt: skip


def number(text: str, **names: float) -> float:
    return float(value(parse_expression(text), lambda name, primes: names[name] * 10**primes, LAWS))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 + 2*3", 7.0),
        ("10 - 3 - 2", 5.0),
        ("12/3/2", 2.0),
        ("-2^2", -4.0),
        ("2^-1", 0.5),
        ("2**(1/2)", math.sqrt(2)),
        ("(1 + 2)*3", 9.0),
        ("--3", 3.0),
        ("+3", 3.0),
        (".5e1", 5.0),
        ("cos(pi)", -1.0),
        ("max(1, 5, 3) - min(2, 4)", 3.0),
        ("abs(-3)*sign(-2)", -3.0),
        ("sqrt(16) + tanh(0) + exp(0) + sin(0)", 5.0),
        ("a*a' + a''", 240.0),
    ],
)
def test_it_says_what_it_looks_like(text: str, expected: float) -> None:
    assert number(text, a=2.0) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("text", "column", "reason"),
    [
        ("x = F +", 8, "end of the text"),
        ("x = __import__('os')", 16, "no sign"),
        ("x = __import__(1)", 5, "unknown function"),
        ("x = __class__", 5, "begins with a letter"),
        ("x = a.b", 6, "no sign"),
        ("x = a[0]", 6, "no sign"),
        ("x = α", 5, "no sign"),
        ("x = 1e9**9", 5, "number of size"),
        ("x = 9^9^9", 7, "exponent"),
        ("x = a^b", 7, "exponent"),
        ("x = 1e400", 5, "number of size"),
        ("x = 1/0", 5, "number of size"),
        ("x = (-1)^0.5", 6, "number of size"),
        ("x = a + (-pi)^0.5", 10, "number of size"),
        ("x = 1/(pi - pi)", 5, "number of size"),
        ("x = 1/sin(0)", 5, "number of size"),
        ("x = sqrt(3 - pi)", 5, "number of size"),
        ("x = exp(1e9)", 5, "number of size"),
        ("x = sin(1, 2)", 5, "takes 1"),
        ("x = max(1)", 5, "takes 2 to 10"),
        ("x = sin", 5, "is a function"),
        ("x'''= 1", 1, "derivative"),
        ("x == 1", 4, "not expected"),
        ("x", 2, "equation"),
        ("m x''= a", 3, r"a\*b"),
        ("x = 2a", 6, r"a\*b"),
        ("x = b(a + 1)", 5, r"b\*\("),
        ("x = lambda: 1", 11, "no sign"),
        ("x = a if b else c", 7, "not expected"),
        ("x = " + "(" * 3000, 1, "longer"),
        ("x = " + "(" * 500 + "1" + ")" * 500, 65, "nested"),
        ("x = " + "-" * 500 + "1", 65, "nested"),
        ("x = " + "+".join("a" * 500), 5, "nested"),
        ("x = " + "sin(" * 100 + "1", 245, "nested"),
    ],
)
def test_a_mistake_has_its_column(text: str, column: int, reason: str) -> None:
    with pytest.raises(ExpressionError, match=reason) as error:
        parse_equation(text)
    assert error.value.place == f"column {column}"
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


@given(st.text(alphabet="ax'0123456789.e+-*/^(), =min\n\tα_", max_size=60))
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_tree_or_an_error(text: str) -> None:
    try:
        parse_expression(text)
    except ExpressionError as error:
        assert error.place.startswith("column ")


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("N", "kg m/s2"),
        ("N s/m", "kg/s"),
        ("V s/rad", "N m/A"),
        ("W/(m2 K)", "kg/s^3/K"),
        ("mN m", "mJ"),
        ("g", "1e-3"),
        ("rpm", "6 deg/s"),
        ("ohm", "V/A"),
        ("1/s", "Hz"),
    ],
)
def test_units_are_products_of_powers(text: str, same: str) -> None:
    if same == "1e-3":
        assert parse_unit("g").same(Unit(parse_unit("kg").powers, 1e-3))
    elif same == "6 deg/s":
        assert parse_unit("rpm").same(Unit(parse_unit("1/s").powers, math.radians(6.0)))
    else:
        assert parse_unit(text).same(parse_unit(same))


@pytest.mark.parametrize("text", ["furlong", "kg/", "m2.5", "m^x", "m" * 61, "N;m", "2 m"])
def test_a_unit_that_nobody_knows_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        parse_unit(text)


def in_units(text: str) -> Unit | None:
    units = {"x": "m", "F": "N", "m": "kg", "k": "N/m", "c": "N s/m", "alpha": "rad", "y": "mm", "free": ""}

    def of(name: Name) -> Unit | None:
        known = units[name.name]
        return parse_unit(known) / parse_unit("s") ** name.primes if known else None

    return unit_of(parse_expression(text), of)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("m*x'' + c*x' + k*x - F", "N"),
        ("max(x, 0)", "m"),
        ("sqrt(k/m)", "1/s"),
        ("m*x'^2/2", "J"),
        ("sin(alpha)*F", "N"),
        ("sign(x')*F", "N"),
        ("tanh(x/x)", "-"),
    ],
)
def test_an_expression_has_the_unit_of_its_names(text: str, unit: str) -> None:
    found = in_units(text)
    assert found is not None and found.same(parse_unit(unit))


@pytest.mark.parametrize(
    ("text", "column", "reason"),
    [
        ("m*x'' + c*x", 9, "kg m/s"),
        ("x + 1", 5, "make it a parameter"),
        ("sin(x)", 5, "takes a number or rad"),
        ("x + y", 5, "0.001 m"),
        ("min(x, F)", 8, "N"),
    ],
)
def test_a_sum_of_two_units_has_its_column(text: str, column: int, reason: str) -> None:
    with pytest.raises(ExpressionError, match=reason) as error:
        in_units(text)
    assert error.value.place == f"column {column}"


def test_what_has_no_unit_is_not_judged() -> None:
    assert in_units("free*x + F") is not None
    assert in_units("free*x") is None
