"""Figures of the numbers: do intervals hold the truth, how far off are values, what is gained on held-out data.

Rules of this file: pure; numbers are compared with what can be seen (`as_seen`). A diagnosis that failed holds no truth
and gains nothing; an oracle that failed is counted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from concealed.judged import NO_EFFECT, Judged
from concealed.proportions import by_case

CHANNELS = ("theta_rate", "psi")  # of the held-out gain
LEAST_GAIN = 0.1  # percent points that the oracle must gain for a share of it to mean anything
Interval = tuple[float | None, float | None]


def covered(cases: Sequence[Judged]) -> dict[str, Any]:
    """Do the 95 % intervals hold the truth: effects that were named right, and the base's entries beside them."""
    return {
        "effects": by_case([_effect_hits(case) for case in cases]),
        "base": by_case([_base_hits(case) for case in cases]),
    }


def _effect_hits(case: Judged) -> list[bool]:
    if case.said is None:
        return [False for effect in case.answer["effects"] if effect["name"] != NO_EFFECT for _ in effect["sized"]]
    return [low <= value <= high for value, _, (low, high) in _compared(case) if low is not None and high is not None]


def relative_errors(case: Judged) -> list[float]:
    """abs(said - true)/abs(true) of the sized parameters of effects named right."""
    return [abs(said - true) / abs(true) for true, said, _ in _compared(case) if true and said is not None]


def _compared(case: Judged) -> list[tuple[float, float | None, Interval]]:
    """(truth, said, interval) of every sized parameter of effects that have their very name."""
    found = []
    said = {effect["name"]: effect for effect in (case.said or {}).get("effects", [])}
    for effect in case.answer["effects"]:
        if effect["name"] not in said or effect["name"] == NO_EFFECT:
            continue
        told = said[effect["name"]]["parameters"]
        for key in effect["sized"]:
            if key in told:
                found.append(_oriented(effect["as_seen"][key], told[key], wave="phi" in effect["as_seen"]))
    return found


def _oriented(true: float, told: Mapping[str, Any], wave: bool) -> tuple[float, float | None, Interval]:
    """An amplitude beside a phase has no sign of its own."""
    value, (low, high) = told["value"], told.get("ci95") or (None, None)
    if wave and value is not None and value * true < 0:
        return true, -value, (None if high is None else -high, None if low is None else -low)
    return true, value, (low, high)


def _base_hits(case: Judged) -> list[bool]:
    """Entries of nulls and of singles whose effect was named right; a gain of the actuator is seen as L1 and L2."""
    if not case.family("null", "single") or (case.hidden and not case.truth):
        return []
    if case.said is None:
        return [False] * len(case.answer["entries"])
    if case.truth and not case.right:
        return []
    told = (case.said.get("base") or {}).get("parameters", {})
    wanted = {name: one["ci95"] for name, one in told.items() if name in case.answer["entries"] and one.get("ci95")}
    return [low <= case.answer["entries"][name] <= high for name, (low, high) in wanted.items()]


def heldout_gain(fit: Mapping[str, Any]) -> float | None:
    """Mean gain in percent points of with_effects over base_refit, held-out recordings and channels."""
    gains = [
        channel["with_effects"] - channel["base_refit"]
        for recording in fit.get("heldout", {}).values()
        for name, channel in recording.items()
        if name in CHANNELS and channel.get("with_effects") is not None and channel.get("base_refit") is not None
    ]
    return sum(gains) / len(gains) if gains else None


def oracle_shares(cases: Sequence[Judged]) -> dict[str, Any]:
    """(E_base_refit - E_tool)/(E_base_refit - E_oracle) on held-out data, median over singles and compounds.

    "n" cases have a share; in "too_little" the oracle gains next to nothing, in "errors" it failed.
    """
    asked = [c for c in cases if c.oracle and c.truth and c.family("single", "compound")]
    best = {id(case): heldout_gain((case.oracle or {}).get("fit", {})) for case in asked}
    failed = [case for case in asked if best[id(case)] is None]
    shares = [_gained(case) / gain for case in asked if (gain := best[id(case)]) is not None and gain > LEAST_GAIN]
    return {
        "asked": len(asked),
        "n": len(shares),
        "too_little": len(asked) - len(shares) - len(failed),
        "errors": len(failed),
        "median": median(shares) if shares else None,
    }


def _gained(case: Judged) -> float:
    """What the diagnosis gains on held-out data; 0 when there is none."""
    return heldout_gain((case.said or {}).get("fit", {})) or 0.0
