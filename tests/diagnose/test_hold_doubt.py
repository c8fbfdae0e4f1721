"""Rows that are far apart: which way the force went on between is told, and speeding up is no false value."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.diagnose.inputs import source_of
from hoopd.diagnose.quality.hold_doubt import hold_doubts
from hoopd.diagnose.quality.outliers import jumping
from hoopd.diagnose.quality.recording_quality import assess
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import stretch_of
from hoopd.plants.registry import plant_named
from hoopd.recording.recording import Recording, Signal, from_signals, with_hold

AXIS = plant_named("axis")
M, FV = 95.0, 200.0
FINE_S, COUNT = 1e-3, 40  # a row is the mean of so many samples
NOISE = Noise(np.array([0.5]), np.array([0.1]), np.array([2e-6]))


def moves(every: int, noise_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t, F and x of ramps and stops under a law that sets its force at each `every`th sample."""
    random, n = np.random.default_rng(4), 750 * COUNT
    speeds = np.repeat(random.choice([-0.12, 0.0, 0.0, 0.12], n // 700 + 1), 700)[:n]
    speeds = np.convolve(speeds, np.ones(100) / 100, "same")  # speeds up within 0.1 s
    wanted, x, v, force = np.cumsum(speeds) * FINE_S, 0.0, 0.0, 0.0
    forces, places = np.empty(n), np.empty(n)
    for k in range(n):
        if k % every == 0:
            force = 2e4 * (wanted[k] - x) + 2e3 * (speeds[k] - v)
        forces[k], places[k] = force, x
        v += FINE_S * (force - FV * v) / M
        x += FINE_S * v
    return FINE_S * np.arange(n), forces, places + noise_m * random.normal(size=n)


def rows(means: bool, hold: str, noise_m: float = 2e-6) -> Recording:
    """Means of every COUNT samples; or every such sample, of a force that is held from one to the next."""
    t, force, x = moves(1 if means else COUNT, noise_m)
    if means:
        t, force, x = (one.reshape(-1, COUNT).mean(axis=1) for one in (t, force, x))
    else:
        t, force, x = (one[::COUNT] for one in (t, force, x))
    return with_hold(from_signals(t, {"F": Signal(force, t, "N")}, {"x": Signal(x, t, "m")}, source="made"), hold)


def judged(recording: Recording) -> tuple[list[str], HypothesisFit]:
    source = source_of("made", recording, AXIS)
    base = fit(source.stretches, (), AXIS.values)
    return hold_doubts([source], (), base, 10.0), base


def test_means_are_told_from_what_is_held() -> None:
    (doubt,), zero = judged(rows(True, "zero"))
    assert "--hold zero" in doubt and "--hold smooth" in doubt and "averaged" in doubt
    none, smooth = judged(rows(True, "smooth"))
    assert none == []
    assert smooth.values["M"] == pytest.approx(M, rel=0.02)
    assert abs(zero.values["M"] / M - 1.0) > 0.05
    none, mean = judged(rows(True, "mean"))
    assert none == []
    assert mean.values["M"] == pytest.approx(M, rel=0.005)


def test_readings_are_trusted_as_far_as_the_force_is_known_between_its_rows() -> None:
    (stretch,) = source_of("made", rows(True, "smooth"), AXIS).stretches
    model = Track(stretch).columns({**AXIS.values, "M": M}, ()).model
    assert model.unresolved is not None and model.displaced is not None
    # M x'' = F: where the force swings unseen, the place is moved on by the integral of its integral, over M, and stays
    assert model.displaced[:, 0] == pytest.approx(stretch.unresolved[:, 0, 1] / M, rel=0.02)
    assert not model.displaced[:, 1].any()
    assert model.unresolved[:-1, 0] == pytest.approx(model.displaced[:, 0] / (2.0 * np.pi), rel=1e-6)
    late = stretch.seconds(10.0, 20.0)
    assert np.array_equal(late.unresolved, stretch.unresolved[np.searchsorted(stretch.t, late.t[:-1])])
    (zero,) = source_of("made", rows(True, "zero"), AXIS).stretches
    assert Track(zero).columns(AXIS.values, ()).model.unresolved is None


def test_nobody_knows_when_a_friction_turned_round_between_rows() -> None:
    """For the time by which a rate may have passed zero earlier or later the whole friction may have been on the other
    side; nowhere else, and of nothing whose inputs are known."""
    friction = library(AXIS)["body.coulomb_friction"]
    values = {**AXIS.values, "M": M, "body.coulomb_friction.Fc": 20.0}
    (stretch,), (zero,) = (source_of("made", rows(True, hold), AXIS).stretches for hold in ("mean", "zero"))
    plain, dry = (Track(stretch, some) for some in ((), (friction,)))
    for track in (plain, dry):
        track.smooth(values, NOISE)
    dry.like(plain)
    without, told = (track.columns(values, ()).model.displaced for track in (plain, dry))
    assert without is not None and told is not None
    assert not without[:, 1].any()
    speed = plain.z[:, 1]
    turns = (speed[:-1] * speed[1:] < 0.0) & (np.abs(np.diff(speed)) > 0.005)
    assert turns.sum() > 5 and (told[turns, 1] > 0.0).mean() > 0.9
    fast = np.minimum(np.abs(speed[:-1]), np.abs(speed[1:])) > 0.05
    assert fast.sum() > 50 and not told[fast, 1].any()
    # no longer than the step itself
    assert told[:, 1].max() <= 2.0 * 20.0 / M * float(np.max(stretch.h)) * 1.01
    assert Track(zero, (friction,)).columns(values, ()).model.displaced is None


def test_a_step_that_is_cut_displaces_no_more_than_the_whole_one() -> None:
    t, u = 0.3 * np.arange(40), np.random.default_rng(2).normal(size=39)
    unknown = np.stack([np.full(39, 0.1), np.full(39, 0.02)], axis=1)[:, None, :]
    cut = stretch_of("made", AXIS, t, u, {"x": (np.arange(40), np.zeros(40))}, unknown)
    assert len(cut.u) > 3 * 39
    assert np.sum(cut.unresolved[:, 0, 1] ** 2) == pytest.approx(39 * 0.02**2)
    assert cut.unresolved[:, 0, 0] == pytest.approx(0.1)


def test_what_is_held_raises_no_doubt() -> None:
    none, zero = judged(rows(False, "zero"))
    assert none == [] and zero.values["M"] == pytest.approx(M, rel=0.01)
    (doubt,), _ = judged(rows(False, "smooth"))
    assert "--hold zero" in doubt and "held from row to row" in doubt


def test_of_the_hoop_the_board_is_known_to_hold() -> None:
    t = 0.02 * np.arange(300)
    columns = {name: np.sin(t) for name in ("theta", "dtheta", "psi")}
    source = source_of("tick", Recording(t, u=0.1 * np.sin(3 * t), **columns), plant_named("hoop"))
    assert source.recording.is_tick and hold_doubts([source], (), None, 10.0) == []  # type: ignore[arg-type]


def test_speeding_up_is_no_burst_of_false_values() -> None:
    quality = assess(rows(True, "smooth"), AXIS)
    assert quality.segments == [] and quality.channels["x"].numbers["outliers"] == 0


def test_a_sensor_that_jumps_tells_false_values_all_the_same() -> None:
    good = rows(True, "smooth", 1e-4)
    x, random, single, burst = good.x.copy(), np.random.default_rng(5), 150, slice(400, 425)
    x[single] += 0.02
    x[burst] += 0.02 * random.choice([-1.0, 1.0], 25)
    false = assess(good.replaced(x=x), AXIS).channels["x"].outliers
    assert false[single] and false[burst].sum() >= 10
    false[single] = false[burst] = False
    assert false.sum() <= 4  # beside them


def test_a_false_run_is_judged_by_its_largest_bend() -> None:
    values, false = 1e-3 * np.arange(60.0) ** 2, np.zeros(60, dtype=bool)
    false[20:30] = true_jump = True
    assert not jumping(false, values, np.ones(60, dtype=bool), 1e-6).any()
    values[25] += 1.0
    assert (jumping(false, values, np.ones(60, dtype=bool), 1e-6) == false).all() == true_jump


def test_a_glitch_is_false_in_the_noise_of_a_rate() -> None:
    random, t = np.random.default_rng(2), 0.02 * np.arange(400)
    rate = 5.0 * np.sin(t) + 0.8 * random.normal(size=400)
    rate[200] += 7.0
    false = np.zeros(400, dtype=bool)
    false[[200, 300]] = True  # the second one is no further off than the others
    assert np.flatnonzero(jumping(false, rate, np.ones(400, dtype=bool), 0.8)).tolist() == [200]
