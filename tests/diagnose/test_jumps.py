"""A counter that loses counts goes on from another place: seen by its jump alone, whatever the motion does."""

from __future__ import annotations

import numpy as np
import pytest
from diagnose.test_sizes import MOTOR

from hoopd.diagnose.quality.jumps import are_usual, jumps_of
from hoopd.diagnose.quality.recording_quality import assess, cleaned
from hoopd.recording.recording import Recording, from_signals

COUNT = 2.0 * np.pi / 4096
T = np.arange(0.0, 20.0, 0.01)


def counted(place: np.ndarray) -> np.ndarray:
    return COUNT * np.round(place / COUNT)


def turning() -> np.ndarray:
    """Starts, turns back, and stops where dry friction holds it."""
    speed = 12.0 * np.sin(2.0 * np.pi * 0.4 * T) * (np.abs(np.sin(2.0 * np.pi * 0.4 * T)) > 0.3)
    return np.asarray(np.cumsum(speed) * 0.01)


def recorded(place: np.ndarray) -> Recording:
    return from_signals(T, {"i": np.sin(2.0 * np.pi * 0.4 * T)}, {"th": place})


@pytest.mark.parametrize("rows", [[300], [300, 1234], [60, 300]])
def test_what_is_lost_is_found_where_it_was_and_as_large(rows: list[int]) -> None:
    place, lost = turning(), 0.15
    for row in rows:
        place[row:] -= lost
    found = jumps_of(T, counted(place))
    assert [one.row for one in found] == rows
    assert [one.size for one in found] == pytest.approx([-lost] * len(rows), abs=0.01)


def test_no_motion_is_a_jump_however_abrupt() -> None:
    impact = np.where(T < 7.0, 9.0 * T, 63.0 - 6.0 * (T - 7.0))  # turns round at a stop
    slips = 2.0 * np.floor(T)  # a slip each second that lasts for four rows
    slips[1:] = np.interp(T[1:] - 0.04, T, slips)
    for place in (
        turning(),
        impact,
        np.cumsum(np.sin(T) ** 3),
        np.zeros(T.size),
        np.convolve(slips, np.ones(5) / 5)[:2000],
    ):
        assert jumps_of(T, counted(place)) == []


@pytest.mark.parametrize("speed", [3.0, 12.0, 78.004 * COUNT / 0.01])
@pytest.mark.parametrize("lost", [0.15, 2.0])
def test_it_is_found_at_one_speed_whatever_the_counts_in_a_row(speed: float, lost: float) -> None:
    place = speed * T
    assert jumps_of(T, counted(place)) == []
    place[777:] -= lost
    for known in (None, COUNT):
        ((row, size),) = jumps_of(T, counted(place), known)
        assert row == 777 and size == pytest.approx(-lost, abs=2 * COUNT)


def test_a_reading_that_is_held_or_creeps_or_steps_with_a_fast_plant_does_not_jump() -> None:
    smooth = 3.0 * np.clip((T - 2.0) / 1.5, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip((T - 2.0) / 1.5, 0.0, 1.0))
    creep = COUNT * np.searchsorted(np.linspace(1.0, 19.0, 9), T)
    assert jumps_of(T, counted(smooth[np.arange(T.size) // 10 * 10])) == []
    assert jumps_of(T, creep) == [] and jumps_of(T, creep, COUNT) == []
    rough = np.random.default_rng(1).normal(size=T.size)
    for left in (0.05, 0.2, 0.4):  # of a step, after one row
        wanted, place = np.repeat([0.0, 0.5, -0.3, 0.8, 0.2], 400), np.zeros(T.size)
        for k in range(T.size - 1):
            place[k + 1] = wanted[k] + (place[k] - wanted[k]) * left
        assert jumps_of(T, counted(place)) == [] and jumps_of(T, counted(place + 1e-3 * rough)) == []


@pytest.mark.parametrize("rows", [4, 5, 20, 60])
def test_what_drops_out_and_comes_back_leaves_the_rest_where_it_was(rows: int) -> None:
    place, own = counted(3.0 + 12.0 * T), slice(700, 700 + rows)
    for false in (np.zeros(T.size), np.full(T.size, place[700]), place + 3.0):
        lost = place.copy()
        lost[own] = false[own]
        left = cleaned(recorded(lost), assess(recorded(lost), MOTOR)).column("th")
        assert np.nanmax(np.abs(left - place)[np.r_[0:699, 700 + rows : T.size]]) < 4 * COUNT


def test_more_than_a_slip_or_two_are_told_as_how_it_reads() -> None:
    place = 12.0 * T
    for row in range(50, 1950, 60):
        place[row:] -= 0.15
    judged = assess(recorded(counted(place)), MOTOR)
    assert are_usual(jumps_of(T, counted(place)), T.size) and not judged.jumps["th"]
    assert any("th jumps 32 times: so often is how it reads" in one for one in judged.notes)


def test_a_clock_that_stands_still_for_a_row_hides_no_jump() -> None:
    place, clock = turning(), T.copy()
    place[1234:] -= 0.15
    clock[100] = clock[99]
    assert [one.row for one in jumps_of(clock, counted(place))] == [1234]


def test_a_false_row_comes_back_and_is_no_jump_and_gaps_tell_nothing() -> None:
    false = counted(turning())
    false[700] += 0.3
    assert jumps_of(T, false) == []
    holed = counted(turning())
    holed[400:460] = np.nan
    assert jumps_of(T, holed) == []
    assert jumps_of(T[:9], holed[:9]) == [] and jumps_of(T, np.full(T.size, np.nan)) == []


def test_a_recording_is_judged_without_its_jumps_and_says_them() -> None:
    clean, lost = counted(turning()), counted(turning())
    lost[900:] += 200 * COUNT
    judged = assess(recorded(lost), MOTOR)
    (note,) = [one for one in judged.notes if "jumps" in one]
    assert note.startswith("th jumps by 0.30") and "at 9 s" in note
    left = cleaned(recorded(lost), judged).column("th")
    assert np.nanmax(np.abs(left - cleaned(recorded(clean), assess(recorded(clean), MOTOR)).column("th"))) < 4 * COUNT
