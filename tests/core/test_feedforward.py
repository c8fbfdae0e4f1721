"""Feed-forward: in its region, within its limit, never a number that is none."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from hoopd.core.feedforward import WANTED, Bound, FeedForward, Part

X = np.array([0.0, 2.0, 0.1, 0.0])


def adds(torque_nm: float, *region: Bound, name: str = "one") -> Part:
    return Part(name, lambda x, wanted: wanted + torque_nm, region)


def test_nothing_known_changes_no_bit() -> None:
    assert FeedForward().demand(X, 0.1) == 0.1
    assert np.signbit(FeedForward().demand(X, -0.0))


def test_parts_act_one_after_the_other() -> None:
    twice = Part("twice", lambda x, wanted: 2.0 * wanted)
    assert FeedForward([adds(0.01), twice], 1.0).demand(X, 0.1) == pytest.approx(0.22)
    assert FeedForward([twice, adds(0.01)], 1.0).demand(X, 0.1) == pytest.approx(0.21)


@pytest.mark.parametrize(
    ("bound", "acts"),
    [(Bound(1, -3.0, 3.0), True), (Bound(1, 3.0, 5.0), False), (Bound(WANTED, -0.05, 0.05), False)],
)
def test_a_part_rests_outside_of_its_region(bound: Bound, acts: bool) -> None:
    assert FeedForward([adds(0.01, bound)], 1.0).demand(X, 0.1) == pytest.approx(0.11 if acts else 0.1)


def test_the_region_asks_for_the_laws_own_torque() -> None:
    near = adds(0.01, Bound(WANTED, 0.0, 0.15))
    assert FeedForward([adds(0.1), near], 1.0).demand(X, 0.1) == pytest.approx(0.21)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_it_stays_within_its_limit(sign: float) -> None:
    assert FeedForward([adds(sign * 5.0)], 0.3).demand(X, 0.1) == pytest.approx(0.1 + sign * 0.3)


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_what_is_no_number_is_not_added(bad: float) -> None:
    assert FeedForward([adds(bad)], 0.3).demand(X, 0.1) == 0.1


def test_a_negative_limit_is_refused() -> None:
    with pytest.raises(ValueError, match="negative"):
        FeedForward([], -0.1)
