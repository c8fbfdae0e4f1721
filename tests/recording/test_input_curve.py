"""Inputs between their rows: held, straight or smooth, as stairs that are as fine as the curve asks for."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.recording.input_curve import MOST_LEFT, STAIRS, InputCurve, deaveraged

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


def test_what_was_averaged_has_its_rows_as_means() -> None:
    """No impulse is lost where a force changes fast; a curve through the means loses some."""
    u = np.where((ROWS > 4.0) & (ROWS < 4.5), 10.0, 1.0) + force(ROWS, 3.0)
    ends = (ROWS[1:] + ROWS[:-1]) / 2.0
    assert InputCurve(ROWS, u, "mean").between(ends) == pytest.approx(u[1:-1], abs=1e-9)
    assert np.abs(InputCurve(ROWS, u, "smooth").between(ends) - u[1:-1]).max() > 0.2
    # rows that are missing leave the other means what they are
    seen = np.abs(np.arange(len(ROWS)) - 200.5) > 2.0
    holed = InputCurve(ROWS[seen], u[seen], "mean")
    means = [float(holed.between(np.array([t - 0.02, t + 0.02]))[0]) for t in ROWS[seen][1:-1]]
    assert means == pytest.approx(u[seen][1:-1], abs=1e-9)
    both = (InputCurve(ROWS, u, hold).unresolved(ROWS) for hold in ("smooth", "mean"))
    assert np.array_equal(*both)
    # a part of an interval has its part of the variance
    fine = np.linspace(0.0, ROWS[-1], 399 * 4 + 1)
    whole, parts = (InputCurve(ROWS, u, "mean").unresolved(t)[:, 1] for t in (ROWS, fine))
    assert (parts.reshape(-1, 4) ** 2).sum(axis=1) == pytest.approx(whole**2)


def test_means_are_led_back_to_instants_by_their_own_bend() -> None:
    t, means = np.sort(ROWS + 0.002 * np.sin(ROWS)), []
    for k, when in enumerate(t):
        half = (t[min(k + 1, len(t) - 1)] - t[max(k - 1, 0)]) / (4.0 if 0 < k < len(t) - 1 else 2.0)
        means.append(np.mean(force(when + np.linspace(-half, half, 401), 1.0)))
    inner, off = slice(2, -2), np.array(means) - force(t, 1.0)
    found = deaveraged(t, np.array(means)) - force(t, 1.0)
    assert np.abs(found[inner]).max() < 0.1 * np.abs(off[inner]).max()
    # over a gap nothing is known of the bend; beside a row that is missing it is
    apart = np.concatenate([t[:20], t[20:40] + 5.0])
    around = deaveraged(apart, np.array(means)[:40])
    assert around[19] == means[19] and around[20] == means[20] and around[10] != means[10]
    there = np.arange(len(t)) != 30
    beside = deaveraged(t[there], np.array(means)[there]) - force(t[there], 1.0)
    assert np.abs(beside[28:32]).max() < 0.2 * np.abs(off[28:33]).max()
    assert np.array_equal(deaveraged(t[:2], np.array(means[:2])), means[:2])


@pytest.mark.parametrize("hold", ["linear", "smooth", "mean"])
def test_means_keep_the_impulse_and_the_ends_their_values(hold: str) -> None:
    curve = InputCurve(ROWS, force(ROWS, 1.0), hold)
    fine, coarse = np.linspace(0.0, ROWS[-1], 399 * 64 + 1), np.sort(np.append(ROWS, curve.corners))
    impulse = float(curve.between(fine) @ np.diff(fine))
    assert float(curve.between(coarse) @ np.diff(coarse)) == pytest.approx(impulse, abs=1e-9)
    assert curve.between(ROWS[-1] + np.array([0.01, 0.02])) == pytest.approx(force(ROWS, 1.0)[-1:])
