"""Figures of the names: what was named that is not there, sets, the first three, no answer at all.

Rules of this file: pure. A diagnosis that failed named nothing and gave a wrong answer, not none.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from concealed.classes import alike, exact
from concealed.judged import Judged
from concealed.proportions import mean, rate

FIRST = 3  # names that a reader looks at


def names(cases: Sequence[Judged], known: Iterable[str]) -> dict[str, Any]:
    """Rates that need names; `known`: the names that the one who was asked can say."""
    single = [case for case in cases if case.family("single") and case.truth]
    told = [case for case in cases if case.family("single", "compound", "null", "decoy")]
    answered = [case for case in single if not abstained(case)]
    library = set(known)
    return {
        "spurious": rate(not there(name, case) for case in told for name in case.names),
        "spurious_cases": rate(any(not there(name, case) for name in case.names) for case in told),
        "first_three": rate(_among(case.offered[:FIRST], case.truth) for case in single),
        "abstained": rate(abstained(case) for case in single),
        "right_if_answered": rate(case.right for case in answered),
        "first_name_known": rate(case.right for case in single if _among(library, case.truth)),
        "unknown_named": rate(bool(case.known_names) for case in cases if case.family("unknown")),
    }


def set_f1(cases: Sequence[Judged]) -> dict[str, Any]:
    """Mean F1 of the set of names, over singles and compounds, and over each alone."""
    return {
        family: mean([f1(case) for case in cases if case.family(*family.split("+")) and case.truth])
        for family in ("single+compound", "single", "compound")
    }


def f1(case: Judged) -> float:
    """2 hits/(said + hidden): 1 when exactly the hidden effects were named, 0 when none was."""
    hits = sum(_among(case.names, [name]) for name in case.truth)
    return 2 * hits / (len(case.names) + len(case.truth))


def there(name: str, case: Judged) -> bool:
    """Is it hidden, or of the class of what is hidden in this case?"""
    return any(alike(name, hidden, case.given) for hidden in case.hidden)


def abstained(case: Judged) -> bool:
    """A diagnosis that names nothing: neither an effect of the library nor, by failing, something wrong."""
    return case.said is not None and not case.known_names


def _among(said: Iterable[str], truth: Sequence[str]) -> bool:
    return any(exact(name, true) for name in said for true in truth)
