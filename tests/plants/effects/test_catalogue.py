"""The catalogue against the published vocabulary (names and units typed here again), and on another plant."""

from __future__ import annotations

import math
import re

import pytest
from harness.effectcases import NAMES, effects, plant, slide

from hoopd.plants.effects.base import ROLES, Effect, EffectParameter
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.registry import plant_named

TABLE = {
    "actuator.torque_gain": {"k": "-"},
    "actuator.torque_bias": {"b": "N m"},
    "actuator.deadzone": {"d": "N m"},
    "actuator.saturation": {"s": "N m"},
    "actuator.lag": {"T": "s"},
    "actuator.delay": {"d": "s"},
    "actuator.lost_commands": {"share": "-"},
    "actuator.cogging": {"A": "N m", "n": "-", "phi": "rad"},
    "actuator.ripple": {"a": "-", "n": "-", "phi": "rad"},
    "actuator.back_emf_limit": {"w0": "rad/s"},
    "hoop.coulomb_friction": {"Fc": "N m"},
    "hoop.stribeck_friction": {"Fc": "N m", "Fs": "N m", "vs": "rad/s"},
    "hoop.quadratic_drag": {"c": "N m s2"},
    "hoop.imbalance": {"A": "N m", "phi": "rad"},
    "hoop.friction_drift": {"a": "-", "T": "s"},
    "ball.coulomb_friction": {"Fc": "N m"},
    "ball.rolling_resistance": {"r": "m"},
    "ball.quadratic_drag": {"c": "N m s2"},
    "ball.slip": {"mu": "-"},
    "ball.lift_off": {"restitution": "-", "grip": "-"},
    "ball.inner_hoop": {"radius": "m"},
    "frame.tilt": {"d": "rad"},
    "frame.vibration": {"A": "m/s2", "w": "rad/s", "phi": "rad"},
    "camera.latency": {"d": "s"},
    "camera.angle_offset": {"d": "rad"},
    "camera.center_offset": {"dx": "-", "dy": "-"},
    "camera.late_frames": {"share": "-"},
    "camera.outliers": {"share": "-"},
    "encoder.eccentricity": {"a": "rad", "phi": "rad"},
    "encoder.harmonic": {"a": "rad", "n": "-", "phi": "rad"},
    "encoder.latency": {"d": "s"},
    "encoder.speed_lag": {"T": "s"},
    "external.disturbance": {"t0": "s", "t1": "s", "A": "N m"},
}
FOUND_BY = {
    "actuator.torque_gain": "base",
    "ball.lift_off": "switch",
    "ball.inner_hoop": "switch",
    "frame.vibration": "scan",
    "external.disturbance": "scan",
    "actuator.lost_commands": "quality",
    "camera.late_frames": "quality",
    "camera.outliers": "quality",
}
# Those that the proof on concealed effects does not draw.
NEVER_HIDDEN = ("actuator.lost_commands", "ball.lift_off", "ball.inner_hoop")
EVERY = list(effects("rolling").values())


@pytest.mark.parametrize("effect", EVERY, ids=lambda one: one.name)
def test_a_formula_is_one_line_with_every_number_of_the_effect(effect: Effect) -> None:
    assert effect.formula and "\n" not in effect.formula
    words = re.findall(r"[A-Za-z]\w*", effect.formula)
    assert {p.name for p in effect.parameters} - {"follows"} <= {*words}


@pytest.mark.parametrize("structure", ["rolling", "published", "entries"])
def test_every_row_of_the_vocabulary_exists_with_its_units(structure: str) -> None:
    found = {e.name: {p.name: p.unit for p in e.parameters if p.name != "follows"} for e in effects(structure).values()}
    assert found == TABLE


def test_the_order_is_fixed() -> None:
    assert list(library(plant("rolling"))) == list(library(plant("entries")))
    assert [n for n in effects("rolling") if n not in NEVER_HIDDEN] == list(NAMES)


def test_what_does_not_move_has_no_effects() -> None:
    assert {n.split(".")[0] for n in effects("rolling", "hoop")} == {"actuator", "hoop", "encoder", "external"}
    assert {n.split(".")[0] for n in effects("entries", "ball")} == {"ball", "frame", "camera"}


@pytest.mark.parametrize("effect", EVERY, ids=lambda e: e.name)
def test_an_effect_says_what_it_is(effect: Effect) -> None:
    for text in ("statement", "signature", "sign", "best_experiment", "write_back"):
        assert getattr(effect, text), text
    assert effect.found_by == FOUND_BY.get(effect.name, "screen")
    assert effect.name not in (partners := {*effect.same_as, *effect.near, *effect.contains})
    assert partners <= set(TABLE)
    # a partner knows it, too
    assert all(effect.name in effects("rolling")[other].same_as for other in effect.same_as)


@pytest.mark.parametrize("effect", EVERY, ids=lambda e: e.name)
def test_a_search_knows_what_to_try(effect: Effect) -> None:
    roles = [one.role for one in effect.parameters]
    assert set(roles) <= set(ROLES)
    for one in effect.parameters:
        assert all(one.low <= value <= one.high for value in one.grid) or one.name == "k"
        assert list(one.grid) == sorted(set(one.grid))
        if one.role == "amplitude":
            assert len(one.grid) == 1
            assert 0.0 < one.size < one.high
        if one.role == "shape" and not one.per_recording:
            assert one.discrete or 6 <= len(one.grid) <= 14
        if one.role == "phase":
            assert (one.low, one.high, one.unit) == (-math.pi, math.pi, "rad")


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("actuator.deadzone.d", 0.005, 0.06),
        ("actuator.saturation.s", 0.02, 0.69),
        ("actuator.lag.T", 0.005, 0.1),
        ("actuator.delay.d", 0.002, 0.08),
        ("actuator.cogging.n", 2, 36),
        ("actuator.ripple.n", 1, 36),
        ("actuator.back_emf_limit.w0", 8, 80),
        ("hoop.stribeck_friction.vs", 0.3, 5),
        ("hoop.friction_drift.T", 2, 60),
        ("ball.slip.mu", 0.02, 0.5),
        ("camera.latency.d", 0.005, 0.1),
        ("encoder.latency.d", 0.005, 0.1),
        ("encoder.speed_lag.T", 0.005, 0.15),
        ("frame.vibration.w", 2, 60),
    ],
)
def test_grids_cover_the_sizes_that_matter(name: str, low: float, high: float) -> None:
    slot, effect, parameter = name.split(".")
    grid = effects("rolling")[f"{slot}.{effect}"].parameter(parameter).grid
    assert (grid[0], grid[-1]) == (low, high)


def test_another_plant_gets_what_fits_its_slots() -> None:
    found = library(slide())
    assert list(found) == [
        *(
            f"drive.{n}"
            for n in ("torque_gain", "torque_bias", "deadzone", "saturation", "lag", "delay", "lost_commands")
        ),
        "drive.back_emf_limit",
        *(f"slide.{n}" for n in ("coulomb_friction", "stribeck_friction", "quadratic_drag")),
        "push.disturbance",
        "ruler.latency",
        "ruler.offset",
    ]
    units = {key.key(p.name): p.unit for key in found.values() for p in key.parameters}
    assert units["slide.coulomb_friction.Fc"] == units["drive.deadzone.d"] == "N"
    assert units["slide.stribeck_friction.vs"] == "m/s"
    assert units["slide.quadratic_drag.c"] == "N s2/m2"
    assert units["ruler.offset.d"] == "m"
    # sizes follow the plant's limit and rate
    hoop = effects("rolling")
    fc, vs = found["slide.coulomb_friction"].parameter("Fc"), found["slide.stribeck_friction"].parameter("vs")
    assert fc.size / 20.0 == pytest.approx(hoop["hoop.coulomb_friction"].parameter("Fc").size / 0.7)
    assert vs.grid[0] / 0.3 == pytest.approx(hoop["hoop.stribeck_friction"].parameter("vs").grid[0] / 10.0)


def test_a_name_stands_once() -> None:
    more = Effect("hoop.imbalance", (EffectParameter("A", "N m", 0.0, 0.0, 1.0),))
    with pytest.raises(ValueError, match=r"hoop\.imbalance"):
        library(plant("rolling"), (more,))
    assert "hoop.wind" in library(plant("rolling"), (lambda p: (Effect("hoop.wind", ()),),))


@pytest.mark.parametrize("name", ["axis", "tanks", "falling"])
def test_a_plant_without_a_torque_is_told_of_none(name: str) -> None:
    for effect in library(plant_named(name)).values():
        said = f"{effect.statement} {effect.signature} {effect.best_experiment} {effect.write_back}"
        assert "torque" not in said and " a input" not in said, effect.name
    assert not any("torque" in one.sentence for one in mechanisms(plant_named(name)).values())
