"""The fit of a free run: one measure, honest about what does not count, at each sensor's own instants."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared import shared_path

from hoopd.files.reading import InputError
from hoopd.plants.fits.nrmse import nrmse_percent
from hoopd.plants.hoop.fitting.fit_percent import score
from hoopd.plants.hoop.fitting.solver_comparison import two_level_torque
from hoopd.plants.hoop.recordings.recorded_runs import Subject, free_runs, simulated
from hoopd.plants.hoop.simulate import HoopModel
from hoopd.plants.model_file import load_model
from hoopd.recording import Recording, load
from hoopd.recording.recording import from_columns

CONFIG = Path(__file__).resolve().parents[3] / "config"
DEVICE = load_model(CONFIG / "models" / "hoop.yaml")
THESIS = load_model(CONFIG / "models" / "thesis.yaml")
TRUE = Subject(DEVICE.structure, DEVICE.values())
PRINTED = Subject(THESIS.structure, THESIS.values())
START = np.array([2.0, -1.5, 0.4, 1.0])


def _start(moving: str) -> np.ndarray:
    return {"both": START, "hoop": np.zeros(4), "ball": START * (0, 0, 1, 1)}[moving]


def recorded(rows: int = 400, late_s: tuple[float, float] = (0.0, 0.0), moving: str = "both") -> Recording:
    """Rows of the true device: theta and dtheta read `late_s[0]` after the row, psi `late_s[1]` before it."""
    t, u = 0.02 * np.arange(rows), two_level_torque(rows, 5)
    fine = np.round(np.arange(rows * 20) * 0.001, 9)
    x = TRUE.model(moving).run((), _start(moving), fine, np.repeat(u, 20)[: len(fine) - 1])
    y = np.minimum((np.arange(rows) * 20) + round(1e3 * late_s[0]), len(fine) - 1)
    eye = np.arange(rows) * 20 - round(1e3 * late_s[1])
    psi = np.where(eye >= 0, x[np.maximum(eye, 0), 2], np.nan)
    columns = {"t": t, "u": u, "theta": x[y, 0], "dtheta": x[y, 1], "psi": psi}
    if any(late_s):
        columns |= {"y_t": fine[y], "psi_t": t - late_s[1]}
    return from_columns(columns, source="made.csv")


@pytest.mark.proof
def test_the_start_of_a_ball_that_goes_round_is_found() -> None:
    """Over 20 s the straight line through five noisy samples leads the search to a start 2 rad/s off."""
    t, u, rng = 0.02 * np.arange(1000), 0.5 * two_level_torque(1000, 1), np.random.default_rng(0)
    x = TRUE.model("both").run((), [0.0, 0.0, 0.3, 45.0], t, u[:-1])
    assert x[:, 2].max() > 10 * np.pi
    psi = x[:, 2] + 0.003 * rng.normal(size=len(t))
    columns = {"t": t, "u": u, "theta": x[:, 0], "dtheta": x[:, 1], "psi": psi}
    found = score(TRUE, from_columns(columns, source="round.csv"))
    assert min(found.nrmse_percent.values()) > 99.5
    assert found.runs[0].start[3] == pytest.approx(45.0, abs=0.1)
    unseen = np.where(t < 2.5, np.nan, psi)  # a beginning without a ball is no start
    assert score(TRUE, from_columns({**columns, "psi": unseen}, source="late.csv")).runs


def test_the_measure_is_the_textbook_s() -> None:
    y = np.array([1.0, 2.0, 4.0])
    assert nrmse_percent(y, y) == 100.0
    assert nrmse_percent(y, np.full(3, y.mean())) == 0.0
    assert nrmse_percent(y, 2 * y.mean() - y) == pytest.approx(-100.0)
    assert np.isnan(nrmse_percent(np.ones(3), y)) and np.isnan(nrmse_percent(y[:1], y[:1]))


@pytest.mark.parametrize("window_s", [None, 2.0])
def test_the_true_model_fits_and_its_start_is_found(window_s: float | None) -> None:
    found = score(TRUE, recorded(), window_s=window_s)
    assert set(found.channels) == {"theta_rate", "dtheta", "psi"}
    assert min(found.nrmse_percent.values()) > 99.999
    np.testing.assert_allclose(found.runs[0].start, START, atol=1e-4)
    assert len(found.runs) == (1 if window_s is None else 4)
    assert {one.samples for one in found.channels.values()} == {400}, "a sample on a seam counts once"


def test_late_sensors_are_compared_at_their_own_instants() -> None:
    """Theta is read after the row, psi was seen before it: the true model is still perfect."""
    found = score(TRUE, recorded(late_s=(0.0, 0.031)))
    assert min(found.nrmse_percent.values()) > 99.99


def test_windows_forgive_what_a_free_run_does_not() -> None:
    whole, windows = (score(PRINTED, recorded(), window_s=window) for window in (None, 1.0))
    assert whole.nrmse_percent["psi"] < windows.nrmse_percent["psi"] < 99.0


def test_a_stuck_camera_does_not_count_and_is_said() -> None:
    recording = recorded()
    psi = recording.psi.copy()
    psi[300:] = psi[300]
    found = score(TRUE, replace(recording, psi=psi)).channels["psi"]
    assert found.set_aside == 99 and found.samples == 301
    assert found.nrmse_percent > 99.999
    assert found.nrmse_all_percent < 90.0


def test_no_ball_and_a_held_hoop_have_their_own_channels() -> None:
    recording = recorded()
    no_ball = replace(recorded(moving="hoop"), psi=np.full(len(recording), 0.1))
    assert {name: round(fit) for name, fit in score(TRUE, no_ball).nrmse_percent.items()} == {
        "theta_rate": 100,
        "dtheta": 100,
    }
    held = replace(recording, theta=np.zeros(400), dtheta=np.zeros(400))
    assert set(score(TRUE, held).channels) == {"psi"}


def test_a_given_start_is_taken_as_it_is() -> None:
    runs = free_runs(TRUE, recorded(), "both", start={"psi": 0.3, "dtheta": -1.0})
    np.testing.assert_array_equal(runs[0].start, [2.0, -1.0, 0.3, 0.0])
    gap = recorded()
    u = gap.u.copy()
    u[200] = np.nan
    with pytest.raises(InputError, match="2 stretches"):
        free_runs(TRUE, replace(gap, u=u), "both", start={"psi": 0.3})
    assert len(free_runs(TRUE, replace(gap, u=u), "both")) == 2


def test_a_finer_step_changes_nothing() -> None:
    coarse, fine = (score(replace(TRUE, step_s=h), recorded()) for h in (0.01, 0.0025))
    for name, one in coarse.channels.items():
        assert one.nrmse_percent == pytest.approx(fine.channels[name].nrmse_percent, abs=1e-3)


def test_the_simulated_run_has_the_rows_of_the_recording() -> None:
    recording = recorded(late_s=(0.002, 0.0))
    psi, u = recording.psi.copy(), recording.u.copy()
    psi[10:20], u[390:] = np.nan, np.nan
    recording = replace(recording, psi=psi, u=u)
    out = simulated(TRUE, recording, score(TRUE, recording).runs, "both")
    assert len(out) == len(recording) and np.array_equal(out.u, u, equal_nan=True)
    np.testing.assert_allclose(out.theta[:380], recording.theta[:380], atol=1e-3)
    assert np.isfinite(out.psi[:390]).all(), "where the camera saw nothing the simulation does"
    assert np.isnan(out.psi[391:]).all() and np.isnan(out.current).all()


def test_a_model_of_another_frequency_still_gets_the_best_start() -> None:
    """From the samples' own start the swing runs out of step; a start nearly at rest is better, about 0 percent."""
    slow = Subject("rolling", {**DEVICE.values(), "g": 5.0})
    found = score(slow, recorded(moving="ball"))
    assert found.moving == "ball" and -2.0 < found.nrmse_percent["psi"] < 30.0


def test_times_that_are_rounded_do_not_move_the_torque() -> None:
    """A text file's sample times may lie a rounding before the row's: the torque still acts from its own row."""
    recording = recorded()
    y_t = recording.t - 1e-12 * (np.arange(len(recording)) % 2)
    assert min(score(TRUE, replace(recording, y_t=y_t)).nrmse_percent.values()) > 99.99


@pytest.mark.parametrize(
    ("name", "changes", "least"),
    [
        ("meas_hoopAndBall2_01", {}, {"theta_rate": 79.2, "psi": 24.5}),
        ("meas_hoop01_f05_a01", {"J11": -0.28, "L1": 658.8}, {"theta_rate": 95.2}),
        ("meas_hoop02_chirp", {"J11": -0.28, "L1": 658.8}, {"theta_rate": 90.1}),
    ],
)
def test_the_printed_entries_reach_their_known_fit(
    name: str, changes: dict[str, float], least: dict[str, float]
) -> None:
    columns = "u,theta,dtheta,current" if "chirp" in name else None
    recording = load(shared_path(f"recordings/{name}.mat"), columns)
    found = score(Subject("entries", {**THESIS.values(), **changes}), recording)
    for channel, percent in least.items():
        assert percent - 0.2 < found.channels[channel].nrmse_all_percent < percent + 2.0


def test_model_alone_is_what_is_scored() -> None:
    """The states of a run are the model's own from its start: nothing of the measurement leaks in."""
    found = score(PRINTED, recorded())
    run = found.runs[0]
    again = HoopModel(PRINTED.structure, PRINTED.values).run((), run.start, run.part.t, run.part.u)
    np.testing.assert_allclose(run.states, again, rtol=0, atol=1e-12)
