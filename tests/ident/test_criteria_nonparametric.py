"""The criteria of data handling, spectra, fits over frequency, bases and inputs, on two seeds each."""

from __future__ import annotations

import pytest
from harness.identcriteria import nonparametric as criteria

NAMES = sorted(name for name in vars(criteria) if name.startswith("criterion_"))


@pytest.mark.parametrize("seed", [101, 102])
@pytest.mark.parametrize("name", NAMES)
def test_a_criterion_holds(name: str, seed: int) -> None:
    found = getattr(criteria, name)(seed)
    verdicts = {key: value for key, value in found.items() if isinstance(value, bool)}
    assert verdicts and all(verdicts.values()), found


def test_the_criteria_are_those_of_this_area() -> None:
    assert [int(name[-2:]) for name in NAMES] == [38, 39, 40, 42, 43, 44, 45, 46, 47, 48]
