"""A counter that loses counts goes on from another place: seen by its jump alone, whatever the motion does."""

from __future__ import annotations

import numpy as np
import pytest
from diagnose.test_sizes import MOTOR

from hoopd.diagnose.quality.jumps import jumps_of
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


@pytest.mark.parametrize("rows", [[300], [300, 1234], [5, 300]])
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
