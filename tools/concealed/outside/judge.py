"""What was said of physics outside the library: is it called unknown or given a formula at the right place, what of the
oracle's gain is kept, and is a name of the library said that is wrong.

Rules of this file: pure; a name of the library that is said without a probability is said with certainty; a diagnosis
that failed found nothing and kept nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import Any

from concealed.coverage import heldout_gain
from concealed.effects import SINGLES
from concealed.judged import NAMELESS, Judged
from concealed.proportions import rate

# The table's names; the last four are no cases of the proof, but names that can be said.
LIBRARY = frozenset((*SINGLES, "actuator.lost_commands", "ball.lift_off", "ball.inner_hoop", "encoder.harmonic"))
SURE = 0.5  # probability beyond which a name is taken for said
GAINS, GAINS_LITTLE = 1.0, 0.1  # percent points that the oracle must gain on held-out data for its share to count
KEPT = 0.8  # share of the oracle's gain
TELLABLE = 10.0  # nats that the nearest name of the library leaves: below, a recording does not tell the two apart
BINS = (0.0, 15.0, 45.0, 134.0)  # nats, the last one open
FAMILY = "outside"


def effects(case: Judged) -> list[Mapping[str, Any]]:
    """Findings of a case."""
    return list((case.said or {}).get("effects", []))


def open_ones(case: Judged) -> list[Mapping[str, Any]]:
    """Findings that are no name of the library: unknown, or a mechanism with a name made of its parts."""
    return [effect for effect in effects(case) if effect["name"] not in LIBRARY]


def slot_of(effect: Mapping[str, Any]) -> str:
    """Where a finding is said to sit: `unknown.SLOT` and `SLOT.SHAPE_of_VARIABLE` say it."""
    name = str(effect["name"])
    return name.removeprefix(NAMELESS) if name.startswith(NAMELESS) else name.split(".", maxsplit=1)[0]


def found(case: Judged) -> bool:
    """An open finding sits at the right slot."""
    return any(slot_of(effect) in _slots(case) for effect in open_ones(case))


def formula(case: Judged) -> bool:
    """An open finding at the right slot has a formula."""
    return any(slot_of(effect) in _slots(case) and bool(effect.get("formula")) for effect in open_ones(case))


def sure_names(case: Judged) -> list[str]:
    """Names of the library that were said with a probability above one half, or with none beside them."""
    told = [effect for effect in effects(case) if effect["name"] in LIBRARY]
    return [str(effect["name"]) for effect in told if _probability(effect) > SURE]


def _probability(effect: Mapping[str, Any]) -> float:
    told = effect.get("probability")
    return 1.0 if told is None else float(told)


def _slots(case: Judged) -> Sequence[str]:
    return list(case.answer["effects"][0]["law"]["slots"])


def oracle_gain(case: Judged) -> float | None:
    """Percent points that the oracle gains on held-out data; None without one."""
    return heldout_gain((case.oracle or {}).get("fit", {}))


def gained(case: Judged) -> float:
    """Percent points that the diagnosis gains there."""
    return heldout_gain((case.said or {}).get("fit", {})) or 0.0


def share(case: Judged, least: float = GAINS) -> float | None:
    """Part of the oracle's gain that is kept; None where there are no `least` percent points to keep."""
    gain = oracle_gain(case)
    return gained(case) / gain if gain is not None and gain > least else None


def left_nats(case: Judged) -> float | None:
    """Nats that the nearest name of the library leaves."""
    nearest = (case.oracle or {}).get("nearest")
    return None if nearest is None else float(nearest["left_nats"])


def summary(cases: Iterable[Judged]) -> dict[str, Any]:
    """Rates, and tables by kind and by nats."""
    mine = [case for case in cases if case.family(FAMILY)]
    shares = [kept for case in mine if (kept := share(case)) is not None]
    return {
        "n": len(mine),
        "rates": _rates(mine),
        "share": {"n": len(shares), "median": median(shares) if shares else None},
        "by_kind": [
            _row(name, [c for c in mine if c.hidden[0] == name]) for name in sorted({c.hidden[0] for c in mine})
        ],
        "by_nats": _by_nats(mine),
    }


def _rates(mine: Sequence[Judged]) -> dict[str, Any]:
    told = [case for case in mine if (left_nats(case) or 0.0) >= TELLABLE]
    remembers = [case for case in mine if case.answer["effects"][0]["law"]["memory"]]
    named = [effect for case in mine for effect in effects(case)]
    return {
        "found": rate(found(case) for case in mine),
        "found_tellable": rate(found(case) for case in told),
        "found_memory": rate(found(case) for case in remembers),
        "found_anywhere": rate(bool(open_ones(case)) for case in mine),
        "formula": rate(formula(case) for case in mine),
        "kept": rate(kept >= KEPT for case in mine if (kept := share(case)) is not None),
        "kept_little": rate(kept >= KEPT for case in mine if (kept := share(case, GAINS_LITTLE)) is not None),
        "sure_wrong": rate(bool(sure_names(case)) for case in mine),
        "sure_wrong_tellable": rate(bool(sure_names(case)) for case in told),
        "named": rate(bool(case.known_names) and any(name in LIBRARY for name in case.names) for case in mine),
        "silent": rate(case.silent for case in mine),
        "worse": rate(gained(case) < 0 for case in mine if effects(case)),
        "without_probability": rate(effect.get("probability") is None for effect in named),
        "failed": rate(case.said is None for case in mine),
    }


def _by_nats(mine: Sequence[Judged]) -> list[dict[str, Any]]:
    rows = []
    for low, high in zip(BINS, (*BINS[1:], float("inf")), strict=True):
        inside = [case for case in mine if low <= float(case.nats or 0.0) < high]
        rows.append(
            {
                "nats": f"{low:g}-{high:g}" if high < float("inf") else f"{low:g}-",
                "found": rate(found(case) for case in inside),
                "sure_wrong": rate(bool(sure_names(case)) for case in inside),
                "silent": rate(case.silent for case in inside),
            }
        )
    return [row for row in rows if row["found"]["n"]]


def _row(name: str, cases: Sequence[Judged]) -> dict[str, Any]:
    law = cases[0].answer["effects"][0]["law"]
    said = [each for case in cases for each in case.names]
    return {
        "kind": name,
        "slot": law["slots"][0],
        "memory": bool(law["memory"]),
        "n": len(cases),
        "found": sum(found(case) for case in cases),
        "formula": sum(formula(case) for case in cases),
        "sure_wrong": sum(bool(sure_names(case)) for case in cases),
        "silent": sum(case.silent for case in cases),
        "median_nats": _middle([case.nats for case in cases]),
        "median_left": _middle([left_nats(case) for case in cases]),
        "median_oracle_gain": _middle([oracle_gain(case) for case in cases]),
        "median_gain": _middle([gained(case) for case in cases]),
        "said": sorted(set(said), key=lambda each: (-said.count(each), each)),
    }


def _middle(values: Iterable[float | None]) -> float | None:
    there = [value for value in values if value is not None]
    return median(there) if there else None
