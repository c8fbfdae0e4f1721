"""Intervals that do not belong to a recording, and the picture of a missing force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with
from shared import shared_path

from hoopd.diagnose.curves.missing_force import binned, missing_force
from hoopd.diagnose.inputs import source_of
from hoopd.diagnose.quality.excluded_stretches import FAR_BEYOND, leaving_enough, set_aside, without
from hoopd.diagnose.quality.unusual_energy import level_of, mean_squares, unusual
from hoopd.diagnose.quality.unusual_intervals import (
    CHANCE_A_MINUTE,
    Interval,
    UnusualSignal,
    intervals,
    signals_by_name,
)
from hoopd.diagnose.search.excluded_intervals import CountedData
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.recording import load

PLANT = shipped_plant()
STEP_S = 0.02


def refit(stretches: list[Stretch]) -> HypothesisFit:
    return fit(stretches, (), PLANT.values)


@pytest.fixture(scope="module")
def clean() -> HypothesisFit:
    return refit([stretch_with(PLANT, "r", 10, 12.0)])


HAND = Effect(
    "ball.hand",
    (EffectParameter("A", "N m", 0, 0, 1),),
    force=lambda s, e: {"psi": e.A * (s.t > 6.0) * (s.t < 7.5) * (s.psi - 0.8) * -1.0},
)
STRENGTH = {"ball.hand.A": 0.1}


@pytest.fixture(scope="module")
def pushed() -> Stretch:
    """A hand moves the ball between 6 and 7.5 s."""
    return stretch_with(PLANT, "r", 7, 15.0, [HAND], STRENGTH)


def coloured(seed: int, seconds: float, time_s: float) -> np.ndarray:
    random, keep = np.random.default_rng(seed), np.exp(-STEP_S / time_s)
    white, x = random.normal(size=int(seconds / STEP_S)), np.zeros(int(seconds / STEP_S))
    for k in range(1, len(x)):
        x[k] = keep * x[k - 1] + np.sqrt(1 - keep**2) * white[k]
    return x


@pytest.mark.parametrize("time_s", [1e-3, 0.15, 0.6])
def test_coloured_noise_has_few_candidates_and_no_alarm(time_s: float) -> None:
    t, candidates, alarms = np.arange(3000) * STEP_S, 0, 0
    for seed in range(150):
        x = coloured(seed, 60.0, time_s)
        candidates += len(unusual([(t, x)], CHANCE_A_MINUTE))
        alarms += int(mean_squares(x / level_of([(t, x)]), 25).max() > FAR_BEYOND**2)
    assert candidates <= 12  # of 150 minutes: each costs a fit
    assert alarms <= 1  # below one in a hundred


def test_a_hand_is_found_when_it_came_and_went(pushed: Stretch) -> None:
    kept, out, found, _ = set_aside([pushed], refit)
    assert len(out) == 1
    assert (out[0].where, out[0].recording) == ("psi", "r")
    assert out[0].t0 == pytest.approx(6.0, abs=0.4) and out[0].t1 == pytest.approx(7.5, abs=0.8)
    assert len(kept) == 2 and kept[0].t[-1] < 6.2 and kept[1].t[0] > 7.2
    assert not [one for one in intervals(found) if one.strength > 5.0]
    data = CountedData([pushed], kept, out)
    assert data.brought_back(found) is data
    # who knows what the hand does, has no reason to leave it out
    knowing = fit(kept, [HAND], {**found.values, **STRENGTH}, free=(), noise=found.noise, tune_noise=False)
    again = data.brought_back(knowing)
    assert (list(again.aside), len(again.kept)) == ([], 1)
    assert again.kept[0].t[-1] == pushed.t[-1]


def test_nothing_is_set_aside_that_leaves_nothing_of_a_recording(pushed: Stretch) -> None:
    signal = (UnusualSignal("psi", "force", 9.0, 1.0),)
    # 0.6 s out of every second: what is between is too short to be of use
    every = [Interval("r", second, second + 0.6, signal) for second in range(15)]
    assert without([pushed], every) == []
    assert leaving_enough([pushed], every) == []
    assert leaving_enough([pushed], every[7:8]) == every[7:8]


def test_an_effect_that_adds_a_coordinate_leaves_the_plants_own_signals(clean: HypothesisFit) -> None:
    made = clean.tracks[0].stretch
    slip = library(made.plant)["ball.slip"]
    found = fit([made], [slip], {**clean.values, "ball.slip.mu": 0.4}, noise=clean.noise, move=False)
    plain, with_slip = signals_by_name(clean, "r"), signals_by_name(found, "r")
    assert found.tracks[0].composite.nq == 3 and list(with_slip) == list(plain)


def test_a_clean_recording_stays_whole(clean: HypothesisFit) -> None:
    made = clean.tracks[0].stretch
    kept, out, found, _ = set_aside([made], refit, clean)
    assert (out, kept) == ([], [made])
    assert found is clean


def test_a_stuck_camera_is_an_interval_of_its_channel_or_of_the_ball() -> None:
    made = stretch_with(PLANT, "r", 9, 12.0)
    y = made.y.copy()
    y[300:340, 2] = y[300, 2]
    found = intervals(refit([replace(made, y=y)]))
    assert [one.where for one in found] == ["psi"]
    assert found[0].t0 == pytest.approx(6.0, abs=0.4) and found[0].t1 == pytest.approx(6.8, abs=0.5)


def test_the_hand_in_a_real_recording_is_set_aside_unasked() -> None:
    path = shared_path("recordings/meas_ballOnly01.mat")
    source = source_of(path.name, load(path), hoop_plant("entries", PLANT.values))
    before = refit(list(source.stretches))
    kept, out, found, _ = set_aside(source.stretches, refit, before)
    assert any(one.t0 < 14.5 and one.t1 > 16.5 for one in out)
    assert sum(one.t[-1] - one.t[0] for one in kept) > 20.0
    # what is left is told by far less noise
    assert found.noise[path.name].force[0] < 0.1 * before.noise[path.name].force[0]


# Lags of the innovations' correlation: 0.4 s at 50 Hz.
LAGS = 20


class Whiteness(NamedTuple):
    """Innovations of one channel against what the model expects: 1 and 0."""

    mean_square: float  # of normalised innovations
    correlation: float  # (Q - lags) / sqrt(2 lags) of Ljung and Box


def whiteness(fit: HypothesisFit) -> dict[str, Whiteness]:
    """Of every channel, all recordings together."""
    parts: dict[str, list[np.ndarray]] = {}
    for track, rows in zip(fit.tracks, fit.rows, strict=True):
        innovations = rows[:, 0].reshape(len(track.z), -1)
        seen = np.isfinite(track.stretch.y)
        for j, channel in enumerate(track.composite.channels):
            parts.setdefault(channel, []).append(innovations[seen[:, j], j])
    return {channel: _whiteness(each) for channel, each in parts.items() if sum(map(len, each)) > LAGS}


def _whiteness(parts: Sequence[np.ndarray]) -> Whiteness:
    energy, n = sum(float(x @ x) for x in parts), sum(map(len, parts))
    # Q = n (n+2) sum rho_k^2 / (n-k)
    rho = [sum(float(x[k:] @ x[:-k]) for x in parts if len(x) > k) / max(energy, 1e-300) for k in range(1, LAGS + 1)]
    q = n * (n + 2) * sum(r**2 / (n - k) for k, r in enumerate(rho, start=1))
    return Whiteness(energy / n, float((q - LAGS) / np.sqrt(2 * LAGS)))


def test_innovations_of_a_clean_fit_are_white_those_of_a_wrong_one_are_not(clean: HypothesisFit) -> None:
    for one in whiteness(clean).values():
        assert one.mean_square == pytest.approx(1.0, abs=0.15)
        assert abs(one.correlation) < 5.0
    # a camera of another scale: the noise levels of before do not explain it
    track = clean.tracks[0]
    wrong = replace(track.stretch, y=track.stretch.y * [1.0, 1.0, 1.5])
    found = fit([wrong], (), clean.values, free=(), noise=clean.noise, tune_noise=False)
    assert max(one.correlation for one in whiteness(found).values()) > 10.0


def test_the_missing_force_is_drawn_against_the_rate() -> None:
    friction, plant = library(PLANT)["hoop.coulomb_friction"], PLANT
    values = {**plant.values, "hoop.coulomb_friction.Fc": 6e-3}
    found = refit([stretch_with(plant, "r", 11, 12.0, [friction], values)])
    drawn = missing_force(found, 0, "hoop", ["dtheta", "theta"])
    assert [one.name for one in drawn.regressors] == ["dtheta", "theta"]
    assert np.ptp(drawn.regressors[1].value) <= 2 * np.pi
    shown = drawn.regressors[0].binned
    assert shown is not None
    # what a viscous base cannot take of a jump at rest
    near = np.abs(shown.x) < 3.0
    assert np.corrcoef(shown.mean[near], -np.sign(shown.x[near]))[0, 1] > 0.7


def test_bins_hold_the_mean_within_their_band() -> None:
    random = np.random.default_rng(3)
    x = random.uniform(-1.0, 1.0, 4000)
    found = binned(x, x**2 + 0.1 * random.normal(size=4000))
    inside = (found.low < found.x**2 + 1e-3) & (found.x**2 - 1e-3 < found.high)
    assert inside.mean() > 0.85


def test_an_error_of_the_camera_is_drawn_as_an_angle(clean: HypothesisFit) -> None:
    drawn = missing_force(clean, 0, "camera", ["psi"])
    assert drawn.unit == "rad"
    assert np.nanstd(drawn.value) < 0.01
