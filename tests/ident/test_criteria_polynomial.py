"""The criteria of the polynomial models on a few seeds; rates over many belong to the benchmark."""

from __future__ import annotations

import pytest
from harness.identcriteria import optima, polynomial
from harness.identcriteria.judged import Criterion

SEEDS = (0, 1)


@pytest.mark.parametrize("criterion", (*polynomial.FUNCTIONS, *optima.FUNCTIONS), ids=lambda one: one.__name__)
def test_criterion(criterion: Criterion) -> None:
    for seed in SEEDS:
        found = criterion(seed)
        assert found["passed"], (seed, found)


def test_all_criteria_are_asked() -> None:
    for module in (polynomial, optima):
        named = {name for name in vars(module) if name.startswith(("criterion_", "bar_"))}
        assert named == {one.__name__ for one in module.FUNCTIONS}
