"""Figures of a scored run: how often the right thing was said, with the interval that so few cases allow.

Rules of this file: pure; a case is an answer and what was said about it; a rate without cases is None, never 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from scipy.stats import beta

from concealed.effects import alike, exact

CONFIDENCE = 0.95
BINS = (25.0, 50.0, 100.0, 200.0, 400.0)  # nats
ALARMS = ("missing_physics", "unknown_physics")
SILENT = ("consistent", "parameters")  # right for a null; a diagnosis that failed is not
NO_EFFECT = "actuator.torque_gain"  # a base parameter of `entries`: "parameters" is the right verdict
CHANNELS = ("theta_rate", "psi")  # of the held-out gain
LEAST_GAIN = 0.1  # percent points that the oracle must gain for a share of it to mean anything


@dataclass(frozen=True)
class Judged:
    """One case: the sealed answer and what was said."""

    answer: Mapping[str, Any]
    said: Mapping[str, Any] | None  # diagnosis; None when there is none
    seconds: float = 0.0
    oracle: Mapping[str, Any] | None = None

    @property
    def truth(self) -> list[str]:
        """Names of what is hidden."""
        return [effect["name"] for effect in self.answer["effects"] if effect["name"] != NO_EFFECT]

    @property
    def names(self) -> list[str]:
        """Names that were said, strongest first."""
        return [effect["name"] for effect in (self.said or {}).get("effects", [])]

    @property
    def verdict(self) -> str:
        """The verdict, `failed` when there is no diagnosis."""
        return str(self.said["verdict"]) if self.said else "failed"

    @property
    def alarm(self) -> bool:
        """Was physics said to be missing?"""
        return self.verdict in ALARMS

    @property
    def silent(self) -> bool:
        """Was it said that nothing is missing?"""
        return self.verdict in SILENT

    @property
    def nats(self) -> float | None:
        """How visible the first effect is."""
        return self.answer["effects"][0]["nats"] if self.answer["effects"] else None

    def family(self, *names: str) -> bool:
        """Is it one of these families?"""
        return self.answer["family"] in names

    @property
    def right(self) -> bool:
        """The first name is the truth."""
        return bool(self.names) and any(exact(self.names[0], name) for name in self.truth)

    @property
    def in_class(self) -> bool:
        """The first name is of the truth's class."""
        return bool(self.names) and any(alike(self.names[0], name) for name in self.truth)


def rate(cases: Iterable[bool]) -> dict[str, Any]:
    """{"k", "n", "rate", "interval"}: a share and its Clopper-Pearson interval."""
    flags = [bool(case) for case in cases]
    k, n = sum(flags), len(flags)
    return {"k": k, "n": n, "rate": k / n if n else None, "interval": clopper_pearson(k, n)}


def clopper_pearson(k: int, n: int, confidence: float = CONFIDENCE) -> list[float] | None:
    """Exact binomial interval of k hits in n trials."""
    if n == 0:
        return None
    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(1 - tail, k + 1, n - k)) if k < n else 1.0
    return [low, high]


def rates(cases: Sequence[Judged]) -> dict[str, Any]:
    """All rates of missing_physics that need names and verdicts only: baselines have them too."""
    single = [case for case in cases if case.family("single") and case.truth]
    pairs = [case for case in cases if case.family("compound") and len(case.truth) == 2]
    unknown = [case for case in cases if case.family("unknown")]
    return {
        "false_alarms": rate(not case.silent for case in cases if case.family("null", "decoy")),
        "false_alarms_null": rate(not case.silent for case in cases if case.family("null")),
        "false_alarms_decoy": rate(not case.silent for case in cases if case.family("decoy")),
        "gain_is_parameters": rate(case.silent for case in cases if case.family("single") and not case.truth),
        "detected": rate(case.alarm for case in single),
        "first_name": rate(case.right for case in single),
        "first_class": rate(case.in_class for case in single),
        "confounded_class": rate(case.in_class for case in cases if case.family("confounded")),
        "unknown_declared": rate(case.verdict == "unknown_physics" for case in unknown),
        "known_declared_unknown": rate(case.verdict == "unknown_physics" for case in single),
        "pair_both": rate(_named(case) == len(case.truth) for case in pairs),
        "pair_one": rate(_named(case) >= 1 for case in pairs),
        "compound_all": rate(_named(case) == len(case.truth) for case in cases if case.family("compound")),
        "location_slot": rate(_located(case) for case in [*single, *unknown]),
        "failed": rate(case.verdict == "failed" for case in cases),
    }


def _named(case: Judged) -> int:
    """How many of the hidden effects were named."""
    return sum(any(exact(name, said) for said in case.names) for name in case.truth)


def _located(case: Judged) -> bool:
    """Is the slot right? Effects that cannot be told apart share their slots."""
    slot = ((case.said or {}).get("location") or {}).get("slot")
    true = case.answer["effects"][0]
    same = {name.split(".")[0] for name in ("frame.tilt", "camera.angle_offset") if exact(name, true["name"])}
    return slot in {true["slot"], *same}


def power(cases: Sequence[Judged]) -> list[dict[str, Any]]:
    """Detected and named by nats, singles that have nats."""
    single = [case for case in cases if case.family("single") and case.nats is not None]
    rows = []
    for low, high in zip((0.0, *BINS), (*BINS, float("inf")), strict=True):
        inside = [case for case in single if low <= float(case.nats or 0.0) < high]
        label = f"{low:g}-{high:g}" if high < float("inf") else f"{low:g}-"
        rows.append(
            {
                "nats": label,
                "detected": rate(case.alarm for case in inside),
                "first_name": rate(case.right for case in inside),
            }
        )
    return [row for row in rows if row["detected"]["n"]]


def covered(cases: Sequence[Judged]) -> dict[str, Any]:
    """Do the 95 % intervals hold the truth: effects that were named right, and the base's entries."""
    effects = [hit for case in cases for hit in _effect_hits(case)]
    base = [hit for case in cases for hit in _base_hits(case)]
    return {"effects": rate(effects), "base": rate(base)}


def _effect_hits(case: Judged) -> list[bool]:
    return [low <= value <= high for value, _, (low, high) in _compared(case) if low is not None]


def relative_errors(case: Judged) -> list[float]:
    """abs(said - true)/abs(true) of the sized parameters of effects named right."""
    return [abs(said - true) / abs(true) for true, said, _ in _compared(case) if true and said is not None]


def _compared(case: Judged) -> list[tuple[float, float | None, tuple[float, float]]]:
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


def _oriented(true: float, told: Mapping[str, Any], wave: bool) -> tuple[float, float | None, tuple[Any, Any]]:
    """An amplitude beside a phase has no sign of its own."""
    value, (low, high) = told["value"], told.get("ci95") or (None, None)
    if wave and value is not None and value * true < 0:
        return true, -value, (None if high is None else -high, None if low is None else -low)
    return true, value, (low, high)


def _base_hits(case: Judged) -> list[bool]:
    told = ((case.said or {}).get("base") or {}).get("parameters", {})
    wanted = {name: one for name, one in told.items() if name in case.answer["entries"] and one.get("ci95")}
    # a gain of the actuator is seen as L1 and L2
    if not case.family("null", "single") or (case.answer["effects"] and not (case.right and case.truth)):
        return []
    return [one["ci95"][0] <= case.answer["entries"][name] <= one["ci95"][1] for name, one in wanted.items()]


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
    """(E_base_refit - E_tool)/(E_base_refit - E_oracle) on held-out data, median over singles and compounds."""
    shares = []
    for case in cases:
        if not case.oracle or not case.said or not case.truth or not case.family("single", "compound"):
            continue
        tool, best = heldout_gain(case.said.get("fit", {})), heldout_gain(case.oracle.get("fit", {}))
        if tool is not None and best is not None and best > LEAST_GAIN:
            shares.append(tool / best)
    return {"n": len(shares), "median": median(shares) if shares else None}


def by_effect(cases: Sequence[Judged], family: str = "single") -> list[dict[str, Any]]:
    """A row an effect: how often named, of its class, unknown, nothing said."""
    mine = [case for case in cases if case.family(family) and case.answer["effects"]]
    names = sorted({case.answer["effects"][0]["name"] for case in mine})
    return [_row(name, [case for case in mine if case.answer["effects"][0]["name"] == name]) for name in names]


def _row(name: str, cases: Sequence[Judged]) -> dict[str, Any]:
    sizes = [case.nats for case in cases if case.nats is not None]
    errors = [error for case in cases for error in relative_errors(case)]
    others = [case.names[0] for case in cases if case.names and not case.in_class]
    return {
        "effect": name,
        "n": len(cases),
        "named": sum(case.right for case in cases),
        "class": sum(case.in_class for case in cases),
        "unknown": sum(case.verdict == "unknown_physics" for case in cases),
        "nothing": sum(case.silent for case in cases),
        "median_nats": median(sizes) if sizes else None,
        "median_relative_error": median(errors) if errors else None,
        "instead": max(set(others), key=others.count) if others else None,
    }


def summary(cases: Sequence[Judged], rivals: Mapping[str, Sequence[Judged]]) -> dict[str, Any]:
    """Everything, as JSON."""
    seconds = sorted(case.seconds for case in cases if case.said)
    return {
        "cases": len(cases),
        "rates": rates(cases),
        "power": power(cases),
        "coverage": covered(cases),
        "oracle_share": oracle_shares(cases),
        "by_effect": by_effect(cases),
        "by_unknown": by_effect(cases, "unknown"),
        "seconds": {
            "median": median(seconds) if seconds else None,
            "largest": seconds[-1] if seconds else None,
        },
        "baselines": {name: rates(judged) for name, judged in rivals.items()},
        "closed_loop": _split(cases, lambda case: bool(case.answer["flags"]["closed_loop"])),
        "calm": _split(cases, lambda case: float(case.answer["disturbance"]["rms_nm"][0]) < 5e-4),
    }


def _split(cases: Sequence[Judged], wanted: Callable[[Judged], bool]) -> dict[str, Any]:
    part = rates([case for case in cases if wanted(case)])
    return {key: part[key] for key in ("false_alarms", "first_name", "first_class")}
