"""Numbers and sentences of a diagnosis as a person reads them, the same on the terminal and on the page.

Rules of this file: text in plain English, SI units with prefixes; names come from files, so whatever does not print
is escaped; nothing is judged here, only said.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from hoopd.diagnose.record import (
    DataQuality,
    Diagnosis,
    EffectFinding,
    Fit,
    Fits,
    FitTable,
    Location,
    NextExperiment,
    Number,
    Quantity,
    Visible,
)

TITLES = {
    "consistent": "Consistent",
    "parameters": "Parameters, not physics",
    "missing_physics": "Missing physics found",
    "unknown_physics": "Unknown physics",
}
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
# Above this many characters a list of names is no longer read.
MANY = 6
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


def amount(value: Number, unit: str, digits: int = PLAIN_DIGITS) -> str:
    """A number with its unit, prefixed where it is small: 5.1e-3 N m is 5.1 mN m."""
    if value is None or not math.isfinite(value):
        return NOTHING
    factor, shown = _prefix(value, unit)
    return f"{number_text(value / factor, digits)} {shown}".rstrip()


def _prefix(value: float, unit: str) -> tuple[float, str]:
    """Factor and unit in which this value is read."""
    if value == 0.0 or abs(value) >= 0.1 or not _PREFIXED.match(unit):
        return 1.0, unit_text(unit)
    factor, prefix = next((one for one in _PREFIXES if abs(value) >= one[0]), _PREFIXES[-1])
    return factor, prefix + unit_text(unit)


def value_text(quantity: Quantity) -> str:
    """The value, as many digits as its interval allows."""
    if quantity.value is None or not math.isfinite(quantity.value):
        return NOTHING
    factor, unit = _prefix(quantity.value, quantity.unit)
    half = _half_width(quantity)
    if half is None:
        return f"{number_text(quantity.value / factor)} {unit}".rstrip()
    return f"{_rounded(quantity.value / factor, half / factor)} {unit}".rstrip()


def interval_text(quantity: Quantity) -> str:
    """The 95 % interval in the unit of the value."""
    half = _half_width(quantity)
    if quantity.value is None or quantity.ci95 is None or half is None:
        return NOTHING
    factor, unit = _prefix(quantity.value, quantity.unit)
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


def share(value: Number) -> str:
    """A share of samples in percent."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return f"{100.0 * value:.1f} %" if value >= 0.01 else f"{100.0 * value:.2g} %"


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


def each_fit(fits: Fits) -> Iterator[tuple[str, str, Fit]]:
    """Recording, channel, fit."""
    for recording, channels in fits.items():
        for channel, fit in channels.items():
            yield recording, channel, fit


def verdict_sentence(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence."""
    gained = _gain_clause(diagnosis.fit.heldout)
    if diagnosis.verdict == "consistent":
        return "The model explains these recordings: nothing is missing that they could show."
    if diagnosis.verdict == "parameters":
        return f"The physics is complete but its parameters are off: re-estimating them removes the mismatch{gained}."
    if diagnosis.verdict == "unknown_physics":
        return f"Something that is not in the library acts {_place(diagnosis.location)}{gained}."
    rest = diagnosis.unexplained
    remains = " What remains is not in the library." if rest is not None and rest.fires else ""
    return f"The model leaves out {listed(map(_finding, diagnosis.effects))}{gained}.{remains}"


def _finding(effect: EffectFinding) -> str:
    """A name with its first size, and what cannot be told from it."""
    sizes = [f"{name} = {value_text(one)}" for name, one in effect.parameters.items() if one.value is not None]
    inside = [*sizes[:1], *([f"{listed(effect.not_excluded)} not excluded"] if effect.not_excluded else [])]
    return effect.name + (f" ({'; '.join(inside)})" if inside else "")


def _place(location: Location) -> str:
    slot = f"in slot {location.slot}" if location.slot else "in a slot that could not be located"
    return slot + (f" and follows {listed(location.depends_on)}" if location.depends_on else "")


def _gain_clause(fits: Fits) -> str:
    """What the held-out data gained in the channel that gained most, means over the recordings."""
    means = [(channel, *pair) for channel, pair in _channel_means(fits).items()]
    if not means:
        return ""
    channel, before, after = max(means, key=lambda one: one[2] - one[1])
    return f"; the fit of held-out {channel} goes from {before:.1f} to {after:.1f} %" if after > before else ""


def _channel_means(fits: Fits) -> dict[str, tuple[float, float]]:
    """Fit before and after by channel: the re-fitted base, or the nominal one when that is the last word."""
    pairs: dict[str, list[tuple[float, float]]] = {}
    for _, channel, fit in each_fit(fits):
        before, after = (
            (fit.nominal, fit.base_refit) if fit.with_effects is None else (fit.base_refit, fit.with_effects)
        )
        if before is not None and after is not None:
            pairs.setdefault(channel, []).append((before, after))
    return {name: (_mean([p[0] for p in many]), _mean([p[1] for p in many])) for name, many in pairs.items()}


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values)


def location_sentence(location: Location) -> str:
    """Where the mismatch sits; empty when there is none."""
    if location.slot is None:
        return ""
    channel = f", most visible in {location.channel}" if location.channel else ""
    follows = f" It follows {listed(location.depends_on)}." if location.depends_on else ""
    return f"The mismatch sits in slot {location.slot}{channel}, {_when(location)}.{follows}"


def _when(location: Location) -> str:
    if location.segments is None:
        return "throughout the recordings"
    spans = [f"{start:.1f} to {end:.1f} s" for start, end in location.segments]
    more = f" and {len(spans) - MANY} more intervals" if len(spans) > MANY else ""
    return f"at {listed(spans[:MANY])}{more}" if spans else "in no interval of its own"


def unexplained_sentence(diagnosis: Diagnosis) -> str:
    """What the library has no name for; empty when nothing is left."""
    rest = diagnosis.unexplained
    if rest is None or not rest.fires:
        return ""
    part = f"{share(rest.share)} of what the re-fitted base leaves unexplained" if rest.share is not None else "A part"
    where = f" in slot {rest.slot}" if rest.slot else ""
    curve = f"; a curve over {rest.curve.regressor} was fitted to it" if rest.curve is not None else ""
    return f"{part} has no name in the library{where}{curve}."


def experiment_sentence(planned: NextExperiment) -> str:
    """What to record next, and why."""
    settings = ", ".join(f"{safe(name)} {value_text(one)}" for name, one in planned.parameters.items())
    bring = f" ({nats(planned.expected_nats)} nats expected)" if planned.expected_nats is not None else ""
    inside = f" ({settings})" if settings else ""
    return f"Record {planned.signal}{inside}: that tells {listed(planned.tells_apart, 'from')}{bring}."


def ablation_sentences(effects: Iterable[EffectFinding]) -> list[str]:
    """What the held-out data lose when a finding is taken out again."""
    return [
        f"Without {one.name} the fit of held-out {channel} falls from {percent(before)} to {percent(after)} %."
        for one in effects if one.ablation is not None
        for channel, before in one.ablation.heldout_with.items()
        if (after := one.ablation.heldout_without.get(channel)) is not None
    ]  # fmt: skip


def invisible_sentence(power: Mapping[str, Visible]) -> str:
    """Effects of which these recordings show nothing, however large; empty when there is none."""
    blind = [name for name, one in power.items() if one.smallest is None]
    return f"Not visible in these recordings at any size expected: {listed(blind)}." if blind else ""


def source_sentence(fit: FitTable) -> str:
    """Where the samples of the channels come from; empty when nothing was said."""
    return "; ".join(f"{channel}: {source}" for channel, source in fit.channel_source.items())


def quality_notes(quality: DataQuality) -> list[str]:
    """Sentences about the recordings."""
    of_each = [f"{name}: {note}" for name, one in quality.recordings.items() for note in one.notes]
    return [*quality.notes, *of_each]
