"""Shares with the intervals that so few cases allow.

Rules of this file: pure; a share without cases is None, never 0; what is drawn has a fixed seed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.stats import beta

CONFIDENCE = 0.95
DRAWS = 4000  # of the bootstrap: its ends are then good to half a percent point


def rate(cases: Iterable[bool]) -> dict[str, Any]:
    """{"k", "n", "rate", "interval"}: a share of independent cases and its Clopper-Pearson interval."""
    flags = [bool(case) for case in cases]
    k, n = sum(flags), len(flags)
    return {"k": k, "n": n, "rate": k / n if n else None, "interval": clopper_pearson(k, n)}


def shown(cases: Iterable[bool]) -> str:
    """A share as text with its interval: 3/4 (19 to 99 %); a dash without cases."""
    told = rate(cases)
    if told["interval"] is None:
        return "-"
    low, high = (100 * one for one in told["interval"])
    return f"{told['k']}/{told['n']} ({low:.0f} to {high:.0f} %)"


def clopper_pearson(k: int, n: int, confidence: float = CONFIDENCE) -> list[float] | None:
    """Exact binomial interval of k hits in n trials."""
    if n == 0:
        return None
    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, k, n - k + 1)) if k else 0.0
    high = float(beta.ppf(1 - tail, k + 1, n - k)) if k < n else 1.0
    return [low, high]


def by_case(groups: Sequence[Sequence[bool]]) -> dict[str, Any]:
    """A share of flags that are not independent within a case: the interval takes whole cases ("cases") as units."""
    own = [group for group in groups if group]
    k, n = np.array([sum(group) for group in own]), np.array([len(group) for group in own])
    total, hits = int(n.sum()), int(k.sum())
    return {
        "k": hits,
        "n": total,
        "cases": len(own),
        "rate": hits / total if total else None,
        "interval": _of_cases(k, n) if total else None,
    }


def mean(values: Sequence[float]) -> dict[str, Any]:
    """{"n", "mean", "interval"} of a figure between 0 and 1 that each case has."""
    if not values:
        return {"n": 0, "mean": None, "interval": None}
    found = np.array(values, dtype=float)
    return {"n": len(found), "mean": float(found.mean()), "interval": _of_cases(found, np.ones(len(found)))}


def _of_cases(k: np.ndarray, n: np.ndarray) -> list[float]:
    """Percentiles of sum k/sum n over cases drawn with replacement; k, n (C,)."""
    if _one_sided(k, n):
        # no spread to draw from: the case is the unit
        return clopper_pearson(round(float((k / n).sum())), len(k)) or [0.0, 1.0]
    drawn = np.random.default_rng(0).integers(len(k), size=(DRAWS, len(k)))
    shares = k[drawn].sum(1) / n[drawn].sum(1)
    tail = (1 - CONFIDENCE) / 2
    return [float(np.quantile(shares, tail)), float(np.quantile(shares, 1 - tail))]


def _one_sided(k: np.ndarray, n: np.ndarray) -> bool:
    """All cases are entirely hit, or all entirely missed."""
    return bool(np.all(k == n) or np.all(k == 0))
