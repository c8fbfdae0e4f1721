"""Whether probabilities that were told are kept: bins of equal count, what was right in each, and the error.

A finding is right when its name is of the class of what is hidden in the case; one that is no name of the library when
the hidden thing is none either and sits at its slot. Candidates that were not found count with their own name alone;
"parameters" is right where nothing is hidden, "none of these" where what is hidden has no name and got no formula.

Rules of this file: pure; what is told with less than LEAST is no statement; what is drawn has a fixed seed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from concealed.classes import alike, exact
from concealed.judged import Judged
from concealed.outside.judge import LIBRARY, effects, slot_of
from concealed.proportions import rate

NONE, PARAMETERS = "none of these", "parameters"
LEAST = 0.01
BINS, DRAWS = 10, 2000


def statements(case: Judged) -> Iterator[tuple[float, bool]]:
    """(probability, right) of everything that was told of a case."""
    found = effects(case)
    yield from ((float(one["probability"]), _right(case, one)) for one in found if _told(one))
    names = {one["name"] for one in found}
    for one in (case.said or {}).get("candidates", []):
        name = str(one["name"])
        known = name in LIBRARY or name in (NONE, PARAMETERS)
        if known and _told(one) and name not in names and not any(alike(name, other, case.given) for other in names):
            yield float(one["probability"]), _candidate_right(case, name)


def _told(one: Any) -> bool:
    return one.get("probability") is not None and float(one["probability"]) >= LEAST


def _right(case: Judged, effect: Any) -> bool:
    name = str(effect["name"])
    if name in LIBRARY:
        return any(alike(name, true, case.given) for true in case.truth)
    return any(slot_of(effect) in slots for slots in _strange(case))


def _candidate_right(case: Judged, name: str) -> bool:
    if name == PARAMETERS:
        return not case.truth
    if name == NONE:
        formulas = [one for one in effects(case) if one["name"] not in LIBRARY and not _nameless(one)]
        return bool(_strange(case)) and not any(_right(case, one) for one in formulas)
    return any(exact(name, true) for true in case.truth)


def _nameless(effect: Any) -> bool:
    return str(effect["name"]).startswith("unknown.")


def _strange(case: Judged) -> list[Sequence[str]]:
    """Slots of what is hidden and is no name of the library, or of one that the library was made to lack."""
    lacking = case.family("left_out")
    hidden = [one for one in case.answer["effects"] if lacking or one["name"] not in LIBRARY]
    return [list((one.get("law") or {}).get("slots") or [one["slot"]]) for one in hidden]


def reliability(cases: Iterable[Judged], bins: int = BINS) -> dict[str, Any]:
    """{"n", "bins", "error", "by_chance"}: mean probability and share of right ones in bins of equal count.

    `error`: mean distance of the two, weighted by count; `by_chance`: what probabilities that are kept exactly reach on
    average, and in 95 of 100 runs.
    """
    told = sorted((one for case in cases for one in statements(case)), key=lambda one: one[0])
    p, right = np.array([one[0] for one in told]), np.array([one[1] for one in told], dtype=bool)
    if not told:
        return {"n": 0, "bins": [], "error": None, "by_chance": None}
    parts = [one for one in np.array_split(np.arange(len(p)), bins) if len(one)]
    rows = [{"mean": float(p[i].mean()), **rate(right[i])} for i in parts]
    drawn = np.random.default_rng(0).random((DRAWS, len(p))) < p
    chance = sum(len(i) * np.abs(drawn[:, i].mean(axis=1) - p[i].mean()) for i in parts) / len(p)
    return {
        "n": len(p),
        "bins": rows,
        "error": float(sum(row["n"] * abs(row["rate"] - row["mean"]) for row in rows) / len(p)),
        "by_chance": [float(chance.mean()), float(np.quantile(chance, 0.95))],
    }


def markdown(found: dict[str, Any]) -> str:
    """The bins as a table, and the error beneath."""
    if not found["n"]:
        return "no probabilities were told\n"
    lines = ["| told | right | of | share | 95 % |", "|---|---|---|---|---|"]
    for row in found["bins"]:
        low, high = row["interval"]
        lines.append(f"| {row['mean']:.3f} | {row['k']} | {row['n']} | {row['rate']:.3f} | {low:.3f} to {high:.3f} |")
    mean, most = found["by_chance"]
    kept = f"probabilities that are kept exactly: {mean:.3f}, in 95 % of runs at most {most:.3f}"
    lines += ["", f"{found['n']} probabilities, error {found['error']:.3f} ({kept})"]
    return "\n".join(lines) + "\n"
