"""Feed-forward: in its region, within its limit, never a number that is none."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from hoopd.core.feedforward import WANTED, Bound, FeedForward, FeedForwardPart

X = np.array([0.0, 2.0, 0.1, 0.0])


def adding(*torques_nm: float, regions: tuple[tuple[Bound, ...], ...] = (), limit_nm: float = 1.0) -> FeedForward:
    """One part for each torque that is added while the part acts."""
    given = regions or tuple(() for _ in torques_nm)
    return FeedForward(
        [FeedForwardPart(f"part {index}", region) for index, region in enumerate(given)],
        lambda x, wanted, acting: wanted + float(np.dot(torques_nm, acting)),
        limit_nm,
    )


def test_nothing_known_changes_no_bit() -> None:
    assert FeedForward().demand(X, 0.1) == 0.1
    assert np.signbit(FeedForward().demand(X, -0.0))


@pytest.mark.parametrize(
    ("bound", "acts"),
    [(Bound(1, -3.0, 3.0), True), (Bound(1, 3.0, 5.0), False), (Bound(WANTED, -0.05, 0.05), False)],
)
def test_a_part_rests_outside_of_its_region(bound: Bound, acts: bool) -> None:
    forward = adding(0.01, 0.1, regions=((bound,), ()))
    assert forward.demand(X, 0.1) == pytest.approx(0.21 if acts else 0.2)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_it_stays_within_its_limit(sign: float) -> None:
    assert adding(sign * 5.0, limit_nm=0.3).demand(X, 0.1) == pytest.approx(0.1 + sign * 0.3)


@pytest.mark.parametrize("bad", [nan, inf, -inf])
def test_what_is_no_number_is_not_added(bad: float) -> None:
    assert adding(bad, limit_nm=0.3).demand(X, 0.1) == 0.1


@pytest.mark.parametrize("error", [RuntimeError("casadi"), ZeroDivisionError(), IndexError()])
def test_a_failure_adds_nothing_and_says_why(error: Exception) -> None:
    def fails(x: object, wanted: float, acting: object) -> float:
        raise error

    forward = FeedForward([FeedForwardPart("part")], fails, 0.3)
    assert forward.demand(X, 0.1) == 0.1
    assert type(error).__name__ in forward.trouble


def test_trouble_is_over_when_it_works_again() -> None:
    torques = iter([nan, 0.12])
    forward = FeedForward([FeedForwardPart("part")], lambda x, wanted, acting: next(torques), 0.3)
    assert forward.demand(X, 0.1) == 0.1
    assert "finite" in forward.trouble
    assert forward.demand(X, 0.1) == pytest.approx(0.12)
    assert forward.trouble == ""


def test_a_negative_limit_is_refused() -> None:
    with pytest.raises(ValueError, match="negative"):
        FeedForward(limit_nm=-0.1)
