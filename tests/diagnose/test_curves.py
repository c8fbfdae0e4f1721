"""Curves: hats, what they change to first order, the law of their gains by chance."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from diagnose.madeup import NOISE, shipped_plant, stretch_with
from scipy.stats import chi2

from hoopd.diagnose.curves.curve import curves
from hoopd.diagnose.curves.curve_fits import fitted_shapes, shapes_of, together
from hoopd.diagnose.curves.curve_screen import CurveScreen, by_slot, null_quantiles
from hoopd.diagnose.curves.curve_sites import wanted
from hoopd.diagnose.curves.hats import curve_expression, hats, spread_knots, turn_knots
from hoopd.diagnose.search.chance import Group, colour, drawn_maxima, null_of
from hoopd.diagnose.search.screen import Column, change_of
from hoopd.diagnose.search.surprise import log_chances
from hoopd.files.shipped import or_shipped
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.model_file import load_model


@pytest.mark.parametrize("n", [60, 61])
def test_a_residual_inflates_gains_by_its_spectrum_along_the_directions(n: int) -> None:
    random = np.random.default_rng(4)
    unit = np.linalg.qr(random.normal(size=(2 * n, 3)))[0]
    residual = 2.0 * np.sin(0.4 * np.arange(2 * n)) + random.normal(size=2 * n)
    rest = (residual - unit @ (unit.T @ residual)).reshape(n, 2)
    along = [np.sum(np.roll(one.reshape(n, 2), k, axis=0) * rest) for one in unit.T for k in range(n)]
    assert colour(unit, residual, [(n, 2)]) == pytest.approx(max(1.0, float(np.mean(np.square(along)))), rel=1e-9)


def cart() -> Plant:
    """A mass on a slide, position measured, force commanded."""
    return Plant(
        name="cart",
        coordinates=("x",),
        accelerations=lambda s, force: (force - s.p["d"] * s.dx) / s.p["m"],
        values={"m": 0.5, "d": 0.3},
        free=("m", "d"),
        inputs=(Input("u", "N", 2.0, "x"),),
        channels={"position": Channel("x")},
        slots={
            "motor": Slot("actuator", "x"),
            "slide": Slot("body", "x", speed=0.5),
            "ruler": Slot("sensor", "x", ("position",)),
        },
    )


@pytest.fixture(scope="module")
def clean() -> HypothesisFit:
    """The base fitted to two recordings without any effect."""
    plant = shipped_plant()
    return fit([stretch_with(plant, f"r{seed}", seed, 8.0) for seed in (1, 2)], (), plant.values)


@pytest.fixture(scope="module")
def screened(clean: HypothesisFit) -> CurveScreen:
    return CurveScreen(clean)


def test_hats_share_one_everywhere_and_agree_with_the_expression() -> None:
    x = np.linspace(-9.0, 9.0, 91)
    for knots, period in ((spread_knots(np.linspace(-3.0, 2.0, 500), 6), None), (turn_knots(8, 2 * np.pi), 2 * np.pi)):
        values = np.cos(np.arange(len(knots)) ** 2)
        assert hats(x, knots, period).sum(axis=-1) == pytest.approx(1.0)
        s = ca.SX.sym("s")
        expression = ca.Function("f", [s], [curve_expression(s, knots, values, period)])
        assert np.ravel(expression(x[None]).full()) == pytest.approx(hats(x, knots, period) @ values, abs=1e-12)


def test_knots_of_a_two_level_signal_are_its_levels() -> None:
    knots = spread_knots(np.array([-0.1, 0.1] * 50), 6)
    assert len(knots) == 2


def test_a_curve_beyond_its_knots_keeps_its_last_value() -> None:
    assert hats(np.array([-50.0, 50.0]), np.array([-1.0, 0.0, 2.0])) == pytest.approx(
        np.array([[1, 0, 0], [0, 0, 1.0]])
    )


@pytest.mark.parametrize("columns", [1, 2, 6, 41])
def test_the_chance_of_a_gain_is_that_of_chi_squared(columns: int) -> None:
    gains = np.array([0.1, 3.0, 40.0, 300.0])
    known = chi2.logsf(2 * gains, columns)
    assert log_chances(gains, columns) == pytest.approx(known, rel=1e-9, abs=1e-12)
    # beyond the table: the same law goes on, a nat a nat
    far = log_chances(np.array([700.0, 2000.0, 2001.0]), columns)
    assert np.all(np.isfinite(far))
    assert far[2] - far[1] == pytest.approx(-1.0 + (columns / 2 - 1) / 2000.0, abs=1e-3)


def test_the_threshold_is_exceeded_as_often_as_it_says() -> None:
    rng = np.random.default_rng(5)
    groups = [Group(rng.standard_normal((400, m))) for m in (1, 1, 2, 6, 6, 12) for _ in range(4)]
    null = null_of(groups, draws=200, seed=1)
    best = -drawn_maxima(groups, 3000, seed=2)
    for chance in (0.1, 0.02):
        assert np.mean(best > null.threshold(chance)) == pytest.approx(chance, rel=0.5)


def test_every_slot_of_the_hoop_has_curves(clean: HypothesisFit) -> None:
    found = {(curve.slot, *curve.depends_on) for curve in curves(clean)}
    assert {
        ("hoop", "dtheta"), ("hoop", "theta"), ("actuator", "u"), ("actuator", "u", "dtheta"), ("camera", "psi"),
        ("camera", "dpsi"), ("encoder", "theta"), ("ball", "psi"), ("ball", "dtheta-dpsi"), ("external", "t"),
    } <= found  # fmt: skip
    names = [curve.name for curve in curves(clean)]
    assert len(set(names)) == len(names)


def test_a_plant_of_another_kind_has_curves_by_its_own_names() -> None:
    found = {(site.slot, variable.name, variable.unit, variable.period) for site, variable, _ in wanted(cart())}
    assert ("slide", "dx", "m/s", None) in found and ("motor", "u", "N", None) in found
    assert ("ruler", "x", "m", None) in found
    assert not any("theta" in name or "psi" in name for _, name, _, _ in found)


def test_the_columns_are_those_of_the_effect(clean: HypothesisFit, screened: CurveScreen) -> None:
    track = clean.tracks[0]
    chosen = {"theta": 1e-6, "u": 1e-4, "psi": 1e-6}
    for variable, step in chosen.items():
        index, curve = next(
            (i, c) for i, c in enumerate(screened.curves) if c.depends_on == (variable,) and not c.per_recording
        )
        f, eps = screened._changes(track, range(len(screened.curves)))
        own = slice(screened._first[index], screened._first[index + 1])
        for k in (1, 3):
            values = {**curve.effect.neutral(), f"c{k}": step}
            expected = change_of(track, clean, curve.effect, Column(tuple(values.items())))
            for mine, exact in zip((f[:, :, own][:, :, k], eps[:, :, own][:, :, k]), expected, strict=True):
                # a knot passed within a step is met by four parts of it
                assert np.linalg.norm(mine - exact / step) <= 0.02 * np.linalg.norm(exact / step)


def test_what_the_base_has_already_is_no_surprise(screened: CurveScreen) -> None:
    # a coefficient of the rate that is the same at all angles is the base's J11 and J21
    index = next(i for i, c in enumerate(screened.curves) if c.slot == "hoop" and c.depends_on == ("dtheta", "theta"))
    score = screened.score(index, screened.residual)
    assert score.columns == len(score.curve.knots) - 1


def test_a_clean_data_set_stays_below_its_threshold(screened: CurveScreen) -> None:
    null = null_quantiles(None, screened)
    assert screened.scores()[0].surprise < null.threshold(0.01)
    assert 10.0 < null.tries < 2 * len(screened.curves)


def test_a_map_of_the_torque_is_found_where_it_sits() -> None:
    def map_of_torque(s: object, e: object) -> object:
        # a gain that falls with the square of the demand
        return s.u - e.k * s.u**3  # type: ignore[attr-defined]

    plant = shipped_plant()
    hidden = Effect("actuator.cubic", (EffectParameter("k", "-", 0, 0, 9),), torque=map_of_torque, order=3)
    made = stretch_with(plant, "r", 3, 10.0, [hidden], {"actuator.cubic.k": 3.0})
    scores = CurveScreen(fit([made], (), plant.values)).scores()
    assert (scores[0].curve.slot, scores[0].curve.depends_on) == ("actuator", ("u",))
    assert max(one.surprise for slot, one in by_slot(scores).items() if slot != "actuator") < scores[0].surprise / 2


@pytest.mark.parametrize("first", ["hoop", "both"])
def test_recordings_of_hoop_alone_and_of_both_stand_side_by_side(first: str) -> None:
    """They have two and three channels."""
    values = load_model(or_shipped(Path("models/hoop.yaml"))).values()
    kinds = (first, "both" if first == "hoop" else "hoop")
    alone = Noise(NOISE.force[:1], NOISE.time_s[:1], NOISE.reading[:2])
    noise = {"hoop": alone, "both": NOISE}
    data = [stretch_with(hoop_plant("rolling", values, kind), kind, 3, 8.0, noise=noise[kind]) for kind in kinds]
    found = CurveScreen(fit(data, (), values))
    scores = found.scores()
    assert all(np.isfinite(one.surprise) for one in scores)
    assert abs(sum(found.shares(scores[0].vector).values()) - 1.0) < 1e-9


def test_curves_of_the_ball_are_fitted_beside_recordings_of_the_hoop_alone() -> None:
    """One that reads psi, and one that each recording has for itself at a slot that only two of them have."""
    values = load_model(or_shipped(Path("models/hoop.yaml"))).values()
    alone = Noise(NOISE.force[:1], NOISE.time_s[:1], NOISE.reading[:2])
    data = [
        stretch_with(hoop_plant("rolling", values, kind), f"{kind}{seed}", seed, 6.0, noise=noise)
        for kind, seed, noise in (("hoop", 1, alone), ("both", 2, NOISE), ("both", 3, NOISE))
    ]
    base = fit(data, (), values)
    screen = CurveScreen(base)
    hoop_of_ball = next(c for c in screen.curves if c.slot == "hoop" and c.depends_on == ("psi",))
    own = next(c for c in screen.curves if c.slot == "camera" and c.per_recording)
    assert [hoop_of_ball.fits(one.plant) for one in data] == [False, True, True]
    scores = [screen.score(screen._index(one), screen.residual) for one in (hoop_of_ball, own)]
    joint, made = together(scores, base)
    assert np.isfinite(joint.criterion)
    shapes = fitted_shapes(made[1], joint, joint.recordings)
    assert [one.recording for one in shapes] == ["both2", "both3"]
    assert [one.recording for one in shapes_of(scores[1], screen.recordings)] == ["both2", "both3"]


def test_recordings_of_different_parts_have_the_curves_of_both() -> None:
    values = load_model(or_shipped(Path("models/hoop.yaml"))).values()
    only = {"hoop": Noise(NOISE.force[:1], NOISE.time_s[:1], NOISE.reading[:2]),
            "ball": Noise(NOISE.force[1:], NOISE.time_s[1:], NOISE.reading[2:])}  # fmt: skip
    data = [stretch_with(hoop_plant("rolling", values, kind), kind, 3, 6.0, noise=only[kind]) for kind in only]
    slots = {one.slot for one in curves(fit(data, (), values))}
    assert {"hoop", "actuator", "encoder", "ball", "camera"} <= slots


def test_torque_lost_while_the_drive_brakes_is_seen_at_the_actuator() -> None:
    """After every reversal: neither the demand nor the speed alone shows it."""

    def lost(s: object, e: object) -> object:
        return s.u * (1.0 - e.k * (s.u * s.dtheta < 0))  # type: ignore[attr-defined]

    plant = shipped_plant()
    hidden = Effect("actuator.brake", (EffectParameter("k", "-", 0, 0, 1),), torque=lost, order=3)
    made = stretch_with(plant, "r", 3, 16.0, [hidden], {"actuator.brake.k": 0.1})
    best = CurveScreen(fit([made], (), plant.values)).scores()[0]
    assert (best.curve.slot, best.curve.depends_on) == ("actuator", ("u", "u*dtheta"))
    assert best.curve.variable.unit == "W"


def test_a_recording_of_ten_minutes_has_no_more_knots_over_time_than_memory_takes() -> None:
    from hoopd.diagnose.curves.curve import MOST_OVER_TIME, _knot_sets
    from hoopd.diagnose.curves.curve_sites import TIME

    (knots,) = _knot_sets(TIME, np.linspace(0.0, 600.0, 30001))
    assert len(knots) == MOST_OVER_TIME
