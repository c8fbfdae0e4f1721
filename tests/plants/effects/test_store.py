"""Effects of first-order states against their formulas typed here again, in any unit of level and time."""

from __future__ import annotations

import re
from math import sqrt

import pytest

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.numeric_plant import NumericPlant
from hoopd.plants.plant_file import parse_plant

TANK = """
schema: hoopd.plant/1
name: tank
states: {{h: {{unit: {unit}, usual: {usual}}}}}
inputs: {{q: {{unit: {unit}/s, usual: {flow}}}}}
parameters: {{k: {{value: 0.05, unit: 1/s, held: true}}}}
equations: {{h: h' = q - k*h}}
sample_time_s: 1
"""
COIL = """
schema: hoopd.plant/1
name: coil
states: {i: {unit: A, usual: 2}}
inputs: {V: {unit: V, usual: 10}}
parameters: {L: 0.1 H, R: 5 ohm}
equations: {i: L*i' = V - R*i}
sample_time_s: 1e-3
"""


def tank(unit: str = "m", usual: float = 0.2, flow: float = 0.01) -> Plant:
    return parse_plant(TANK.format(unit=unit, usual=usual, flow=flow), "tank.yaml")


def missing(plant: Plant, effect: Effect, values: dict[str, float], x: float, u: float) -> float:
    """What the effect adds to the rate of the only state."""
    keys = {effect.key(name): value for name, value in values.items()}
    with_it, without = NumericPlant(plant, (effect,), keys), NumericPlant(plant)
    return float(with_it.derivative([x], u)[0] - without.derivative([x], u)[0])


@pytest.mark.parametrize("level", [0.1, 0.3])
def test_what_runs_over_from_an_empty_store_on_leaks(level: float) -> None:
    known = library(tank())
    (simple,) = known["store.overflow"].contains
    over = missing(tank(), known["store.overflow"], {"k": 0.01, "x0": 0.0}, level, 0.02)
    assert over == pytest.approx(missing(tank(), known[simple], {"k": 0.01}, level, 0.02)) != 0.0


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("leak", {"k": 0.01}, -0.01 * 0.3),
        ("constant_flow", {"c": -2e-3}, -2e-3),
        ("orifice_leak", {"c": 1e-3}, -1e-3 * sqrt(0.3)),
        ("overflow", {"k": 0.2, "x0": 0.25}, -0.2 * 0.05),
        ("overflow", {"k": 0.2, "x0": 0.35}, 0.0),
        ("varying_section", {"b": 0.5}, (0.02 - 0.05 * 0.3) * (1 / 1.15 - 1)),
    ],
)
def test_a_tank(name: str, values: dict[str, float], expected: float) -> None:
    found = missing(tank(), library(tank())[f"store.{name}"], values, 0.3, 0.02)
    assert found == pytest.approx(expected, abs=1e-15, rel=1e-12)


def test_a_coil() -> None:
    coil = parse_plant(COIL, "coil.yaml")
    effects = library(coil)
    assert missing(coil, effects["store.series_resistance"], {"k": 3.0}, 2.0, 10.0) == pytest.approx(-6.0)
    assert missing(coil, effects["store.inductor_saturation"], {"b": 0.1}, 1.0, 10.0) == pytest.approx(0.1 * 50.0)
    assert "store.overflow" not in effects


def test_sizes_are_those_of_the_state_whatever_its_unit() -> None:
    """The same tank in metres and in millimetres: every number of the unit's power is 1000 times as large."""
    powers = {"1/s": 0.0, "-": 0.0, "s": 0.0, "m": 1.0, "m/s": 1.0, "sqrt(m)/s": 0.5, "1/m": -1.0}
    small, large = library(tank()), library(tank("mm", 200.0, 10.0))
    assert [*small] == [*large]
    for name, effect in small.items():
        for one, other in zip(effect.parameters, large[name].parameters, strict=True):
            factor = 1000.0 ** powers[one.unit]
            assert [factor * v for v in (one.low, one.high, *one.grid)] == pytest.approx(
                [other.low, other.high, *other.grid], rel=0.01
            ), (name, one.name)


@pytest.mark.parametrize("name", [one for one in library(tank()) if one.startswith("store")])
def test_every_effect_says_what_it_is(name: str) -> None:
    effect = library(tank())[name]
    words = {*re.findall(r"[A-Za-z]\w*", effect.formula)}
    assert {p.name for p in effect.parameters} <= words
    assert all((effect.statement, effect.signature, effect.sign, effect.best_experiment, effect.write_back))
    assert all(partner in library(tank()) for partner in effect.near)


def test_the_grammar_has_flows_of_a_store() -> None:
    found = mechanisms(tank())
    root = found["store.root_of_h"]
    assert (root.formula, root.unit) == ("A sign(h) sqrt(|h|)", "m/s/sqrt(m)")
    assert root.sentence == "a flow into h that grows with the root of h"
    assert missing(tank(), root.effect, {"A": -1e-3}, 0.25, 0.0) == pytest.approx(-5e-4)
    assert missing(tank(), found["store.above_of_h"].effect, {"A": -0.2, "v0": 0.2}, 0.25, 0.0) == pytest.approx(-0.01)
    assert "store.linear_of_h" not in found


def test_a_drive_is_told_in_words_of_what_it_gives() -> None:
    coil, pump = library(parse_plant(COIL, "coil.yaml")), library(tank())
    assert coil["actuator.deadzone"].statement == "small demanded voltages do nothing, larger ones are smaller by d"
    assert pump["actuator.torque_bias"].statement == "the drive adds a constant input to what is demanded"
    assert "actuator.torque_bias" in pump["store.constant_flow"].near
    assert not any("torque" in effect.statement + effect.write_back for effect in (*coil.values(), *pump.values()))
