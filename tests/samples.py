"""Which cases of a test with many run with every change; the others are proofs (`make proof`)."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def sampled(cases: Iterable[Any], kept: Collection[Any]) -> list[Any]:
    """Cases for `parametrize`, all but those that are kept marked as proofs; a tuple has values of several names."""
    found = list(cases)
    assert kept and all(one in found for one in kept), "a case that is not there would be no sample"
    return [one if one in kept else _proof(one) for one in found]


def _proof(case: Any) -> Any:
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.proof)
