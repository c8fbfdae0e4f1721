"""The criteria of the polynomial models on a few seeds; rates over many belong to the benchmark."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "tools" / "bench"))

from identcriteria import polynomial

SEEDS = (0, 1)


@pytest.mark.parametrize("criterion", polynomial.FUNCTIONS, ids=lambda one: one.__name__)
def test_criterion(criterion: polynomial.Criterion) -> None:
    for seed in SEEDS:
        found = criterion(seed)
        assert found["passed"], (seed, found)


def test_all_criteria_are_asked() -> None:
    named = {name for name in vars(polynomial) if name.startswith(("criterion_", "bar_"))}
    assert named == {one.__name__ for one in polynomial.FUNCTIONS}
