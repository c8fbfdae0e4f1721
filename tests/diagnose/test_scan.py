"""Vibration and pushes are found where they are, at the size they have, and not where they are not."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from diagnose.madeup import NOISE, shipped_plant, stretch_with

from hoopd.diagnose.search.adjoint import DRAW_SEED, DRAWS, Adjoint, independent
from hoopd.diagnose.search.scan import places, scan
from hoopd.diagnose.search.screen import Column, Screen
from hoopd.diagnose.search.surprise import log_chance
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter, phase
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.stretches import Stretch

PLANT = shipped_plant()
LIBRARY = library(PLANT)
TONE, PULSE = LIBRARY["frame.vibration"], LIBRARY["external.disturbance"]
# Where a scan's best of a null lies above with a chance of 1 in 3000.
BY_CHANCE = 8.0
NAMED = 25.0


def fitted(stretches: list[Stretch], noise: Noise = NOISE) -> HypothesisFit:
    """With the noise that the data were made with."""
    return fit(stretches, (), PLANT.values, noise=dict.fromkeys(["a", "b"], noise), tune_noise=False)


@pytest.fixture(scope="module")
def null() -> Screen:
    return Screen(fitted([stretch_with(PLANT, name, 7 + i, 8.0) for i, name in enumerate("ab")]), ())


@pytest.fixture(scope="module")
def shaken() -> Screen:
    true = {"frame.vibration.A": 0.25, "frame.vibration.w": 17.3}
    made = [
        stretch_with(PLANT, name, 20 + i, 8.0, [TONE], {**true, "frame.vibration.phi": phi})
        for i, (name, phi) in enumerate((("a", 1.0), ("b", -2.0)))
    ]
    return Screen(fitted(made), ())


@pytest.fixture(scope="module")
def pushed() -> Screen:
    true = {"external.disturbance.t0": 3.313, "external.disturbance.t1": 3.87, "external.disturbance.A": 0.02}
    made = [stretch_with(PLANT, "a", 30, 8.0), stretch_with(PLANT, "b", 31, 8.0, [PULSE], true)]
    return Screen(fitted(made), ())


def test_the_adjoint_scores_a_force_as_the_exact_way_does(null: Screen) -> None:
    column = Column((("t0", 4.0), ("t1", 4.4), ("A", 0.007)), "b")
    z = null.whitened([(PULSE, column)])[:, 0]
    answer = Adjoint(null).to_effect(PULSE, {"A": 0.007, "t0": -1e6, "t1": 1e6})[1]
    inside = (answer.t > 4.0 - 1e-6) & (answer.t < 4.4 - 1e-6)
    white = null.projected(np.random.default_rng(DRAW_SEED).standard_normal((len(z), DRAWS)))
    exact = np.concatenate([[z @ null.residual], z @ white])
    assert answer.recording == "b"
    assert answer.slope[inside].sum(axis=0) == pytest.approx(exact, abs=0.03 * float(np.linalg.norm(z)))


def test_nothing_is_found_where_there_is_nothing(null: Screen) -> None:
    for effect in (TONE, PULSE):
        best = scan(null, effect)
        assert best is not None and best.candidates > 20.0
        assert best.threshold_equivalent < BY_CHANCE


def test_a_vibration_is_found_with_frequency_amplitude_and_phases(shaken: Screen) -> None:
    best = scan(shaken, TONE)
    assert best is not None and best.threshold_equivalent > NAMED
    assert best.start["frame.vibration.w"] == pytest.approx(17.3, abs=0.1)
    assert best.start["frame.vibration.A"] == pytest.approx(0.25, rel=0.3)
    for recording, phi in (("a", 1.0), ("b", -2.0)):
        assert best.start[f"frame.vibration.phi@{recording}"] == pytest.approx(phi, abs=0.6)
    gains = [one.gain for one in places(shaken, TONE)]
    assert gains == sorted(gains, reverse=True) and gains[0] > 2.0 * gains[1]


def test_a_push_is_found_in_its_recording_and_the_fit_keeps_it_there(pushed: Screen) -> None:
    best = scan(pushed, PULSE)
    assert best is not None and best.threshold_equivalent > NAMED
    assert best.start["external.disturbance.t0@b"] == pytest.approx(3.313, abs=0.02)
    assert best.start["external.disturbance.t1@b"] == pytest.approx(3.87, abs=0.02)
    assert best.start["external.disturbance.t0@a"] == best.start["external.disturbance.t1@a"]
    base = pushed.fit
    stretches = [track.stretch for track in base.tracks]
    whole = fit(
        stretches, [PULSE], {**base.values, **best.start}, like=base, noise=base.noise, tune_noise=False
    )  # fmt: skip
    assert "external.disturbance.t0@b" in whole.free and "external.disturbance.t0@a" not in whole.free
    assert base.criterion - whole.criterion == pytest.approx(best.gain, rel=0.05)
    assert whole.values["external.disturbance.A"] == pytest.approx(
        0.02, abs=4 * whole.deviation("external.disturbance.A")
    )
    # nothing in the other recording, nor in one that is not known yet
    for track in whole.tracks:
        track.stretch = Stretch("new", PLANT, track.stretch.t, track.stretch.u, track.stretch.y)
        values = whole.values
        without = {**values, "external.disturbance.A": 0.0}
        assert np.array_equal(track.after(values), track.after(without))


# ---------------------------------------------------------------------------------------------- another plant

CART = Plant(
    name="cart",
    coordinates=("x",),
    accelerations=lambda s, force: (force - s.p["b"] * s.dx) / s.p["m"],
    values={"m": 0.5, "b": 0.2},
    free=("m", "b"),
    inputs=(Input("u", "N", 2.0, "x"),),
    channels={"x": Channel("x")},
    slots={"drive": Slot("actuator", "x"), "hand": Slot("push", "x"), "floor": Slot("floor", "x")},
)
HUM = Effect(
    "floor.hum",
    (
        EffectParameter("A", "N", 0.0, 0.0, 1.0, grid=(0.02,)),
        EffectParameter("omega", "rad/s", 5.0, 3.0, 40.0, "shape"),
        phase("turn", per_recording=True),
    ),
    force=lambda s, e: {"x": e.A * ca.sin(e.omega * s.t + e.turn)},
    found_by="scan",
)
POWER = Effect(
    "floor.power",
    (EffectParameter("c", "-", 0.0, 0.0, 1.0, grid=(0.1,)), EffectParameter("n", "-", 2, 2, 4, "shape", (2.0, 3.0))),
    force=lambda s, e: {"x": -e.c * s.dx * ca.fabs(s.dx) ** (e.n - 1)},
    found_by="scan",
)
CART_NOISE = Noise(np.array([0.02]), np.array([0.1]), np.array([1e-3]))


@pytest.mark.parametrize(
    ("effect", "true"),
    [
        (HUM, {"floor.hum.A": 0.15, "floor.hum.omega": 11.7, "floor.hum.turn@a": 0.7}),
        (library(CART)["hand.disturbance"], {"hand.disturbance.t0@a": 4.2, "hand.disturbance.t1@a": 4.9}),
        (POWER, {"floor.power.c": 0.6, "floor.power.n": 3.0}),
    ],
)
def test_any_plant_and_any_names(effect: Effect, true: dict[str, float]) -> None:
    size = {} if effect.slot == "floor" else {"hand.disturbance.A": 0.3}
    values = {**{name.split("@")[0]: value for name, value in true.items()}, **size}
    made = stretch_with(CART, "a", 50, 10.0, [effect], values, torque=1.0, noise=CART_NOISE)
    base = fit([made], (), CART.values, noise={"a": CART_NOISE}, tune_noise=False)
    best = scan(Screen(base, ()), effect)
    assert best is not None and best.threshold_equivalent > NAMED
    # a start is one step from a base without the effect; how well an amplitude is known, its gain says: z^2 = 2 gain
    share = {"floor.power.c": 2.0 / np.sqrt(2.0 * best.gain)}
    for name, value in true.items():
        assert best.start[name] == pytest.approx(value, rel=max(0.15, share.get(name, 0.0)), abs=0.03), name


def test_the_fit_from_a_start_is_right_within_its_interval() -> None:
    # the start of a strong effect falls short: the base without it takes part of it up and bends the filter's states
    true, z = {"floor.power.c": 0.6, "floor.power.n": 3.0}, []
    for seed in range(50, 58):
        made = stretch_with(CART, "a", seed, 10.0, [POWER], true, torque=1.0, noise=CART_NOISE)
        start = {**CART.values, **true, "floor.power.c": 0.45}
        whole = fit([made], [POWER], start, noise={"a": CART_NOISE}, tune_noise=False, free=("m", "b", "floor.power.c"))
        z.append((whole.values["floor.power.c"] - 0.6) / whole.deviation("floor.power.c"))
    assert np.max(np.abs(z)) < 3.0
    assert abs(np.mean(z)) < 3.0 / np.sqrt(len(z)) and 0.3 < np.std(z) < 1.6


def test_an_effect_that_no_recording_can_show_or_that_is_in_already_has_no_place(null: Screen) -> None:
    made = stretch_with(CART, "a", 60, 4.0, torque=1.0, noise=CART_NOISE)
    base = fit([made], (), CART.values, noise={"a": CART_NOISE}, tune_noise=False)
    assert scan(Screen(base, ()), TONE) is None and scan(Screen(base, ()), PULSE) is None
    base.effects = (HUM,)
    assert scan(Screen(base, ()), HUM) is None


def test_chance_of_a_gain_is_that_of_chi_square() -> None:
    random = np.random.default_rng(0)
    for freedom in (1, 2, 3):
        gains = random.chisquare(freedom, (4000, 100)) / 2.0
        share = float(np.mean(gains[:, 0] > 2.0))
        assert np.exp(log_chance(2.0, freedom)) == pytest.approx(share, abs=0.02)
        assert independent(gains.max(axis=1), freedom) == pytest.approx(100.0, rel=0.15)
    # far out, where the function of the library underflows
    assert log_chance(600.0, 3) == pytest.approx(log_chance(499.0, 3) - 101.0 + 0.5 * np.log(600.0 / 499.0), abs=1e-3)
