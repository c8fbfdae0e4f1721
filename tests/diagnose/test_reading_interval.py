"""Readings that come far more often than a plant moves: what happens between two of them does not judge the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.proof.experiment_menu import in_times_of
from hoopd.diagnose.search import bounded_disturbance
from hoopd.diagnose.search.bounded_disturbance import likeliest, unexplained_sentences
from hoopd.diagnose.search.naming import name_effects
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.loop.experiment_plan import Plan
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.noise_tuning import first_noise
from hoopd.plants.likelihood.reading_interval import spaced
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_model import nominal_model
from hoopd.plants.registry import plant_named

AXIS = plant_named("axis")
M, FV, FC, FINE = 95.0, 200.0, 20.0, 2e-8
STEP_S, WAY = 1e-3, 4e-6


def driven_axis(seconds: float = 15.0, noise: float = FINE, every: int = 1) -> Stretch:
    """Swings of an axis under a law; its dry friction turns round on its way; a sample each `every` ms."""
    random = np.random.default_rng(3)
    n, x, v, friction = int(seconds / STEP_S), 0.0, 0.0, 0.0
    u, path = np.empty(n), np.empty(n)
    for k in range(n):
        t, path[k] = k * STEP_S, x
        wanted = 0.08 * np.sin(0.9 * t) + 0.03 * np.sin(2.3 * t + 1.0)
        rate = 0.072 * np.cos(0.9 * t) + 0.069 * np.cos(2.3 * t + 1.0)
        u[k] = 4e4 * (wanted - x) + 4e3 * (rate - v)
        # Dahl: friction follows the way since the last reversal
        friction = np.sign(v) * FC + (friction - np.sign(v) * FC) * np.exp(-abs(v) * STEP_S / WAY)
        v += STEP_S * (u[k] - FV * v - friction) / M
        x += STEP_S * v
    t = STEP_S * np.arange(0, n, every)
    y = path[::every] + noise * random.normal(size=len(t))
    return stretch_of("swings", AXIS, t, u[::every][:-1], {"x": (np.arange(len(t)), y)})


def with_friction(stretch: Stretch) -> HypothesisFit:
    return fit([stretch], [library(AXIS)["body.coulomb_friction"]], {"body.coulomb_friction.Fc": 5.0, **AXIS.values})


def test_dry_friction_is_as_large_as_it_is_however_it_turns_round() -> None:
    found = with_friction(spaced(driven_axis()))
    # of what happens within every millisecond the disturbance takes all: 1 N of friction, Fv 5000
    assert found.values["body.coulomb_friction.Fc"] == pytest.approx(FC, rel=0.15)
    assert found.values["M"] == pytest.approx(M, rel=0.05)
    assert found.values["Fv"] == pytest.approx(FV, rel=0.15)


def test_readings_are_apart_as_the_plant_moves_and_the_inputs_keep_all_samples() -> None:
    given = driven_axis(20.0)
    kept = spaced(given)
    assert len(kept.u) == len(given.u)
    times = kept.t[np.isfinite(kept.y[:, 0])]
    assert np.diff(times) == pytest.approx(0.02 / 0.3, rel=0.05)  # a third of a tenth of a metre a second: 0.33 s
    # the noise is told by all readings: of those that are left the motion itself is rough
    noise = first_noise([Track(kept)], AXIS.values)["swings"]
    assert noise.reading[0] == pytest.approx(FINE, rel=0.2)
    short = spaced(given.seconds(0.0, 3.0))
    assert np.isfinite(short.y).sum() >= 200


def test_a_noisy_sensor_a_slow_one_and_the_hoop_keep_all_readings() -> None:
    hoop = stretch_with(shipped_plant(), "hoop", 1, 10.0)
    for one in (driven_axis(noise=1e-4), driven_axis(every=67), hoop):
        assert spaced(one) is one


def test_slow_samples_ask_for_slow_experiments() -> None:
    chirp = Plan("chirp")
    assert in_times_of(AXIS, chirp) == in_times_of(AXIS, chirp, 1.5 * STEP_S)
    assert in_times_of(AXIS, chirp, 40 * STEP_S).high_hz == pytest.approx(chirp.high_hz / 2.0)


def named_end(stretch: Stretch) -> float:
    """The criterion in the end, where friction was named and what is left over was told."""
    tried = {name: library(AXIS)[name] for name in ("body.coulomb_friction", "body.quadratic_drag")}
    start = fit([stretch], (), AXIS.values, move=False)
    base = likeliest(fit([stretch], (), AXIS.values), start)
    assert base.criterion < start.criterion
    named = name_effects([stretch], tried, start, base)
    assert [one.effect.name for one in named.accepted] == ["body.coulomb_friction"]
    (sentence,) = unexplained_sentences(base)
    assert "swings: a disturbance of" in sentence and " N " in sentence and "moves x" in sentence
    return named.final.criterion


def test_what_is_left_over_has_its_unit_where_no_input_drives_it_too() -> None:
    """A ball that falls; what moves a current beside a voltage."""
    asked = {"falling": "h", "pendulum": "alpha", "axis": "x", "circuit": "i"}
    told = {name: nominal_model(name).plant.disturbance_unit(state) for name, state in asked.items()}
    assert told == {"falling": "N", "pendulum": "N m", "axis": "N", "circuit": "A/s"}


def test_friction_is_named_and_what_is_left_over_is_told() -> None:
    named_end(spaced(driven_axis(10.0)))


@pytest.mark.proof
def test_rounding_of_the_data_changes_no_name() -> None:
    given = spaced(driven_axis())
    rounded = 1.0 + 1e-9 * np.random.default_rng(1).normal(size=given.y.shape)
    again = replace(given, y=given.y * rounded, every=given.every * rounded)
    assert named_end(given) == pytest.approx(named_end(again), abs=0.5)


@pytest.mark.parametrize("far", [True, False])
def test_no_fit_of_a_base_ends_less_likely_than_it_started(far: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither by way of usual disturbances nor where nothing asks for that way."""
    if not far:
        monkeypatch.setattr(bounded_disturbance, "far_beyond", lambda found: False)
    stretch = stretch_with(shipped_plant(), "hoop", 1, 10.0)
    start = fit([stretch], (), stretch.plant.values, move=False)
    off = {name: 3.0 * value if name in stretch.plant.free else value for name, value in stretch.plant.values.items()}
    worse = fit([stretch], (), off, move=False)
    assert worse.criterion > start.criterion
    found = likeliest(worse, start)
    assert found.criterion <= start.criterion and found.free == start.free
    assert unexplained_sentences(found) == []


def test_readings_of_more_than_half_an_interval_are_all_kept() -> None:
    # 67 ms of this axis, which a reading each 40 ms does not fill twice
    slow = driven_axis(20.0, every=40)
    assert spaced(slow) == slow
