"""Numbers, units and names of a diagnosis as a person reads them, the same on the terminal, the page and in figures.

Rules of this file: SI units with prefixes, as many digits as an interval allows; names come from files, so whatever
does not print is escaped.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hoopd.diagnose.record import Number, Quantity

NOTHING = "-"  # where no number is known
# Only a unit that begins with one of these to the first power takes a prefix: "mN m" is read, "mkg" or "mm2" is not.
_PREFIXED = re.compile(r"(N|s|A|V|Hz|rad|m)(?= |/|$)")
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_EXPONENT = re.compile(r"(?<=[A-Za-z)])\^?(-?\d+)")
# A rounded value keeps two digits of what it is uncertain by.
UNCERTAIN_DIGITS = 2
PLAIN_DIGITS = 4
# Digits behind the point up to which a number is written out; fewer than none are zeros before it.
MIN_DECIMALS, MAX_DECIMALS = -3, 8
LONGEST = 60  # characters of a name beside a drawing


def safe(text: object) -> str:
    """Text without control characters, directions of writing or bytes that are no text."""
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode() for char in str(text))


def brief(text: object) -> str:
    """Text that has room beside a drawing: the middle of a long one is left out."""
    whole = safe(text)
    return whole if len(whole) <= LONGEST else f"{whole[: LONGEST // 2]}…{whole[1 - LONGEST // 2 :]}"


def unit_text(unit: str) -> str:
    """A unit with its exponents raised; nothing for a pure number."""
    return "" if unit == "-" else _EXPONENT.sub(lambda hit: hit.group(1).translate(_SUPERSCRIPTS), safe(unit))


def number_text(value: Number, digits: int = PLAIN_DIGITS) -> str:
    """A number with that many digits, without an exponent where it can do without."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0.0:
        return "0"
    text = f"{value:.{digits}g}"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    return text if not MIN_DECIMALS <= decimals <= MAX_DECIMALS else _trimmed(_decimal(value, decimals))


def _trimmed(text: str) -> str:
    """Without the zeros that a rounded number ends in."""
    return text.rstrip("0").rstrip(".") if "." in text else text


def _decimal(value: float, decimals: int) -> str:
    """Rounded, without a sign on nothing; `decimals` may be negative."""
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return text.lstrip("-") if not text.strip("-0.") else text


def amount(value: Number, unit: str, digits: int = PLAIN_DIGITS, *, like: Number = None) -> str:
    """A number with its unit, prefixed where it is small: 5.1e-3 N m is 5.1 mN m; or as another number is, `like`."""
    if value is None or not math.isfinite(value):
        return NOTHING
    factor, shown = _prefix(like or value, unit)
    return f"{number_text(value / factor, digits)} {shown}".rstrip()


def _prefix(value: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which this value is read."""
    if value == 0.0 or abs(value) >= 0.1 or not _PREFIXED.match(unit):
        return 1.0, unit_text(unit)
    factor, prefix = next((one for one in _PREFIXES if abs(value) >= one[0]), _PREFIXES[-1])
    return factor, prefix + unit_text(unit)


def value_text(quantity: Quantity, *, like: Number = None) -> str:
    """The value, as many digits as its interval allows; in the unit in which `like` is read."""
    if quantity.value is None or not math.isfinite(quantity.value):
        return NOTHING
    factor, unit = _prefix(like or quantity.value, quantity.unit)
    half = _half_width(quantity)
    if half is None:
        return f"{number_text(quantity.value / factor)} {unit}".rstrip()
    return f"{_rounded(quantity.value / factor, half / factor)} {unit}".rstrip()


def interval_text(quantity: Quantity, *, like: Number = None) -> str:
    """The 95 % interval in the unit of the value, or that of `like`."""
    half = _half_width(quantity)
    if quantity.value is None or quantity.ci95 is None or half is None:
        return NOTHING
    factor, unit = _prefix(like or quantity.value, quantity.unit)
    low, high = (_rounded((end or 0.0) / factor, half / factor) for end in quantity.ci95)
    return f"{low} to {high} {unit}".rstrip()


def _half_width(quantity: Quantity) -> float | None:
    """Half of the interval; None without a finite one of some width."""
    if quantity.ci95 is None or any(end is None or not math.isfinite(end) for end in quantity.ci95):
        return None
    half = 0.5 * ((quantity.ci95[1] or 0.0) - (quantity.ci95[0] or 0.0))
    return half if half > 0.0 else None


def _rounded(value: float, half: float) -> str:
    """To UNCERTAIN_DIGITS of the half width."""
    return _decimal(value, min(UNCERTAIN_DIGITS - 1 - math.floor(math.log10(half)), 12))


def percent(value: Number) -> str:
    """A fit in percent."""
    return NOTHING if value is None or not math.isfinite(value) else f"{value:.1f}"


def counted(value: int | None) -> str:
    """A number of samples."""
    return NOTHING if value is None else str(value)


def share(value: Number) -> str:
    """A share of samples in percent."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{100.0 * value:.1f} %" if value >= 0.01 else f"{100.0 * value:.2g} %"


def chance(value: Number) -> str:
    """A probability in percent: what is not determined as nothing or all is neither."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value < 0.01:
        return "< 1 %"
    return "> 99 %" if value > 0.99 else f"{100.0 * value:.0f} %"


def nats(value: Number) -> str:
    """A log-likelihood ratio: whole above 10."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{value:.0f}" if abs(value) >= 10.0 else f"{value:.1f}"


def listed(names: Iterable[str], last: str = "and") -> str:
    """Names as a sentence lists them."""
    words = [safe(name) for name in names]
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)


def short_names(names: Iterable[str]) -> dict[str, str]:
    """Recordings by the last part of their path, where that tells them apart; whole otherwise."""
    whole = list(dict.fromkeys(names))
    last = [name.rsplit("/", 1)[-1] or name for name in whole]
    return {name: safe(short if last.count(short) == 1 else name) for name, short in zip(whole, last, strict=True)}
