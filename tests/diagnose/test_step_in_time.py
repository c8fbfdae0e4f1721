"""A law that changes at one moment of a recording: when, by how much, and of what."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from diagnose.motor import SAMPLE_S, levels, sampled, turned

from hoopd.diagnose.findings import _when, parameters_of
from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import name_effects
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.grammar.shapes import STEPS
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch, stretch_of
from hoopd.plants.plant_file import parse_plant

MOTOR = parse_plant(
    """
schema: hoopd.plant/1
name: motor
coordinates: {th: {unit: rad, usual: 20, usual_rate: 30}}
inputs: {T: {unit: N m, limit: 0.2}}
parameters:
  J: {value: 2.0e-4, unit: kg m2, bounds: [1.0e-6, 1.0e-2]}
  b: {value: 1.0e-3, unit: N m s, bounds: [0, .inf]}
equations:
  th: J*th'' = T - b*th'
channels: {th: {reads: th, sensor: encoder}, w: {reads: th', sensor: tacho}}
sample_time_s: 0.01
""",
    "motor.yaml",
)
J, B = 1.94e-4, 1.05e-3


def recorded(name: str, seed: int, *, changes_s: float, friction: float = 1.0, drive: float = 1.0) -> Stretch:
    """Levels of a torque; from a moment on with another friction or another drive."""
    random, n = np.random.default_rng(seed), 1501
    t, u = np.arange(n) * SAMPLE_S, levels(random, [-0.06, -0.02, 0.02, 0.06], 30, n)

    def moment(k: int, part: int, w: float) -> float:
        is_changed = t[k] >= changes_s
        return float((drive if is_changed else 1.0) * u[k] - B * (friction if is_changed else 1.0) * w)

    shown = np.column_stack([sampled(one) for one in turned(n, moment, J)])
    shown += random.normal(size=shown.shape) * (1e-3, 0.1)
    rows = np.arange(n)
    return stretch_of(name, MOTOR, t, u, {"th": (rows, shown[:, 0]), "w": (rows, shown[:, 1])})


def named(train: list[Stretch]) -> HypothesisFit:
    known, nominal = library(MOTOR), fit(train, (), MOTOR.values, move=False)
    base = fit(train, (), MOTOR.values, like=nominal, noise=nominal.noise)
    found = name_effects(train, known, nominal, base, Settings())
    name_mechanisms(found, Judge(train, known, Settings()), [*mechanisms(MOTOR).values()])
    return found.final


@pytest.mark.parametrize(
    ("name", "changed", "size"),
    [
        ("body.step_of_t_on_dth", {"friction": 1.15}, -0.15 * B),
        ("actuator.step_of_t_on_t", {"drive": 0.94}, -0.06),
    ],
)
def test_what_changes_in_the_middle_is_found_with_its_moment(name: str, changed: dict[str, float], size: float) -> None:
    final = named([recorded(f"day{seed}", seed, changes_s=8.4, **changed) for seed in (1, 2)])
    assert final.names == (name,)
    assert final.values[f"{name}.v0"] == pytest.approx(8.4, abs=0.15)
    assert final.values[f"{name}.A"] == pytest.approx(size, rel=0.1)
    assert final.values["b"] == pytest.approx(B, rel=0.02) and final.values["J"] == pytest.approx(J, rel=0.02)


def test_what_changes_once_and_stays_is_found_with_its_recording() -> None:
    """Off in the first recording until a moment, on ever since: in the second one, and in any that is held out."""
    name = "body.change_of_t_on_dth"
    train = [recorded("day1", 1, changes_s=9.1, friction=1.15), recorded("day2", 2, changes_s=0.0, friction=1.15)]
    final = named(train)
    assert final.names == (name,)
    assert final.values[f"{name}.v0"] == pytest.approx(9.1, abs=0.15)
    assert final.values[f"{name}.A"] == pytest.approx(-0.15 * B, rel=0.1)
    assert (final.values[f"{name}.began@day1"], final.values[f"{name}.began@day2"] > 1e6) == (0.0, True)
    later = [recorded("day3", 3, changes_s=0.0, friction=1.15)]
    without = fit(later, (), final.values, free=())
    assert without.criterion - fit(later, final.effects, final.values, free=()).criterion > 50.0
    (effect,) = final.effects
    assert _when(effect, final) == ": from 9.1 s of day1 on, and in what was recorded after it"
    assert [*parameters_of(effect, final)] == ["A", "v0", "w"]


def test_what_began_between_two_recordings_is_in_the_second_one() -> None:
    train = [recorded("day1", 1, changes_s=99.0), recorded("day2", 2, changes_s=0.0, drive=0.94)]
    final = named(train)
    name = "actuator.change_of_t_on_t"
    assert final.names == (name,) and final.values[f"{name}.A"] == pytest.approx(-0.06, rel=0.1)
    assert _when(final.effects[0], final) == ": from day2 on, and in what was recorded after it"


def test_where_nothing_changes_no_moment_is_found() -> None:
    assert named([recorded(f"day{seed}", seed, changes_s=99.0) for seed in (1, 2)]).names == ()


def test_what_changes_is_asked_of_the_recordings_that_have_its_place() -> None:
    """Beside a recording of a plant without that slot."""
    bare = replace(MOTOR, slots={name: slot for name, slot in MOTOR.slots.items() if slot.kind != "body"})
    train = [
        replace(recorded("day1", 1, changes_s=99.0), plant=bare),
        recorded("day2", 2, changes_s=9.1, friction=1.15),
    ]
    base = fit(train, (), MOTOR.values)
    wanted = [one for one in mechanisms(MOTOR).values() if one.shape in STEPS and one.effect.slot == "body"]
    screen = MechanismScreen(base, wanted, level=False)
    assert {one.mechanism.name for one in screen.proposals} >= {"body.change_of_t_on_dth"}
    assert not any("step_of_t" in one.mechanism.name for one in screen.proposals)
