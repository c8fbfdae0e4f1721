"""A recording carries inputs and channels of any plant by name; the daemon's own columns are some of them."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hoopd.recording import Recording, Signal, from_columns, from_signals
from hoopd.recording.doubts import doubts
from hoopd.recording.edit import aged, between, joined, resampled, shifted, unwrapped, without
from hoopd.recording.formats import load, save
from hoopd.recording.recording import with_hold
from hoopd.recording.timeline import switch_times, timelines


def axis(rows: int = 200, hold: str = "zero") -> Recording:
    """A force, a place read late, and a temperature read seldom."""
    t = 0.001 * np.arange(rows)
    warm = np.where(np.arange(rows) % 50 == 0, 20.0 + t, np.nan)
    return from_signals(
        t,
        {"F": Signal(np.sin(40 * t), t, "N", hold)},
        {"x": Signal(t**2, t - 0.0004, "m"), "warm": Signal(warm, t, "K")},
        source="made",
    )


def test_signals_are_attributes_and_cannot_be_changed() -> None:
    run = axis()
    assert (run.F[1], run.x[2], run.inputs["F"].unit, run.channels["x"].unit) == (np.sin(0.04), 4e-6, "N", "m")
    assert run.x_t[0] == -0.0004 and np.array_equal(run.F_t, run.t) and list(run.signals) == ["F", "x", "warm"]
    assert repr(run) == "Recording('made', 200 rows, 0.199 s, F, x, warm)" and not run.is_tick
    with pytest.raises(ValueError, match="read-only"):
        run.x[0] = 1.0
    for name in ("psi", "u", "_x", "__array__"):
        assert not hasattr(run, name)
    with pytest.raises(AttributeError, match="no signal 'psi'"):
        _ = run.psi
    assert np.array_equal(copy.copy(run).x, run.x)


def test_the_daemons_columns_are_signals_with_the_board_s_times_shared() -> None:
    t = 0.02 * np.arange(5)
    run = from_columns({"t": t, "u": t, "theta": t + 1, "psi_t": t - 0.05, "y_t": t - 0.01, "mode": ["A"] * 5})
    assert run.is_tick and list(run.inputs) == ["u"] and list(run.channels) == ["theta", "dtheta", "current", "psi"]
    assert np.array_equal(run.channels["dtheta"].t, run.y_t) and np.array_equal(run.channels["psi"].t, t - 0.05)
    assert np.isnan(run.psi).all() and run.channels["theta"].unit == "rad" and run.extra["mode"][0] == "A"
    moved = replace(run, psi=t, y_t=t, source="other")
    assert np.array_equal(moved.psi, t) and np.array_equal(moved.channels["theta"].t, t) and moved.source == "other"
    assert np.array_equal(moved.theta, run.theta)
    assert np.array_equal(Recording(t=t, u=t).u, t)


def test_what_does_not_fit_is_named() -> None:
    t = np.arange(3.0)
    with pytest.raises(ValueError, match=r"column x has shape \(2,\), t has \(3,\)"):
        from_signals(t, {}, {"x": t[:2]})
    with pytest.raises(ValueError, match=r"column x_t has shape \(2,\)"):
        from_signals(t, {}, {"x": Signal(t, t[:2])})
    with pytest.raises(ValueError, match="two columns would be called x"):
        from_signals(t, {"x": t}, {"x": t})
    with pytest.raises(ValueError, match="two columns would be called x_t"):
        from_signals(t, {}, {"x": t, "x_t": t})
    with pytest.raises(ValueError, match="two columns would be called t"):
        from_signals(t, {}, {"t": t})
    with pytest.raises(ValueError, match="goes on as 'cubic'"):
        from_signals(t, {"F": Signal(t, t, hold="cubic")})
    with pytest.raises(TypeError, match="no 'psi'"):
        replace(axis(), psi=t)


def test_edits_go_by_name() -> None:
    run = axis()
    cut = between(run, 0.05, 0.1)
    assert len(cut) == 51 and cut.x[0] == run.x[50] and cut.x_t[0] == run.x_t[50]
    assert np.allclose(shifted(run, 5.0).x_t - 5.0, run.x_t)
    assert np.isnan(without(run, "x").x).all()
    both = joined([cut, cut])
    assert len(both) == 103 and np.isnan(both.F[51]) and np.isnan(both.x[51]) and both.inputs["F"].unit == "N"
    with pytest.raises(ValueError, match="different signals"):
        joined([run, replace(run, channels={})])
    assert np.array_equal(aged(axis(), warm_s=0.01).warm_t, run.t - 0.01)
    with pytest.raises(ValueError, match=r"x: made has sample times of its own \(x_t\)"):
        aged(run, x_s=0.01)
    with pytest.raises(ValueError, match="psi: the recording has no such sample times"):
        aged(run, psi_s=0.01)


def test_resampled_means_what_is_held_and_reads_what_is_sampled() -> None:
    run = axis(201)
    coarse = resampled(run, 0.01)
    assert coarse.F[:20] == pytest.approx(run.F[:200].reshape(20, 10).mean(axis=1))
    inside = slice(5, -5)
    assert coarse.x[inside] == pytest.approx(coarse.t[inside] ** 2 + 0.0008 * coarse.t[inside], abs=5e-6)
    straight = resampled(axis(201, "linear"), 0.0005)
    assert straight.inputs["F"].hold == "linear"
    assert straight.F[1:-1:2] == pytest.approx((run.F[:-1] + run.F[1:]) / 2)
    assert resampled(axis(201, "mean"), 0.01).inputs["F"].hold == "smooth"


def test_angles_come_round_by_their_unit() -> None:
    t = 0.01 * np.arange(300)
    turned = (5 * t + np.pi) % (2 * np.pi) - np.pi
    run = from_signals(t, {}, {"alpha": Signal(turned, t, "rad"), "phase": Signal(turned, t, "")})
    assert unwrapped(run).alpha == pytest.approx(5 * t) and np.array_equal(unwrapped(run).phase, turned)
    assert doubts(run) == ["alpha is wrapped (at 2 places): fits and simulations unwrap it"]


def test_timelines_of_an_input_that_is_held_or_goes_straight() -> None:
    (held,) = timelines(axis(11))
    (line,) = timelines(axis(11, "linear"))
    run = axis(11)
    assert np.array_equal(switch_times(run), run.t)
    rows = np.sort([*run.t, *run.x_t[1:]])
    assert held.t == pytest.approx(rows)
    # a line that rises so much from row to row is followed by two stairs
    assert line.t == pytest.approx(np.sort([*rows, *(run.t[:-1] + 0.0005)]))
    for part in (held, line):
        assert part.t[part.channels["x"].nodes] == pytest.approx(run.x_t[1:])
    assert held.u[::2] == pytest.approx(run.F[:-1]) and held.u[1::2] == pytest.approx(run.F[:-1])
    ends = np.interp(line.t, run.t, run.F)
    assert line.u == pytest.approx((ends[:-1] + ends[1:]) / 2)


def test_a_timeline_of_means_has_readings_at_instants() -> None:
    run = axis(11)
    (plain,), (mean,) = timelines(with_hold(axis(11), "smooth")), timelines(with_hold(axis(11), "mean"))
    # of what is bent evenly a mean over h seconds is h^2 x''/24 more
    bend, h = np.diff(run.x, 2).mean() / np.diff(run.x_t).mean() ** 2, float(np.diff(run.x_t).mean())
    assert bend == pytest.approx(2.0, rel=1e-3)
    off = mean.channels["x"].values - plain.channels["x"].values
    assert off == pytest.approx(np.full(len(off), -(h**2) / 24.0 * bend), rel=1e-6)


@pytest.mark.parametrize("extension", [".mcap", ".h5"])
def test_that_rows_are_means_stays_with_inputs_and_readings(extension: str, tmp_path: Path) -> None:
    save(with_hold(axis(50), "mean"), tmp_path / f"run{extension}")
    again = load(tmp_path / f"run{extension}")
    assert {signal.hold for signal in again.signals.values()} == {"mean"}
    save(with_hold(axis(50), "linear"), tmp_path / f"line{extension}")
    line = load(tmp_path / f"line{extension}")
    assert line.inputs["F"].hold == "linear" and {one.hold for one in line.channels.values()} == {"zero"}


def test_timelines_of_several_inputs_and_of_none() -> None:
    t = 0.1 * np.arange(6)
    two = from_signals(t, {"a": t, "b": Signal(10 * t, t + 0.04)}, {"h": np.where(t == 0.2, np.nan, t)})
    (part,) = timelines(two)
    assert part.u.shape == (len(part.t) - 1, 2)
    assert part.t == pytest.approx(np.sort([*t[1:], *(t + 0.04)]))  # b is not known before it began
    assert part.u[0] == pytest.approx([0.0, 0.0]) and part.u[1] == pytest.approx([0.1, 0.0])
    free = from_signals(t, {}, {"h": t**2})
    (part,) = timelines(free)
    assert part.u.shape == (5, 0) and part.between(1, 3).u.shape == (2, 0)
    assert [len(one.t) for one in timelines(joined([free, free]))] == [7, 6]  # the row of nothing ends the first
    with pytest.raises(ValueError, match="no two rows in a row with a time and F"):
        timelines(replace(axis(3), F=np.full(3, np.nan)))


def test_silent_signals_are_worth_a_doubt() -> None:
    t = np.arange(30.0)
    run = from_signals(t, {"F": np.zeros(30)}, {"x": Signal(np.ones(30), t, "m"), "v": np.full(30, np.nan)})
    assert doubts(run) == ["x never changes (1 m)", "v is missing in every row"]


def test_a_sample_of_an_impossible_time_is_left_out() -> None:
    t = 0.02 * np.arange(50)
    late = np.where(np.arange(50) == 49, 1e261, t)
    (part,) = timelines(from_columns({"t": t, "u": t, "theta": t, "psi": t, "psi_t": late}))
    assert part.t[-1] == t[-1] and len(part.channels["psi"].nodes) == 49
