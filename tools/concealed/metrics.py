"""Figures of a scored run: how often the right thing was said.

Rules of this file: pure; a case is an answer and what was said about it; a rate without cases is None, never 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import median
from typing import Any

from concealed.classes import alike, exact
from concealed.coverage import covered, oracle_shares, relative_errors
from concealed.effects import SINGLES
from concealed.judged import Judged
from concealed.naming import names, set_f1
from concealed.outside import judge
from concealed.proportions import rate

BINS = (25.0, 50.0, 100.0, 200.0, 400.0)  # nats


def rates(cases: Sequence[Judged], known: Iterable[str] = SINGLES) -> dict[str, Any]:
    """All rates of missing_physics that need names and verdicts only: baselines, which know fewer names, have them
    too."""
    single = [case for case in cases if case.family("single") and case.truth]
    unknown = [case for case in cases if case.family("unknown")]
    return {
        "false_alarms": rate(not case.silent for case in cases if case.family("null", "decoy")),
        "false_alarms_null": rate(not case.silent for case in cases if case.family("null")),
        "false_alarms_decoy": rate(not case.silent for case in cases if case.family("decoy")),
        "gain_is_parameters": rate(case.silent for case in cases if case.family("single") and not case.truth),
        "detected": rate(case.alarm for case in single),
        "first_name": rate(case.right for case in single),
        "first_class": rate(case.in_class for case in single),
        "first_wide_class": rate(case.in_wide_class for case in single),
        "confounded_class": rate(case.in_class for case in cases if case.family("confounded")),
        "confounded_wide_class": rate(case.in_wide_class for case in cases if case.family("confounded")),
        "unknown_declared": rate(case.verdict == "unknown_physics" for case in unknown),
        "known_declared_unknown": rate(case.verdict == "unknown_physics" for case in single),
        "location_slot": rate(_located(case) for case in [*single, *unknown]),
        **_compounds(cases),
        **_left_out(cases),
        **names(cases, known),
        "failed": rate(case.verdict == "failed" for case in cases),
    }


def _compounds(cases: Sequence[Judged]) -> dict[str, Any]:
    compounds = [case for case in cases if case.family("compound")]
    pairs = [case for case in compounds if len(case.truth) == 2]
    return {
        "pair_both": rate(_named(case) == len(case.truth) for case in pairs),
        "pair_one": rate(_named(case) >= 1 for case in pairs),
        "compound_all": rate(_named(case) == len(case.truth) for case in compounds),
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


def _left_out(cases: Sequence[Judged]) -> dict[str, Any]:
    """Effects that the library lacked: unknown is right, or a name of their class that it still had."""
    mine = [case for case in cases if case.family("left_out")]
    return {
        "left_out_declared": rate(_stranger(case) for case in mine),
        "left_out_alone": rate(_stranger(case) and not _misnamed(case) for case in mine),
        "left_out_slot": rate(_located(case) or case.in_class for case in mine),
    }


def _stranger(case: Judged) -> bool:
    """Was it said to be unknown, or called by the name of a partner that remained?"""
    return case.verdict == "unknown_physics" or case.in_class


def _misnamed(case: Judged) -> bool:
    """Was something named that is not of its class?"""
    return any(not alike(name, true, case.given) for name in case.known_names for true in case.truth)


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


def by_effect(cases: Sequence[Judged], family: str = "single") -> list[dict[str, Any]]:
    """A row an effect: how often named, of its class, unknown, nothing said."""
    mine = [case for case in cases if case.family(family) and case.answer["effects"]]
    found = sorted({case.hidden[0] for case in mine})
    return [_row(name, [case for case in mine if case.hidden[0] == name]) for name in found]


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
        "instead": max(sorted(set(others)), key=others.count) if others else None,
    }


def summary(
    cases: Sequence[Judged], rivals: Mapping[str, Sequence[Judged]], known: Mapping[str, Iterable[str]] | None = None
) -> dict[str, Any]:
    """Everything, as JSON; `known`: the names that each rival can say, none where it is not told."""
    seconds = sorted(case.seconds for case in cases if case.said)
    return {
        "cases": len(cases),
        "rates": rates(cases),
        "power": power(cases),
        "coverage": covered(cases),
        "set_f1": set_f1(cases),
        "oracle_share": oracle_shares(cases),
        "by_effect": by_effect(cases),
        "by_unknown": by_effect(cases, "unknown"),
        "by_left_out": by_effect(cases, "left_out"),
        "outside": judge.summary(cases),
        "seconds": {
            "median": median(seconds) if seconds else None,
            "largest": seconds[-1] if seconds else None,
        },
        "baselines": {name: rates(judged, (known or {}).get(name, ())) for name, judged in rivals.items()},
        "closed_loop": _split(cases, lambda case: bool(case.answer["flags"]["closed_loop"])),
        "calm": _split(cases, lambda case: float(case.answer["disturbance"]["rms_nm"][0]) < 5e-4),
    }


def _split(cases: Sequence[Judged], wanted: Callable[[Judged], bool]) -> dict[str, Any]:
    part = rates([case for case in cases if wanted(case)])
    return {key: part[key] for key in ("false_alarms", "first_name", "first_class")}
