"""A screen's changes against those of whole composites, and its gains against those of refits."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from diagnose.madeup import NOISE, shipped_plant, stretch_with

from hoopd.diagnose.search.screen import (
    Column,
    Screen,
    best_scores,
    change_of,
    meaningful,
    members_of,
    touched_grids,
)
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Array, whitened
from hoopd.plants.likelihood.reference_track import Track

PLANT = shipped_plant()
LIBRARY = library(PLANT)
SMALL = 0.01
SAMPLED = {
    "actuator.torque_bias": {"b": 0.005},
    "actuator.deadzone": {"d": 0.03},
    "actuator.saturation": {"s": 0.1},
    "actuator.cogging": {"A": 0.005 * SMALL, "n": 12.0, "phi": 1.0},
    "actuator.ripple": {"a": 0.05 * SMALL, "n": 20.0, "phi": 0.0},
    "hoop.imbalance": {"A": 0.005 * SMALL, "phi": 0.5},
    "hoop.quadratic_drag": {"c": 2e-5 * SMALL},
    "ball.quadratic_drag": {"c": 2e-5 * SMALL},
}


def fitted(effects: dict[str, dict[str, float]] | None = None, seconds: float = 6.0) -> HypothesisFit:
    made = effects or {}
    values = {f"{name}.{k}": v for name, one in made.items() for k, v in one.items()}
    acting = [LIBRARY[name] for name in made]
    stretches = [stretch_with(PLANT, name, 3 + i, seconds, acting, values) for i, name in enumerate("ab")]
    return fit(stretches, (), PLANT.values, noise=dict.fromkeys("ab", NOISE), tune_noise=False)


@pytest.fixture(scope="module")
def base() -> HypothesisFit:
    return fitted()


def whole(track: Track, found: HypothesisFit, effect: Effect, values: dict[str, float]) -> Array:
    """Change of the one-step map by composites with and without the effect, nothing sampled."""
    named = {**found.values, **{effect.key(name): value for name, value in values.items()}}
    new = Track(track.stretch, [effect]).like(track)
    return np.asarray(new.after(named) - track.after(found.values, substeps=new.composite.substeps))


@pytest.mark.parametrize("name", list(SAMPLED))
def test_a_sampled_force_changes_what_the_whole_effect_changes(name: str, base: HypothesisFit) -> None:
    track, columns, found = base.tracks[0], base.columns[0], base.gains[0]
    expected = whole(track, base, LIBRARY[name], SAMPLED[name])
    f, eps = change_of(track, base, LIBRARY[name], Column(tuple(SAMPLED[name].items())))
    white = [whitened(columns.model, found, one[:, :, None], np.zeros_like(eps)[:, :, None]) for one in (f, expected)]
    assert not eps.any()
    assert np.linalg.norm(white[0] - white[1]) < 1e-3 * np.linalg.norm(white[1])


def test_what_acts_on_the_rate_with_all_its_size_is_not_sampled(base: HypothesisFit) -> None:
    effect, values = LIBRARY["actuator.back_emf_limit"], {"w0": 8.0}
    f, _ = change_of(base.tracks[0], base, effect, Column(tuple(values.items())))
    assert np.array_equal(f, whole(base.tracks[0], base, effect, values)) and f.any()


def test_an_effect_written_for_scalars_only_is_evaluated_all_the_same(base: HypothesisFit) -> None:
    effect = LIBRARY["hoop.quadratic_drag"]
    assert effect.force is not None
    own = effect.force
    scalar = replace(effect, name="hoop.own_drag", force=lambda s, e: {"theta": ca.SX(own(s, e)["theta"])})
    column = Column((("c", 2e-5),))
    known, found = (change_of(base.tracks[0], base, one, column)[0] for one in (effect, scalar))
    assert np.linalg.norm(found - known) < 0.05 * np.linalg.norm(known)


def test_a_sensor_changes_only_the_innovations(base: HypothesisFit) -> None:
    f, eps = change_of(base.tracks[0], base, LIBRARY["camera.angle_offset"], Column((("d", 0.02),)))
    assert not f.any() and np.allclose(eps[:, 2], -0.02) and not eps[:, :2].any()


def test_a_column_of_one_recording_leaves_the_others_alone(base: HypothesisFit) -> None:
    effect = LIBRARY["actuator.cogging"]
    columns = members_of(effect, ("a", "b"))[0].columns
    assert [column.recording for column in columns] == ["a", "a", "b", "b"]
    for column in columns:
        f, eps = change_of(base.tracks[1], base, effect, column)
        assert f.any() == (column.recording == "b") and not eps.any()
    screen = Screen(base, [])
    raw = screen.whitened([(effect, columns[0])])
    # but for what is projected out, nothing of it is in the rows of the other recording
    assert np.linalg.norm(raw[: len(base.rows[0])]) > 10 * np.linalg.norm(raw[len(base.rows[0]) :])


def test_changes_follow_a_reference_that_moved() -> None:
    own, effect, column = fitted(), LIBRARY["hoop.quadratic_drag"], Column((("c", 2e-5),))
    before = change_of(own.tracks[0], own, effect, column)[0]
    far = 2.0 * own.tracks[0].filtered
    own.tracks[0].moved(far, own.tracks[0].w, far, far)
    after = change_of(own.tracks[0], own, effect, column)[0]
    # a drag goes with the square of the speed
    assert np.linalg.norm(after - 4.0 * before) < 0.05 * np.linalg.norm(after)


def test_the_gain_of_a_small_linear_effect_is_that_of_its_refit() -> None:
    found = fitted({"hoop.quadratic_drag": {"c": 2e-5}}, 10.0)
    effect = LIBRARY["hoop.quadratic_drag"]
    score = Screen(found, [effect]).scores()[0]
    refit = fit(
        [track.stretch for track in found.tracks], [effect], {**found.values, **score.start}, like=found,
        noise=found.noise, tune_noise=False,
    )  # fmt: skip
    assert score.gain > 10.0
    assert found.criterion - refit.criterion == pytest.approx(score.gain, rel=0.05)
    assert refit.values["hoop.quadratic_drag.c"] == pytest.approx(score.start["hoop.quadratic_drag.c"], rel=0.1)


def test_the_effect_that_acts_gains_most_of_a_library() -> None:
    found = fitted({"camera.latency": {}, "hoop.coulomb_friction": {"Fc": 0.004}}, 10.0)
    scores = Screen(found, list(LIBRARY.values())).scores()
    best = [one.member.effect.name for one in scores[:2]]
    assert "hoop.coulomb_friction" in best and scores[0].gain > 50.0
    start = next(one.start for one in scores if one.member.effect.name == "hoop.coulomb_friction")
    assert start["hoop.coulomb_friction.Fc"] == pytest.approx(0.004, rel=0.25)
    assert all(one.gain >= later.gain for one, later in pairwise(scores))


def test_nothing_left_out_gains_little(base: HypothesisFit) -> None:
    assert Screen(base, list(LIBRARY.values())).scores()[0].gain < 15.0


def test_a_limit_starts_where_the_screen_tried_it(base: HypothesisFit) -> None:
    slip = LIBRARY["ball.slip"]
    grid = [m.shape["mu"] for m in members_of(slip, ("a", "b"), touched_grids(slip, base))]
    assert Screen(base, [slip]).scores()[0].start["ball.slip.mu"] in grid


def test_what_a_screen_has_made_is_not_made_again(base: HypothesisFit, monkeypatch: pytest.MonkeyPatch) -> None:
    effect = LIBRARY["actuator.deadzone"]
    screen, alone = Screen(base, [effect]), Screen(base, ())
    wanted = [(effect, column) for column in screen.members[3].columns]
    np.testing.assert_allclose(
        screen.whitened(wanted), alone.whitened(wanted), rtol=1e-6, atol=1e-6
    )  # kept in single precision
    monkeypatch.setattr("hoopd.diagnose.search.screen.whitened_changes", None)
    assert screen.whitened(wanted).shape[1] == len(wanted)


def test_an_effect_that_leaves_no_numbers_explains_nothing(base: HypothesisFit) -> None:
    """Not even beside one that does: the whole diagnosis ended there."""
    drag = LIBRARY["hoop.quadratic_drag"]
    assert drag.force is not None
    wild = replace(drag, name="hoop.wild_drag", force=lambda s, e: {"theta": e.c / (s.theta * 0.0)})
    found = {one.member.effect.name: one.gain for one in Screen(base, [wild, drag]).scores()}
    assert found["hoop.wild_drag"] == 0.0 and np.isfinite(found["hoop.quadratic_drag"])


def test_about_a_fit_without_numbers_nothing_is_proposed(base: HypothesisFit) -> None:
    nowhere = replace(base, rows=[np.full_like(rows, np.nan) for rows in base.rows])
    scores = Screen(nowhere, [LIBRARY["hoop.coulomb_friction"], LIBRARY["actuator.cogging"]]).scores()
    assert [one.gain for one in scores] == [0.0, 0.0]


def test_a_change_that_a_model_makes_grow_past_any_meaning_explains_nothing() -> None:
    # a lag in a loop that a gain over the speed closes: the squares of such a column have no number
    rng = np.random.default_rng(1)
    residual = rng.standard_normal(50)
    columns = np.stack([residual, residual * 1e200, residual * np.nan, residual * np.inf], axis=1)
    names = ("actuator.torque_bias", "actuator.deadzone", "hoop.quadratic_drag", "ball.quadratic_drag")
    members = [members_of(LIBRARY[name], ("a",))[0] for name in names]
    gains = [one.gain for one in best_scores(members, meaningful(columns), residual)]
    assert gains[0] == pytest.approx(residual @ residual / 2, rel=1e-6)
    assert gains[1:] == [0.0, 0.0, 0.0]
