"""A fit finds the parameters and noise levels that made-up recordings were made with, within its own intervals."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnose.madeup import NOISE, shipped_plant, stretch_with

from hoopd.diagnose.search.candidates import Judge, Settings, Tried
from hoopd.diagnose.search.screen import Member, Score
from hoopd.files.shipped import or_shipped
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood import fitting
from hoopd.plants.likelihood.fitting import HypothesisFit, fit, tuned_noise
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.reference_track import Columns, Track
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.model_file import load_model

PLANT = shipped_plant()
LIBRARY = library(PLANT)
KNOWN = dict.fromkeys("ab", NOISE)
# 1 in 15,000 of a normal error
FAR = 4.0


@pytest.fixture(scope="module")
def base() -> HypothesisFit:
    stretches = [stretch_with(PLANT, name, 3 + i, 10.0) for i, name in enumerate("ab")]
    off = {name: value * (1.1 if name in PLANT.free else 1.0) for name, value in PLANT.values.items()}
    return fit(stretches, (), off)


def errors(found: HypothesisFit, truth: dict[str, float]) -> np.ndarray:
    """In standard errors."""
    return np.array([(found.values[name] - truth[name]) / found.deviation(name) for name in found.free])


def test_parameters_are_recovered_from_wrong_ones(base: HypothesisFit) -> None:
    found = errors(base, dict(PLANT.values))
    assert np.abs(found).max() < FAR
    # and the intervals are no wider than the errors: eight standard normal numbers
    assert 0.3 < np.sqrt(np.mean(found**2)) < 2.0


def test_a_fit_that_was_led_away_is_where_it_began(base: HypothesisFit, monkeypatch: pytest.MonkeyPatch) -> None:
    stretches = [track.stretch for track in base.tracks]
    again = fit(stretches, (), base.values, like=base, noise=base.noise)
    assert again.criterion == pytest.approx(base.criterion, abs=0.1)

    def led_away(found: HypothesisFit, most: int) -> None:
        found.values = {name: value * (1.5 if name in found.free else 1.0) for name, value in found.values.items()}
        found.criterion = base.criterion + 500.0

    monkeypatch.setattr(fitting, "_search", led_away)
    kept = fit(stretches, (), base.values, like=base, noise=base.noise)
    assert kept.values == pytest.approx(base.values)
    assert kept.criterion == pytest.approx(base.criterion, abs=1.0)
    assert np.diag(kept.covariance) == pytest.approx(np.diag(base.covariance), rel=0.1)


def test_a_search_that_led_away_ends_where_it_was_likeliest_only_if_asked(
    base: HypothesisFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As steps that make a fit likelier once, and then less so twice."""
    steps: list[float] = []

    def stepped(found: HypothesisFit, _: np.ndarray) -> bool:
        steps.append([0.99, 1.02, 1.05][len(steps) % 3])
        found.values = {**found.values, "K2": base.values["K2"] * steps[-1]}
        found.rows = [steps[-1] * rows for rows in base.rows]
        return True

    monkeypatch.setattr(fitting, "_stepped", stepped)
    monkeypatch.setattr(fitting, "SETTLED", 0.0)
    for most_worse, ends_at in ((np.inf, 1.05), (0.5, 0.99)):
        found = replace(fitting._kept(base), rows=list(base.rows), most_worse=most_worse)
        fitting._search(found, 3)
        assert found.values["K2"] == pytest.approx(base.values["K2"] * ends_at)
    stretches = [track.stretch for track in base.tracks]
    monkeypatch.undo()
    assert fit(stretches, (), base.values, like=found, noise=base.noise).most_worse == found.most_worse


def test_a_halved_step_goes_a_share_of_the_way_of_the_trajectory(base: HypothesisFit) -> None:
    (track, *_) = (copy(one) for one in base.tracks)
    before = (track.z, track.w, track.filtered, track.predicted)
    track.moved(*(one + 4.0 for one in before))
    fitting._draw_back([track], [before], 0.25)
    for old, new in zip(before, (track.z, track.w, track.filtered, track.predicted), strict=True):
        np.testing.assert_allclose(new, old + 1.0)


def test_noise_levels_are_recovered(base: HypothesisFit) -> None:
    for noise in base.noise.values():
        assert np.allclose(noise.reading, NOISE.reading, rtol=0.25)
        assert np.allclose(np.log(noise.force), np.log(NOISE.force), atol=0.5)


def test_whitened_residuals_are_white_and_of_unit_size(base: HypothesisFit) -> None:
    e = base.rows[0][:, 0].reshape(-1, 3)
    assert np.allclose(np.std(e, axis=0), 1.0, atol=0.15)
    lag_one = np.mean(e[1:] * e[:-1], axis=0)
    assert np.abs(lag_one).max() < 4.0 / np.sqrt(len(e))


def test_gradient_of_the_criterion_vanishes_at_the_fit(base: HypothesisFit) -> None:
    rows = base.stacked()
    by = rows[:, 1:].T @ rows[:, 0]
    # what is left of a Gauss-Newton step: less than the tenth of a standard error at which it ends
    assert np.abs(base.covariance @ by / np.sqrt(np.diag(base.covariance))).max() < 0.2


def test_a_second_tuning_stays_where_the_first_ended(base: HypothesisFit) -> None:
    before = {name: np.concatenate(noise) for name, noise in base.noise.items()}
    tuned_noise(base, near=True)
    for name, noise in base.noise.items():
        assert np.allclose(np.log(np.concatenate(noise)), np.log(before[name]), atol=0.1)


@pytest.fixture(scope="module")
def calm() -> Stretch:
    """A recording without any disturbance, under a fast torque of two levels."""
    torque = 0.1 * np.random.default_rng([2, 7]).choice([-1.0, 1.0], 1000)
    return stretch_with(PLANT, "calm", 2, 20.0, noise=NOISE._replace(force=1e-6 * np.ones(2)), u=torque)


def begun_high(calm: Stretch) -> HypothesisFit:
    """Its fit, begun with a disturbance that is far too large."""
    off = {name: value * (1.1 if name in PLANT.free else 1.0) for name, value in PLANT.values.items()}
    return fit([calm], (), off, noise={"calm": NOISE._replace(force=10.0 * NOISE.force, reading=3.0 * NOISE.reading)})


def test_levels_of_a_disturbance_that_is_not_there_go_all_the_way_down(calm: Stretch) -> None:
    found = begun_high(calm)
    best = fit([calm], (), PLANT.values, like=found, noise={"calm": NOISE._replace(force=1e-5 * np.ones(2))})
    assert found.criterion - best.criterion < 1.0


def test_what_only_better_noise_levels_gain_names_nothing(calm: Stretch, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search for them stood still in the fit before, and not in the fit with an effect that is not there."""
    monkeypatch.setattr(fitting, "MOST_TURNS", 1)
    before, drag = begun_high(calm), LIBRARY["hoop.quadratic_drag"]
    new = fit([calm], [drag], PLANT.values, noise={"calm": NOISE._replace(force=1e-5 * np.ones(2))})
    gain, score = before.criterion - new.criterion, Score(Member(drag, {}, ()), 0.0, {}, np.zeros(0))
    assert gain > 2.0 * (threshold := Settings().threshold)
    (found,) = Judge([calm], {}, Settings()).of_effects(before, [Tried(drag, new, gain, gain, score)])
    assert found.gain < threshold and found.surprise < threshold


def test_an_effect_is_refitted_within_its_interval_and_a_neutral_one_gains_nothing() -> None:
    truth = {"hoop.coulomb_friction.Fc": 0.004}
    friction = LIBRARY["hoop.coulomb_friction"]
    stretches = [stretch_with(PLANT, name, 5 + i, 10.0, [friction], truth) for i, name in enumerate("ab")]
    without = fit(stretches, (), PLANT.values, noise=KNOWN, tune_noise=False)
    start = {**without.values, "hoop.coulomb_friction.Fc": 0.002}
    found = fit(stretches, [friction], start, like=without, noise=KNOWN, tune_noise=False)
    assert without.criterion - found.criterion > 20.0
    assert np.abs(errors(found, {**PLANT.values, **truth})).max() < FAR
    held = fit(
        stretches, [LIBRARY["hoop.quadratic_drag"]], without.values, like=without, noise=KNOWN, free=without.free,
        tune_noise=False,
    )  # fmt: skip
    assert held.criterion == pytest.approx(without.criterion, abs=0.02)


def test_a_phase_belongs_to_its_recording() -> None:
    imbalance = LIBRARY["hoop.imbalance"]
    phases = {"a": 0.5, "b": -1.5}
    made = {name: {"hoop.imbalance.A": 0.01, "hoop.imbalance.phi": phi} for name, phi in phases.items()}
    stretches = [stretch_with(PLANT, name, 9 + i, 10.0, [imbalance], made[name]) for i, name in enumerate("ab")]
    start = {**PLANT.values, "hoop.imbalance.A": 0.008, "hoop.imbalance.phi@a": 0.3, "hoop.imbalance.phi@b": -1.2}
    found = fit(stretches, [imbalance], start, noise=KNOWN, tune_noise=False)
    assert found.free[-3:] == ("hoop.imbalance.A", "hoop.imbalance.phi@a", "hoop.imbalance.phi@b")
    truth = {**PLANT.values, "hoop.imbalance.A": 0.01, **{f"hoop.imbalance.phi@{k}": v for k, v in phases.items()}}
    assert np.abs(errors(found, truth)).max() < FAR


def test_a_parameter_on_the_end_of_its_range_gains_nothing_by_wanting_to_leave_it() -> None:
    """Data that ask for a negative drag, which there is not: without it they are explained exactly as well."""
    drag = LIBRARY["hoop.quadratic_drag"]
    data = [stretch_with(PLANT, "a", 5, 10.0, (drag,), {"hoop.quadratic_drag.c": -5e-6})]
    base = fit(data, (), PLANT.values, noise=KNOWN, tune_noise=False)
    with_it = fit(data, (drag,), base.values, noise=KNOWN, tune_noise=False, like=base)
    assert with_it.values["hoop.quadratic_drag.c"] == 0.0
    assert abs(base.criterion - with_it.criterion) < 0.1


def test_a_step_to_where_there_is_no_such_plant_is_halved(base: HypothesisFit, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first steps of a search end where nothing is finite; the fit is that of the smaller ones."""
    stretches = [track.stretch for track in base.tracks]
    off = {**base.values, "K2": 1.5 * base.values["K2"]}
    direct, asked = Track.columns, []

    def columns(self: Track, values: dict[str, float], free: tuple[str, ...]) -> Columns:
        found = direct(self, values, free)
        asked.append(values["K2"])
        return replace(found, f=np.full_like(found.f, np.nan)) if 2 < len(asked) < 7 else found

    monkeypatch.setattr(Track, "columns", columns)
    found = fit(stretches, (), off, noise=base.noise, tune_noise=False)
    distances = [off["K2"] - k for k in (asked[2], asked[4])]
    assert distances[1] == pytest.approx(distances[0] / 2.0)  # two recordings: each step asks twice
    assert found.values["K2"] == pytest.approx(base.values["K2"], abs=0.2 * base.deviation("K2"))


def test_a_fit_held_to_small_disturbances_does_not_run_away_along_what_the_data_hardly_know() -> None:
    """A late camera and parameters that are not the device's: whole steps end at a mass of minus many kilograms."""
    values = load_model(or_shipped(Path("models/hoop.yaml"))).values()
    plant = hoop_plant("rolling", values, "both")
    late = library(plant)["camera.latency"]
    made = stretch_with(plant, "a", 3, 10.0, [late], {"camera.latency.d": 0.03}, torque=0.3)
    few = Noise(0.1 * NOISE.force, NOISE.time_s, NOISE.reading)
    off = {**values, "mb": 5.0 * values["mb"], "Ib": 0.5 * values["Ib"]}
    found = fit([made], (), off, noise={"a": few}, tune_noise=False)
    assert np.isfinite(found.criterion)
    assert 0.0 < found.values["mb"] < 1.0
    assert found.values["Ib"] > 0.0


def test_a_start_without_finite_numbers_is_the_least_likely_of_all(base: HypothesisFit) -> None:
    stretches = [track.stretch for track in base.tracks]
    found = fit(stretches, (), {**base.values, next(iter(base.free)): np.inf}, noise=base.noise)
    assert found.criterion == np.inf


def test_what_moves_readings_beyond_all_numbers_is_the_least_likely_of_all(base: HypothesisFit) -> None:
    """Its change is a number, and the sum of its squares is none."""
    wild = Effect(
        "hoop.wild",
        (EffectParameter("A", "N m", 0.0, -1.0, 1.0),),
        force=lambda s, e: {"theta": e.A * 1e170 * (1.0 + s.psi**2)},
    )
    stretches = [track.stretch for track in base.tracks]
    found = fit(stretches, (wild,), base.values, like=base, noise=base.noise)
    assert found.criterion == np.inf and found.values["hoop.wild.A"] == 0.0
