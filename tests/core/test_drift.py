"""The watch on the innovations: what lasts is told once, noise and pushes are not."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.core.drift import BLOCK_S, BLOCKS, LEARNED_BLOCKS, SETTLE_S, Drift, Level

H = 0.02
# White innovations of the size that the filter expects: either number is 1.
WHITE = dict.fromkeys(("theta", "dtheta", "psi"), Level(1.0, 1.0))
LONG_S = SETTLE_S + (BLOCKS + 2) * BLOCK_S


def white(seconds: float, seed: int = 0, size: float = 1.0) -> NDArray[np.float64]:
    return size * np.random.default_rng(seed).normal(size=(int(seconds / H), 3))


def first_alarm(drift: Drift, surprises: NDArray[np.float64]) -> tuple[float, tuple[str, ...]] | None:
    for k, row in enumerate(surprises):
        if found := drift.watch(k * H, tuple(row.tolist())):
            return k * H, found
    return None


@pytest.mark.parametrize("seed", range(20))
def test_white_innovations_are_no_drift(seed: int) -> None:
    assert first_alarm(Drift(WHITE), white(LONG_S, seed)) is None


def test_a_lasting_error_of_one_channel_is_told_after_half_a_minute() -> None:
    surprises = white(LONG_S)
    surprises[:, 2] += np.sin(np.arange(len(surprises)) * H * 8.0)  # a swing of the ball
    found = first_alarm(Drift(WHITE), surprises)
    assert found is not None and found[1] == ("psi",)
    assert found[0] == pytest.approx(SETTLE_S + BLOCKS * BLOCK_S, abs=2 * H)


def test_more_noise_is_no_other_physics() -> None:
    assert first_alarm(Drift(WHITE), white(LONG_S, size=3.0)) is None


def test_pushes_in_less_than_half_of_the_blocks_are_no_drift() -> None:
    surprises = white(LONG_S)
    for begin in (6.0, 17.0):
        surprises[int(begin / H) : int((begin + 1.0) / H)] += 4.0
    assert first_alarm(Drift(WHITE), surprises) is None


def test_a_level_that_is_not_told_is_learned_from_the_first_minute() -> None:
    minute = SETTLE_S + LEARNED_BLOCKS * BLOCK_S
    calm = white(minute + LONG_S)
    # from the beginning: normal for this rig
    lasting = np.sin(np.arange(len(calm)) * H * 8.0)[:, None]
    assert first_alarm(Drift(), calm + lasting) is None
    late = calm.copy()
    late[int(minute / H) :] += lasting[int(minute / H) :]
    found = first_alarm(Drift(), late)
    assert found is not None and found[0] > minute


def test_a_channel_without_samples_says_nothing() -> None:
    surprises = white(LONG_S)
    surprises[:, 2] = nan
    assert first_alarm(Drift(WHITE), surprises) is None


def test_what_came_before_a_pause_does_not_fill_a_block() -> None:
    drift = Drift(WHITE)
    for k in range(int((SETTLE_S + BLOCK_S - 1.0) / H)):
        drift.watch(k * H, (5.0, 5.0, 5.0))
    drift.pause()
    start = SETTLE_S + BLOCK_S
    for k, row in enumerate(white(LONG_S)):
        assert drift.watch(start + k * H, tuple(row.tolist())) == ()


def watched(drift: Drift, surprises: NDArray[np.float64], start: float) -> float:
    for k, row in enumerate(surprises):
        drift.watch(start + k * H, tuple(row.tolist()))
    return start + len(surprises) * H


def test_half_a_level_of_the_run_before_is_not_learned_from() -> None:
    drift = Drift()
    t = watched(drift, white(SETTLE_S + (LEARNED_BLOCKS // 2 + 0.5) * BLOCK_S, size=4.0), 0.0)
    drift.pause()
    drift.reset()
    t = watched(drift, white(SETTLE_S + (LEARNED_BLOCKS - 0.5) * BLOCK_S), t + 1.0)
    assert drift.level("psi") is None
    watched(drift, white(BLOCK_S), t)
    level = drift.level("psi")
    assert level is not None and level.all == pytest.approx(1.0, rel=0.1)


def test_a_learned_level_outlives_the_run_and_its_last_blocks_do_not() -> None:
    drift = Drift()
    t = watched(drift, white(SETTLE_S + (LEARNED_BLOCKS + 0.5) * BLOCK_S), 0.0)
    level = drift.level("psi")
    lasting = white((BLOCKS + 0.5) * BLOCK_S) + np.sin(np.arange(int((BLOCKS + 0.5) * BLOCK_S / H)) * H * 8.0)[:, None]
    t = watched(drift, lasting, t)
    assert drift.drifted()
    drift.pause()
    drift.reset()
    assert drift.level("psi") == level and drift.latest() == {} and not drift.drifted()
    assert watched(drift, white(LONG_S), t + 1.0) > t and not drift.drifted()
