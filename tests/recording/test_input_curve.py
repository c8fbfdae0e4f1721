"""Inputs between their rows: held, straight or smooth, as stairs that are as fine as the curve asks for."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.recording.input_curve import MOST_LEFT, STAIRS, InputCurve

ROWS = 0.04 * np.arange(400)


def force(t: np.ndarray, hz: float) -> np.ndarray:
    return np.asarray(np.sin(2 * np.pi * hz * t) + 0.4 * np.cos(2 * np.pi * 0.61 * hz * t))


def stairs(hold: str, hz: float, scale: float = 1.0, clock: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    rows = clock * ROWS
    curve = InputCurve(rows, scale * force(ROWS, hz), hold)
    t = np.sort(np.append(rows, curve.corners))
    return t, curve.between(t)


def left(hold: str, hz: float) -> float:
    """Spread of what is between the stairs and the force itself, over the force's."""
    t, u = stairs(hold, hz)
    fine = np.linspace(ROWS[5], ROWS[-5], 20_001)
    held = u[np.searchsorted(t, fine, side="right") - 1]
    return float((held - force(fine, hz)).std() / force(ROWS, hz).std())


def test_what_is_held_has_no_corners() -> None:
    t, u = stairs("zero", 3.0)
    assert np.array_equal(t, ROWS)
    assert np.array_equal(u, force(ROWS, 3.0)[:-1])


def test_a_smooth_input_is_followed_where_a_straight_one_lacks_what_is_fast() -> None:
    assert left("smooth", 0.2) < MOST_LEFT and left("linear", 0.2) < MOST_LEFT
    assert left("smooth", 5.0) < 0.6 * left("linear", 5.0) < 0.3 * left("zero", 5.0)


def test_stairs_are_as_many_as_the_curve_asks_for_whatever_its_units() -> None:
    counts = [(len(stairs("smooth", hz)[0]) - 1) // (len(ROWS) - 1) for hz in (0.05, 1.0, 2.0, 8.0)]
    assert counts == sorted(counts) and counts[0] == STAIRS[0] and counts[-1] == STAIRS[-1]
    plain, other = stairs("smooth", 2.0), stairs("smooth", 2.0, scale=1000.0, clock=3600.0)
    assert other[0] == pytest.approx(3600.0 * plain[0])
    assert other[1] == pytest.approx(1000.0 * plain[1])


def missed(rates: np.ndarray, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Of an input that swings at these rates (of the rows'): spread of the integral of what its curve misses, and of
    the integral of that; what is told of both."""
    random, fine = np.random.default_rng(seed), np.linspace(0.0, ROWS[-1], 399 * 32 + 1)
    phases, w = random.uniform(0, 2 * np.pi, len(rates)), 2 * np.pi * rates / 0.04
    curve = InputCurve(ROWS, np.sin(np.outer(ROWS, w) + phases).sum(axis=1), "smooth")
    # the swings' own integrals, and those of the curve, both without the line that joins their ends
    once = -(np.cos(np.outer(fine, w) + phases) / w).sum(axis=1) - integral(curve.between(fine), fine)
    once -= once.mean()
    twice = integral((once[1:] + once[:-1]) / 2.0, fine)
    inner = slice(32 * 20, -32 * 20)
    told = np.sqrt(np.mean(curve.unresolved(ROWS) ** 2, axis=0))
    return np.array([once[inner].std(), twice[inner].std()]), told


def integral(values: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(values * np.diff(t))])


def test_what_a_curve_misses_of_fast_swings_is_told_in_size() -> None:
    swings, told = missed(np.linspace(0.4, 0.6, 31))
    assert np.all(told > 0.6 * swings) and np.all(told < 2.0 * swings)


def test_of_what_is_slow_no_less_is_told_than_missed() -> None:
    swings, told = missed(np.linspace(0.02, 0.1, 9))
    assert np.all(swings < told)
    # a bend at a tenth of the rows' rate alternates by sin^2(pi/10) of itself
    assert told[1] < 0.1 * missed(np.linspace(0.4, 0.6, 9))[1][1]


def test_of_what_is_held_or_made_straight_all_is_known() -> None:
    for hold in ("zero", "linear"):
        assert not InputCurve(ROWS, force(ROWS, 8.0), hold).unresolved(ROWS).any()
    assert not InputCurve(ROWS, np.full(400, 3.0), "smooth").unresolved(ROWS).any()
    assert not InputCurve(ROWS[:2], np.array([1.0, 2.0]), "smooth").unresolved(ROWS[:2]).any()


@pytest.mark.parametrize("hold", ["linear", "smooth"])
def test_means_keep_the_impulse_and_the_ends_their_values(hold: str) -> None:
    curve = InputCurve(ROWS, force(ROWS, 1.0), hold)
    fine, coarse = np.linspace(0.0, ROWS[-1], 399 * 64 + 1), np.sort(np.append(ROWS, curve.corners))
    impulse = float(curve.between(fine) @ np.diff(fine))
    assert float(curve.between(coarse) @ np.diff(coarse)) == pytest.approx(impulse, abs=1e-9)
    assert curve.between(ROWS[-1] + np.array([0.01, 0.02])) == pytest.approx(force(ROWS, 1.0)[-1:])
