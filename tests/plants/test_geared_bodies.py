"""Bodies joined through a gear or a belt: the difference that twists it is a variable of what may be missing."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.grammar.axes import relative
from hoopd.plants.effects.grammar.mechanisms import mechanism_named, mechanisms
from hoopd.plants.plant_file import parse_plant

BELT = """
schema: hoopd.plant/1
name: belt
coordinates: {th1: {unit: rad, usual: 10, usual_rate: 25}, th2: {unit: rad, usual: 3, usual_rate: 6}}
inputs: {tau: {unit: N m, limit: 0.05}}
parameters:
  J1: {value: 2.2e-4, unit: kg m2, bounds: [1.0e-6, 1]}
  J2: {value: 3.6e-3, unit: kg m2, bounds: [1.0e-6, 1]}
  N: {value: 4, unit: "-", held: true}
  k: {value: 0.18, unit: N m/rad, bounds: [0.001, 100]}
  own: {value: 0.1, unit: N m/rad, held: true}
equations:
  th1: J1*th1'' = tau - own*th1 - k*(th1 - N*th2)
  th2: J2*th2'' = N*k*(th1 - N*th2) - own*th2
sample_time_s: 0.005
"""
RACK = """
schema: hoopd.plant/1
name: rack
coordinates: {a: {unit: rad, usual: 3, usual_rate: 6}, x: {unit: m, usual: 0.1, usual_rate: 0.5}}
inputs: {tau: {unit: N m, limit: 1}}
parameters:
  J: {value: 1.0e-3, unit: kg m2, bounds: [1.0e-6, 1]}
  m: {value: 1, unit: kg, bounds: [0.1, 10]}
  R: {value: 0.02, unit: m, held: true}
  k: {value: 500, unit: N/m, bounds: [1, 1.0e+5]}
equations:
  a: J*a'' = tau - R*k*(R*a - x)
  x: m*x'' = k*(R*a - x)
sample_time_s: 0.005
"""


def parsed(text: str) -> Plant:
    return parse_plant(text, "plant.yaml")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (BELT, {("th1", "th2"): 4.0}),
        (BELT.replace("(th1 - N*th2)", "(-N*th2 + th1)"), {("th1", "th2"): 4.0}),
        (BELT.replace("N*", ""), {}),
        (BELT.replace("k*(th1 - N*th2)", "k*th1 + N*k*th2"), {}),
        (BELT.replace("N: {value: 4,", "N: {value: -4,"), {("th1", "th2"): -4.0}),
        # a ratio that is fitted is none that a law may keep, and gravity on a sum of angles joins nothing
        (BELT.replace('unit: "-", held: true', 'unit: "-", bounds: [1, 10]'), {}),
        (BELT.replace("k*(th1 - N*th2)", "k*sin(th1 - N*th2)"), {}),
        (RACK, {("a", "x"): 50.0}),
    ],
)
def test_a_ratio_is_read_where_both_equations_have_it(text: str, told: dict[tuple[str, str], float]) -> None:
    assert parsed(text).ratios == pytest.approx(told)


def test_what_joins_geared_bodies_follows_their_difference_and_gives_no_power_to_both_as_they_turn_together() -> None:
    plant = parsed(BELT)
    assert plant.ratio("th2", "th1") == 0.25
    place, speed = relative(plant, "th1", "th2")
    point = SimpleNamespace(th1=4.1, th2=1.0, dth1=4.0, dth2=1.0)
    assert place.of(point) == pytest.approx(0.1) and speed.of(point) == 0.0 and not place.turning
    law = mechanisms(plant)["th1_body.cubic_of_th1_less_geared_th2_pair"]
    assert law.site.on == {"th1": 1.0, "th2": -4.0} and mechanism_named(plant, law.name) is not None
    assert law.formula == "A (th1 - 4 th2)^3"
    # names of files of before stay readable
    assert mechanism_named(plant, "th1_body.cubic_of_th1_less_th2_pair") is not None
    turned = parsed(BELT.replace("N: {value: 4,", "N: {value: -4,"))
    assert mechanisms(turned)["th1_body.cubic_of_th1_less_geared_th2_pair"].formula == "A (th1 + 4 th2)^3"
