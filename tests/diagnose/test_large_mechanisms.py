"""A mechanism so large that the likeliest disturbance follows the readings whatever is missing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from hoopd.diagnose.search.bounded_disturbance import far_beyond
from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import Named, leave_out_worthless, name_effects
from hoopd.diagnose.search.simpler_names import tell_simply
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant

Array = NDArray[np.float64]

SPRING = parse_plant(
    """
schema: hoopd.plant/1
name: spring
coordinates: {x: {unit: m, usual: 0.04, usual_rate: 0.4}}
inputs: {F: {unit: N, limit: 10}}
parameters:
  m: {value: 1.2, unit: kg, bounds: [0.1, 10]}
  c: {value: 2.5, unit: N s/m, bounds: [0, .inf]}
  k: {value: 180, unit: N/m, bounds: [10, 2000]}
equations:
  x: m*x'' = F - c*x' - k*x
energy: m/2*x'^2 + k/2*x^2
channels: {x: {reads: x, sensor: scale}}
sample_time_s: 0.01
""",
    "spring.yaml",
)
TRUE = {"m": 1.24, "c": 2.4, "k": 174.0}
HALF, FRICTION, NOISE = 5e-4, 0.35, 4e-5  # m, N, m
PARTS = 40
NEAR = ("scale.play_of_x_in_x", "scale.dahl_of_x_in_x", "scale.linear_of_x_in_x", "body.swing_of_dx", "body.play_of_x")
BESIDE_FRICTION = ("body.reversal_of_x_on_sign_dx", "body.dahl_of_x", "body.threshold_of_dx", "body.peak_of_dx")


def moved(x: float, v: float, force: float, friction: float, h: float) -> tuple[float, float]:
    """One step of the midpoint rule; dry friction against the motion, or against what would begin it."""
    pushed = force - TRUE["k"] * x
    way = np.sign(v) if v != 0.0 else np.sign(pushed)
    if v == 0.0 and abs(pushed) <= friction:
        return x, v

    def rate(x: float, v: float) -> float:
        return (force - TRUE["c"] * v - TRUE["k"] * x - way * friction) / TRUE["m"]

    half = v + h / 2.0 * rate(x, v)
    after = v + h * rate(x + h / 2.0 * v, half)
    # friction stops what it would turn round, and what it then holds stays
    return x + h * half, 0.0 if after * way < 0.0 and friction > 0.0 else float(after)


def recorded(name: str, seed: int, half: float = 0.0, friction: float = 0.0, seconds: float = 16.0) -> Stretch:
    """Forces of random levels; the scale moves behind a play of twice `half`, dry friction stops where it can."""
    random, n = np.random.default_rng(seed), round(seconds / 0.01) + 1
    t, h = np.arange(n) * 0.01, 0.01 / PARTS
    u = np.repeat(random.uniform(-4.0, 4.0, n // 25 + 1), 25)[: n - 1]
    x = v = shown = 0.0
    y = np.zeros(n)
    y[0] = shown
    for i in range(n - 1):
        for _ in range(PARTS):
            x, v = moved(x, v, u[i], friction, h)
            shown = min(max(shown, x - half), x + half)
        y[i + 1] = shown
    y += NOISE * random.normal(size=n)
    return stretch_of(name, SPRING, t, u, {"x": (np.arange(n), y)})


def searched(wanted: tuple[str, ...], half: float = 0.0, friction: float = 0.0) -> Named:
    train = [recorded("day1", 1, half, friction), recorded("day2", 2, half, friction)]
    nominal = fit(train, (), SPRING.values, move=False)
    base = fit(train, (), SPRING.values, like=nominal, noise=nominal.noise)
    known, grammar = library(SPRING), [mechanisms(SPRING)[name] for name in wanted]
    found, judge = name_effects(train, known, nominal, base, Settings()), Judge(train, known, Settings())
    name_mechanisms(found, judge, grammar)
    tell_simply(found, judge, grammar)
    leave_out_worthless(found, judge)
    return found


@cache
def behind_play() -> Named:
    return searched(NEAR, half=HALF)


def test_a_scale_behind_a_play_is_found_with_its_width_although_disturbances_explain_everything() -> None:
    found = behind_play()
    assert far_beyond(found.base)
    assert found.final.names == ("scale.play_of_x_in_x",)
    assert found.final.values["scale.play_of_x_in_x.b"] == pytest.approx(HALF, rel=0.05)
    assert found.final.values["scale.play_of_x_in_x.A"] == pytest.approx(-HALF, rel=0.05)
    for name, value in TRUE.items():
        assert found.final.values[name] == pytest.approx(value, rel=0.02)


def test_what_a_memory_holds_is_led_along_a_recording_that_no_fit_has_seen() -> None:
    """With every state that is remembered at rest the law would be linear about what it never is."""
    found = behind_play()
    held = [recorded("day3", 3, half=HALF)]

    def beside(one: HypothesisFit) -> float:
        return fit(held, one.effects, one.values, free=()).criterion

    assert beside(found.base) - beside(found.final) > 100.0


def test_a_plain_friction_keeps_its_name_beside_laws_that_have_it_as_a_limit() -> None:
    found = searched(BESIDE_FRICTION, friction=FRICTION)
    assert found.final.names == ("body.coulomb_friction",)
    assert found.final.values["body.coulomb_friction.Fc"] == pytest.approx(FRICTION, rel=0.02)


def test_what_the_others_explain_as_well_is_let_go() -> None:
    """A second name beside one that explains everything: as after a swap that nobody weighed again."""
    found = behind_play()
    whole, worthless = found.final, library(SPRING)["scale.latency"]
    judge = Judge([track.stretch for track in whole.tracks], library(SPRING), Settings())
    more = fit(judge.train, (*whole.effects, worthless), whole.values, like=whole, noise=whole.noise)
    one = found.accepted[0]
    beside = Named(found.nominal, found.base, more, [one, replace(one, effect=worthless, fit=more)])
    beside.losses = {one.effect.name: found.losses[one.effect.name], worthless.name: 0.1}
    beside.without = {one.effect.name: found.base, worthless.name: whole}
    leave_out_worthless(beside, judge)
    assert [each.effect.name for each in beside.accepted] == [one.effect.name]
    assert beside.final is whole
