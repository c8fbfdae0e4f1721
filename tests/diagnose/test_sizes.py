"""Whether anybody knows how much there is of an effect."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hoopd.diagnose.proof.confirmation import is_unsized
from hoopd.diagnose.proof.told_together import Together, together_sentence, told_together
from hoopd.ident.normal import Z95
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant

# Of inertia, friction and the motor's constant the recordings tell the ratios alone.
PLANT = """
schema: hoopd.plant/1
name: motor
coordinates: {th: {unit: rad, usual: 1, usual_rate: 30}}
inputs: {i: {unit: A, limit: 4}}
parameters:
  J: {value: 2.0e-4, unit: kg m2, bounds: [1.0e-6, 1.0e-2]}
  b: {value: 1.0e-3, unit: N m s, bounds: [0, .inf]}
  kt: {value: 0.05, unit: N m/A, bounds: [1.0e-3, 1]}
equations:
  th: J*th'' = kt*i - b*th'
channels: {th: {reads: th, sensor: encoder}}
sample_time_s: 0.01
"""
MOTOR = parse_plant(PLANT, "motor.yaml")
FRICTION, PARTS = 0.02, 40  # N m


def recorded(seed: int, friction: float) -> Stretch:
    """Levels of a current, by the midpoint rule; dry friction stops what it would turn round."""
    random, n = np.random.default_rng(seed), 1201
    t, h = np.arange(n) * 0.01, 0.01 / PARTS
    u = np.repeat(random.uniform(-2.0, 2.0, n // 30 + 1), 30)[: n - 1]
    th = w = 0.0
    shown = np.zeros(n)
    for k in range(n - 1):
        for _ in range(PARTS):
            pushed = 0.05 * u[k]
            way = float(np.sign(w)) or float(np.sign(pushed))
            if w == 0.0 and abs(pushed) <= friction:
                continue
            middle = w + h / 2.0 * (pushed - 1e-3 * w - way * friction) / 2e-4
            after = w + h * (pushed - 1e-3 * middle - way * friction) / 2e-4
            th, w = th + h * middle, 0.0 if after * way < 0.0 and friction > 0.0 else after
        shown[k + 1] = th
    return stretch_of(f"day{seed}", MOTOR, t, u, {"th": (np.arange(n), shown + 1e-3 * random.normal(size=n))})


def with_friction(friction: float) -> HypothesisFit:
    effect = library(MOTOR)["body.coulomb_friction"]
    train = [recorded(1, friction)]
    base = fit(train, (), MOTOR.values)
    start = {**base.values, "body.coulomb_friction.Fc": friction}
    return fit(train, (effect,), start, like=base, noise=base.noise)


def test_a_friction_is_known_as_well_as_the_constants_that_it_stands_beside() -> None:
    """Its interval holds zero, as those of all constants do: no recording tells how heavy the rotor is."""
    found = with_friction(FRICTION)
    name = "body.coulomb_friction.Fc"
    assert found.values[name] / found.values["J"] == pytest.approx(FRICTION / 2e-4, rel=0.05)
    assert Z95 * found.deviation(name) > found.values[name]
    assert not is_unsized(found.effects[0], found)


def test_what_the_recordings_tell_only_together_is_said_by_name() -> None:
    names = ["J", "b", "kt"]
    found = with_friction(FRICTION)
    together = told_together(found)
    assert together is not None and together.ways == 1
    assert {*together.names} == {*names, "body.coulomb_friction.Fc"}
    assert "hold one of J, b and kt that is known" in together_sentence(found)
    base = fit([track.stretch for track in found.tracks], (), MOTOR.values)
    assert told_together(base) == Together([*names], 1)
    one_held = parse_plant(PLANT.replace("bounds: [1.0e-3, 1]}", "held: true}"), "motor.yaml")
    stretches = [replace(track.stretch, plant=one_held) for track in found.tracks]
    assert told_together(fit(stretches, (), one_held.values)) is None
    assert together_sentence(fit(stretches, (), one_held.values)) == ""


def test_as_many_have_to_be_held_as_there_are_ways_to_change_without_a_trace() -> None:
    free, random = ("m", "k1", "k2", "c", "d"), np.random.default_rng(0)
    untold, _ = np.linalg.qr(np.array([[0.0, 1.0, -1.0, 0.0, 0.0], [1.0, 1.0, 0.0, 1.0, 1.0]]).T)
    rows = 50.0 * random.normal(size=(400, 5))
    rows -= rows @ untold @ untold.T
    track = SimpleNamespace(stretch=SimpleNamespace(plant=SimpleNamespace(free=free)))
    found: Any = SimpleNamespace(
        free=free,
        values=dict.fromkeys(free, 1.0),
        stacked=lambda: np.column_stack([np.zeros(400), rows]),
        tracks=[track],
    )
    assert told_together(found) == Together([*free], 2)
    assert "hold two of them that are known" in together_sentence(found)


def test_of_no_friction_nobody_knows_how_much_there_is() -> None:
    found = with_friction(0.0)
    assert is_unsized(found.effects[0], found)


def test_of_two_that_are_the_same_nobody_knows_how_much_there_is_of_each() -> None:
    found = with_friction(FRICTION)
    law = mechanisms(MOTOR)["body.linear_of_t_on_dth"].effect
    twin = replace(law, name="body.twin")
    start = {**found.values, law.key("A"): 1e-7, twin.key("A"): 1e-7}
    both = fit([track.stretch for track in found.tracks], (law, twin), start, like=found, noise=found.noise)
    assert is_unsized(law, both) and is_unsized(twin, both)
