"""Editing gives new recordings, invents nothing, and leaves its input alone to the byte."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from hoopd.plants.hoop.recordings.suspicions import suspicions
from hoopd.recording import Recording
from hoopd.recording.edit import aged, between, joined, resampled, shifted, unwrapped, without
from hoopd.recording.recording import UNITS, from_columns, from_signals
from hoopd.recording.timeline import switch_times, timelines

TURN = 2 * math.pi


def made(rows: int = 101, **columns: object) -> Recording:
    """A recording with missing psi, delays of its own and extra columns."""
    rng = np.random.default_rng(2)
    t = 3 + 0.02 * np.arange(rows)
    signals = {name: rng.normal(size=rows) for name in ("u", "theta", "dtheta", "psi", "current")}
    signals["psi"][5::7] = np.nan
    extra = {"mode": np.full(rows, "RUNNING"), "id": np.arange(rows), "x_hat": rng.normal(size=(rows, 4))}
    return from_columns({"t": t, **signals, "psi_t": t - 0.05, **extra, **columns}, source="made", config="a: 1\n")


EDITS: dict[str, Callable[[Recording], Recording]] = {
    "between": lambda item: between(item, 3.5, 4),
    "joined": lambda item: joined([item, item]),
    "finer": lambda item: resampled(item, 0.007),
    "coarser": lambda item: resampled(item, 0.1),
    "unwrapped": unwrapped,
    "without": lambda item: without(item, "psi", "current"),
    "shifted": lambda item: shifted(item, 0.0),
}


@pytest.mark.parametrize("name", EDITS)
def test_the_input_stays_and_the_result_is_read_only(name: str) -> None:
    recording = made()
    before = {key: getattr(recording, key).tobytes() for key in UNITS}
    extra = {key: column.tobytes() for key, column in recording.extra.items()}
    result = EDITS[name](recording)
    assert before == {key: getattr(recording, key).tobytes() for key in UNITS}
    assert extra == {key: column.tobytes() for key, column in recording.extra.items()}
    assert not any(np.shares_memory(getattr(result, key), getattr(recording, key)) for key in UNITS)
    with pytest.raises(ValueError, match="read-only"):
        result.u[0] = 1.0


def test_between_keeps_both_ends_and_every_column() -> None:
    cut = between(made(), 3.2, 3.4)
    assert (len(cut), cut.t[0], cut.extra["id"].tolist()) == (11, pytest.approx(3.2), list(range(10, 21)))
    assert len(between(made(), end_s=3.0)) == 1 and len(between(made(), 4.0)) == 51
    with pytest.raises(ValueError, match=r"no row between 6 and \.\.\. s; there are 3 to 5 s"):
        between(made(), 6)


def test_joined_has_a_gap_of_nothing() -> None:
    one, two = made(50), made(60)
    both = joined([one, two])
    assert len(both) == 111 and (np.diff(both.t) > 0).all()
    assert all(np.isnan(getattr(both, name)[50]) for name in ("u", "theta", "dtheta", "psi", "current"))
    assert np.array_equal(both.t[:50], one.t) and np.array_equal(both.theta[51:], two.theta)
    assert both.t[51] - both.t[49] == pytest.approx(1.0)
    assert both.t[51:] - both.psi_t[51:] == pytest.approx(0.05)
    assert set(both.extra) == {"mode", "x_hat"} and np.isnan(both.extra["x_hat"][50]).all()
    assert (both.source, both.config) == ("made", "a: 1\n")
    with pytest.raises(ValueError, match="nothing to join"):
        joined([])


@pytest.mark.parametrize("step_s", [0.005, 0.02, 0.1])
def test_nothing_is_interpolated_across_a_joint(step_s: float) -> None:
    part = made(100, psi=np.ones(100), theta=np.ones(100))
    result = resampled(joined([part, part]), step_s)
    inside = (result.t > part.t[-1] + 0.02) & (result.t < part.t[-1] + 0.94)
    assert inside.any()
    for name in ("u", "theta", "dtheta", "psi", "current"):
        assert np.isnan(getattr(result, name)[inside]).all()
    outside = (result.t < part.t[-1] - 0.1) | (result.t > part.t[-1] + 1.1)
    assert np.isfinite(result.theta[outside]).all()


def test_same_step_gives_the_same_numbers() -> None:
    recording = made(theta=np.linspace(0, 900, 101), psi=np.sin(np.arange(101.0)))
    recording = from_columns({name: getattr(recording, name) for name in ("t", "u", "theta", "dtheta", "psi")})
    result = resampled(recording, 0.02)
    assert np.array_equal(result.u, recording.u)
    assert result.theta == pytest.approx(recording.theta, abs=1e-9)
    assert result.psi == pytest.approx(recording.psi, abs=1e-9)


def test_the_mean_torque_is_kept() -> None:
    recording = made(101)
    coarse = resampled(recording, 0.1)
    assert coarse.u[:20] == pytest.approx(recording.u[:100].reshape(20, 5).mean(axis=1))
    fine = resampled(recording, 0.005)
    assert np.array_equal(fine.u[:400], np.repeat(recording.u[:100], 4))
    holed = resampled(made(101, u=np.where(np.arange(101) == 7, np.nan, 1.0)), 0.1)
    assert np.isnan(holed.u).tolist() == [k == 1 for k in range(21)]


@pytest.mark.parametrize(("frequency_hz", "gain"), [(0.5, 1.0), (2.0, 1.0), (4.0, 1.0), (6.0, 0.0), (20.0, 0.0)])
def test_coarser_is_low_passed_without_delay(frequency_hz: float, gain: float) -> None:
    t = 0.02 * np.arange(2000)
    wave = np.sin(TURN * frequency_hz * t + 0.3)
    result = resampled(from_columns({"t": t, "theta": wave}), 0.1)
    middle = slice(40, -40)
    expected = gain * np.sin(TURN * frequency_hz * result.t[middle] + 0.3)
    assert result.theta[middle] == pytest.approx(expected, abs=2e-3)


def test_straight_lines_stay_straight() -> None:
    t = 0.02 * np.arange(300)
    result = resampled(from_columns({"t": t, "theta": 100 - 40 * t, "psi": 0.1 * t}), 0.1)
    assert result.theta == pytest.approx(100 - 40 * result.t, abs=1e-9)
    assert result.psi == pytest.approx(0.1 * result.t, abs=1e-9)


def test_samples_are_read_at_their_own_times() -> None:
    t = 0.02 * np.arange(200)
    result = resampled(from_columns({"t": t, "psi": np.sin(t - 0.05), "psi_t": t - 0.05}), 0.01)
    there = np.isfinite(result.psi)
    assert result.psi[there] == pytest.approx(np.sin(result.t[there]), abs=1e-4)
    assert there[result.t < t[-1] - 0.06].all() and not there[result.t > t[-1] - 0.045].any()


def test_a_torque_acts_from_where_the_board_took_it_over() -> None:
    t = 0.02 * np.arange(50)
    u = np.where(np.arange(50) % 2 == 0, 1.0, -1.0)
    late = resampled(from_columns({"t": t, "u": u, "y_t": t - 0.015}), 0.005)  # the next answer comes 5 ms after a tick
    assert late.u[4:20].tolist() == [1, -1, -1, -1, -1, 1, 1, 1, 1, -1, -1, -1, -1, 1, 1, 1]


def test_long_gaps_stay_gaps() -> None:
    t, rows = 0.02 * np.arange(100), np.arange(100)
    psi = np.where(((rows > 20) & (rows < 23)) | ((rows > 50) & (rows < 60)), np.nan, t)
    result = resampled(from_columns({"t": t, "psi": psi}), 0.02)
    assert np.isnan(result.psi).tolist() == [50 < k < 60 for k in range(100)]


def test_impossible_steps_are_refused() -> None:
    for step_s in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="the step must be a positive time"):
            resampled(made(), step_s)
    for step_s in (1e-9, 1e-300):
        with pytest.raises(ValueError, match="rows, more than"):
            resampled(made(), step_s)
    with pytest.raises(ValueError, match="below the resolution"):
        resampled(from_columns({"t": [1e9, 1e9 + 1e-4]}), 1e-8)
    with pytest.raises(ValueError, match="more than 1000 samples long"):
        resampled(made(), 30.0)
    with pytest.raises(ValueError, match="one row"):
        resampled(made(1), 0.1)


@settings(deadline=None)
@given(st.lists(st.floats(-3, 3), min_size=1, max_size=40), st.data())
def test_unwrapped_through_gaps(steps: list[float], data: st.DataObject) -> None:
    true = np.cumsum([0.0, *steps])
    wrapped = (true + math.pi) % TURN - math.pi
    gaps = np.array(data.draw(st.lists(st.booleans(), min_size=len(true), max_size=len(true))))
    gaps[1:] &= ~gaps[:-1] & (np.abs(np.append(steps[1:], 0) + np.array(steps)) < 3)  # else the way is not known
    gaps[0] = False
    recording = from_columns({"t": np.arange(float(len(true))), "psi": np.where(gaps, np.nan, wrapped)})
    result = unwrapped(recording).psi
    assert np.isnan(result).tolist() == gaps.tolist()
    assert result[~gaps] == pytest.approx(true[~gaps], abs=1e-9)


def test_unwrapped_knows_the_board_and_leaves_what_is_unwrapped() -> None:
    true = np.linspace(500 * TURN, 530 * TURN, 500)
    wrapped = (true + 512 * TURN) % (1024 * TURN) - 512 * TURN
    once = unwrapped(from_columns({"t": np.arange(500.0), "theta": wrapped, "psi": np.linspace(0, 20, 500)}))
    assert once.theta == pytest.approx(true)
    twice = unwrapped(once)
    assert all(np.array_equal(getattr(twice, name), getattr(once, name), equal_nan=True) for name in UNITS)


def test_aged_samples_are_older_than_their_rows_and_the_torque_is_not() -> None:
    item = made(psi_t=3 + 0.02 * np.arange(101))
    older = aged(item, y_s=0.005, psi_s=0.03)
    assert np.array_equal(older.y_t, item.t - 0.005) and np.array_equal(older.psi_t, item.t - 0.03)
    assert np.array_equal(switch_times(older), item.t)  # not 15 ms later, as for a board that samples at take-over
    assert np.array_equal(switch_times(shifted(older, 0.0)), shifted(older, 0.0).t)
    assert np.array_equal(switch_times(between(older, 4.0)), between(older, 4.0).t)
    (line,) = timelines(older)
    assert line.t[line.channels["theta"].nodes[:2]] == pytest.approx([3.015, 3.035])
    assert np.array_equal(aged(item, psi_s=0.01).y_t, item.t)


def test_an_age_that_cannot_be_is_refused() -> None:
    for age_s in (-0.01, 30.0, math.nan):
        with pytest.raises(ValueError, match="y must be 0 to 1 s"):
            aged(made(), y_s=age_s)
    with pytest.raises(ValueError, match=r"psi: made has sample times of its own \(psi_t\)"):
        aged(made(), psi_s=0.03)


def test_what_is_sampled_every_half_minute_may_be_as_old() -> None:
    t = 30.0 * np.arange(40)
    chamber = from_signals(t, {"duty": t % 7}, {"T": t % 11})
    assert aged(chamber, T_s=15.0).channels["T"].t[1] == 15.0
    with pytest.raises(ValueError, match="T must be 0 to 1500 s"):
        aged(chamber, T_s=1501.0)


def test_without_and_shifted() -> None:
    bare = without(made(), "psi", "current")
    assert np.isnan(bare.psi).all() and np.isnan(bare.current).all() and np.isfinite(bare.theta).all()
    for name in ("t", "speed"):
        with pytest.raises(ValueError, match=f"no signal '{name}'"):
            without(made(), name)
    moved = shifted(made(), 0.0)
    assert moved.t[0] == 0.0 and moved.t - moved.psi_t == pytest.approx(0.05)


ANY = (
    st.lists(st.floats(1e-7, 1e3), min_size=1, max_size=40),
    st.floats(1e-3, 1e3),
    st.integers(0, 2**32 - 1),
    st.booleans(),
)


@settings(max_examples=40, deadline=None)
@given(*ANY)
def test_any_recording_is_edited_or_refused(steps: list[float], step_s: float, seed: int, uneven: bool) -> None:
    edited_or_refused(steps, step_s, seed, uneven)


@pytest.mark.proof
@settings(max_examples=300, deadline=None)
@given(*ANY)
def test_any_of_300_recordings_is_edited_or_refused(steps: list[float], step_s: float, seed: int, uneven: bool) -> None:
    edited_or_refused(steps, step_s, seed, uneven)


def edited_or_refused(steps: list[float], step_s: float, seed: int, uneven: bool) -> None:
    """Times rise, and no angle is infinite, whatever was recorded."""
    rng = np.random.default_rng(seed)
    size = len(steps)
    t = np.cumsum(steps) if uneven else 0.02 * np.arange(size)
    columns = {name: np.where(rng.random(size) < 0.3, np.nan, rng.normal(size=size)) for name in UNITS if name != "t"}
    recording = from_columns({"t": t, **columns})
    both = joined([recording, recording])
    assert (np.diff(both.t) > 0).all()
    assert isinstance(suspicions(both), list) and isinstance(suspicions(recording), list)
    try:
        result = resampled(both, step_s)
    except ValueError:
        return
    assert (np.diff(result.t) > 0).all()
    assert not np.isinf(result.theta).any()
