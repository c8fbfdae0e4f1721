"""A recording as a simulation sees it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from hoopd.recording.recording import Recording, from_columns, from_signals
from hoopd.recording.timeline import off_the_hoop, off_the_hoop_words, switch_times, timelines, usual_steps

NAN = float("nan")


def plain(n: int = 6) -> Recording:
    t = 0.02 * np.arange(n)
    return from_columns({"t": t, "u": np.arange(n) * 0.1, "theta": t * 2, "dtheta": t * 0 + 2, "psi": t * 3})


def ticked(n: int = 8) -> Recording:
    """Rows as the daemon writes them: the answer is the previous request's, the picture is 42 ms old."""
    t = 1.0 + 0.02 * np.arange(n)
    y_t, psi_t = t - 0.02 + 0.0007, t - 0.042
    y_t[0] = psi_t[3] = NAN
    theta, psi = 10 * y_t, 5 * psi_t
    return from_columns(
        {
            "t": t,
            "u": 0.1 * np.arange(n),
            "theta": theta,
            "dtheta": theta * 0 + 10,
            "psi": psi,
            "y_t": y_t,
            "psi_t": psi_t,
        }
    )


def test_a_plain_recording_has_its_rows_as_nodes() -> None:
    (line,) = timelines(plain())
    assert np.array_equal(line.t, plain().t)
    assert np.array_equal(line.u, plain().u[:-1])
    assert np.array_equal(line.channels["psi"].nodes, np.arange(6))


def test_a_torque_acts_from_when_the_board_took_it() -> None:
    recording = ticked()
    # the answer in row k + 1 was sampled as request k arrived, 0.7 ms after the tick
    assert switch_times(recording) == pytest.approx(recording.t + 0.0007)


def test_every_measurement_sits_on_the_node_of_its_instant() -> None:
    recording = ticked()
    (line,) = timelines(recording)
    assert (np.diff(line.t) > 0).all()
    for name, slope in (("theta", 10.0), ("psi", 5.0)):
        channel = line.channels[name]
        assert np.isfinite(channel.values).all()
        assert channel.values == pytest.approx(slope * line.t[channel.nodes])
    # what was sampled before the first torque acted belongs to no run
    assert line.t[0] == pytest.approx(recording.t[0] + 0.0007)
    assert len(line.channels["psi"].values) == 4  # rows 4 to 7: row 3 brought none
    between = line.t[:-1] + np.diff(line.t) / 2
    expected = 0.1 * np.floor((between - 0.0007 - 1.0) / 0.02 + 1e-9)
    assert line.u == pytest.approx(expected)


def test_a_missing_torque_ends_a_run() -> None:
    recording = plain(10)
    u = recording.u.copy()
    u[4] = NAN
    lines = timelines(from_columns({"t": recording.t, "u": u, "psi": recording.psi}))
    assert [len(line.t) for line in lines] == [4, 5]
    assert lines[1].t[0] == pytest.approx(0.1)
    with pytest.raises(ValueError, match="no two rows"):
        timelines(from_columns({"t": recording.t, "u": u * NAN}))


def test_missing_rows_end_a_run() -> None:
    recording = plain(40)
    keep = np.r_[0:15, 16:20, 30:40]  # one row lost is borne, ten are not
    cut = from_columns({name: getattr(recording, name)[keep] for name in ("t", "u", "theta", "psi")})
    assert [len(line.t) for line in timelines(cut)] == [19, 10]


def test_parts_of_other_steps_keep_their_own() -> None:
    t = np.concatenate([0.01 * np.arange(100), 1.0 + 0.07 * np.arange(40)])
    (line,) = timelines(from_columns({"t": t, "u": t, "psi": t}))  # steps seven times longer are no pauses
    assert len(line.t) == 140
    assert usual_steps(t)[[0, 50, 138]] == pytest.approx([0.01, 0.01, 0.07])
    assert usual_steps(t[:1]).size == 0


def test_only_a_driven_hoop_counts() -> None:
    recording = plain(10)
    modes = np.array(["DISARMED"] * 2 + ["READY"] + ["RUNNING"] * 4 + ["STOPPING"] + ["DISARMED"] * 2)
    columns = {"t": recording.t, "u": recording.u, "psi": recording.psi}
    (line,) = timelines(from_columns({**columns, "mode": modes}))
    assert line.t == pytest.approx(recording.t[3:8])
    (never,) = timelines(from_columns({**columns, "mode": np.array(["DISARMED"] * 10)}))
    assert len(never.t) == 10


def test_windows_cover_the_run_and_share_their_edges() -> None:
    (line,) = timelines(plain(501))
    parts = line.windows(2.0)
    assert len(parts) == 5
    assert parts[0].t[0] == line.t[0]
    assert parts[-1].t[-1] == line.t[-1]
    for left, right in pairwise(parts):
        assert left.t[-1] == right.t[0]
    for part in parts:
        channel = part.channels["psi"]
        assert channel.values == pytest.approx(3 * part.t[channel.nodes])


def test_nothing_of_the_recording_is_changed() -> None:
    recording = ticked()
    before = {name: getattr(recording, name).tobytes() for name in ("t", "u", "theta", "psi", "y_t", "psi_t")}
    timelines(recording)
    assert before == {name: getattr(recording, name).tobytes() for name in before}


def test_instants_a_microsecond_apart_are_one_node_whatever_they_round_to() -> None:
    """A text file has microseconds: a picture taken one after the board's sample must not sit on the node behind it."""
    t = np.round(1.0 + 0.02 * np.arange(200), 6)
    for apart in (1e-6, 0.6e-6):
        columns = {"t": t, "u": t * 0, "theta": t, "psi": t + apart, "y_t": t, "psi_t": np.round(t + apart, 9)}
        (line,) = timelines(from_columns(columns))
        channel = line.channels["psi"]
        assert np.abs(line.t[channel.nodes] - channel.values).max() < 2e-6


def test_angles_are_unwrapped() -> None:
    t = 0.02 * np.arange(300)
    psi, theta = 20.0 * t, 30.0 * t + 512 * 2 * np.pi - 40.0
    turned = {
        "psi": (psi + np.pi) % (2 * np.pi) - np.pi,
        "theta": (theta + 1024 * np.pi) % (2048 * np.pi) - 1024 * np.pi,
    }
    recording = from_columns({"t": t, "u": t * 0, **turned})
    (line,) = timelines(recording)
    assert line.channels["psi"].values == pytest.approx(psi)
    assert line.channels["theta"].values == pytest.approx(theta)
    assert np.abs(recording.psi).max() <= np.pi, "the recording itself stays as it is"


@pytest.mark.parametrize("step", [2e-7, 1e-6, 1.5e-6])
def test_rows_nearer_than_two_instants_are_refused(step: float) -> None:
    t = step * np.arange(1000.0)
    with pytest.raises(ValueError, match="s apart, at least 2e-06 s are needed"):
        timelines(from_signals(t, {"u": t}, {"y": t}))
    (part,) = timelines(from_signals(2e-6 * np.arange(1000.0), {"u": t}, {"y": t}))
    assert len(part.t) == 1000


def flown(modes: list[str]) -> Recording:
    whole = plain(len(modes))
    return whole.replaced(extra={"ball_mode": np.array(modes)}, source="up.mcap")


def test_rows_of_a_ball_off_the_outer_hoop_end_a_run() -> None:
    """And eight ticks after it came back."""
    modes = [""] * 10 + ["rolling"] * 10 + ["air"] * 3 + ["inner"] * 5 + ["air"] * 2 + ["rolling"] * 20 + [""] * 5
    before, after = timelines(flown(modes))
    assert np.allclose(before.t[[0, -1]], (0.0, 0.38)) and np.allclose(after.t[[0, -1]], (0.76, 1.08))
    (words,) = off_the_hoop_words(flown(modes))
    assert words.startswith("18 rows were taken with the ball off the outer hoop")


def test_a_recording_whose_ball_never_left_the_hoop_is_read_as_it_was() -> None:
    modes = [""] * 3 + ["rolling"] * 17
    (line,) = timelines(flown(modes))
    (same,) = timelines(plain(20))
    assert np.array_equal(line.t, same.t) and np.array_equal(line.u, same.u)
    assert not off_the_hoop(flown(modes)).any() and off_the_hoop_words(flown(modes)) == []


def test_a_recording_of_the_inner_hoop_alone_is_one_line() -> None:
    with pytest.raises(ValueError, match="no two rows in a row with time, torque, and the ball on the outer hoop"):
        timelines(flown(["inner"] * 20))
