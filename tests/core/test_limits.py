"""The last limiter."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings, strategies as st

from hoopd.core.limits import Limiter


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=30), st.floats(0.01, 2.0))
@settings(max_examples=200, deadline=None)
def test_nothing_beyond_the_limits_ever_passes(wishes: list[float], slew: float) -> None:
    limiter, last = Limiter(0.7, slew), 0.0
    for wish in wishes:
        torque = limiter.apply(wish)
        assert abs(torque) <= 0.7
        assert limiter.refused == (not math.isfinite(wish))
        if limiter.refused:
            assert torque == 0.0
        else:
            assert abs(torque - last) <= slew * (1 + 1e-12)
            assert limiter.limited == (torque != wish)
        last = torque


def test_permitted_torque_passes_unchanged_and_the_limit_is_exact() -> None:
    limiter = Limiter(0.7, 1.4)
    assert limiter.apply(0.123456789) == 0.123456789
    assert limiter.apply(99.0) == 0.7
    assert limiter.apply(-99.0) == -0.7


def test_reset_starts_from_zero() -> None:
    limiter = Limiter(0.7, 0.1)
    for _ in range(5):
        limiter.apply(0.5)
    limiter.reset()
    assert limiter.apply(0.5) == pytest.approx(0.1)


@pytest.mark.parametrize(("torque", "slew"), [(-1.0, 1.0), (math.nan, 1.0), (0.7, 0.0), (0.7, math.nan)])
def test_limits_that_are_none_are_refused(torque: float, slew: float) -> None:
    with pytest.raises(ValueError, match="limit"):
        Limiter(torque, slew)
