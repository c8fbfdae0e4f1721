"""Mechanisms beside a user's own effect, two at once, and in units a thousand times as large."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with
from diagnose.test_mechanisms import SLIDE, SUBSTEP_S, Law, bristles, bumper, hanging, recorded, warming

from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import Named, name_effects
from hoopd.plants.declaration import Input
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch

MECHANISMS = mechanisms(SLIDE)


def users_own(law: str) -> Effect:
    """A spring that begins at 0.35 m, or a plain one, as a user would write it."""
    laws: dict[str, Callable[[Any], Any]] = {"end_stop": lambda s: (s.x - 0.35) * (s.x > 0.35), "spring": lambda s: s.x}
    return Effect(
        f"slide.{law}",
        (EffectParameter("k", "N/m", 0.0, 0.0, 100.0, grid=(1.0,)),),
        force=lambda s, e: {"x": -e.k * laws[law](s)},
        depends_on=("x",),
    )


def searched(law: Law, known: dict[str, Effect], wanted: tuple[str, ...]) -> Named:
    train = [recorded("day1", 1, law), recorded("day2", 2, law)]
    nominal, base = fit(train, (), SLIDE.values, move=False), fit(train, (), SLIDE.values)
    found = name_effects(train, known, nominal, base, Settings())
    name_mechanisms(found, Judge(train, known, Settings()), [MECHANISMS[name] for name in wanted])
    return found


NEAR = ("slide.above_of_x", "slide.cubic_of_x", "slide.threshold_of_x", "slide.linear_of_x")


def test_a_user_s_own_effect_that_is_right_keeps_its_name() -> None:
    """The grammar has the same law: it is a rival of the name, and no more than that."""
    found = searched(bumper, {"slide.end_stop": users_own("end_stop")}, NEAR)
    assert found.final.names == ("slide.end_stop",)
    assert found.losses["slide.end_stop"] > 20.0


def test_a_user_s_own_effect_that_is_wrong_makes_place() -> None:
    found = searched(bumper, {"slide.spring": users_own("spring")}, NEAR)
    assert found.final.names == ("slide.above_of_x",)


def test_two_mechanisms_that_act_at_once_are_both_found() -> None:
    def both(x: float, v: float, u: float, memory: dict[str, float]) -> float:
        return float(bristles(x, v, u, memory) + warming(x, v, u, memory))

    names = ("slide.dahl_of_x", "drive.heat_of_f_squared_on_f")
    found = searched(both, {}, (*names, *NEAR))
    assert {*found.final.names} == {*names}
    assert min(found.losses.values()) > 20.0


def late_upwards(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """A drive that is late by 5 ms where its force goes up, and not where it goes down."""
    if u != memory.get("now", u):
        memory["before"], memory["since"] = memory["now"], 0.0
    memory["now"] = u
    memory["since"] = memory.get("since", 1.0) + SUBSTEP_S
    before = memory.get("before", u)
    return before - u if before < u and memory["since"] <= 0.005 + SUBSTEP_S / 2 else 0.0


def test_what_is_late_in_one_direction_takes_the_place_of_a_lag_and_what_was_found_beside_it() -> None:
    names = ("drive.up_of_f", "drive.down_of_f", "drive.rise_of_f", "drive.fall_of_f")
    found = searched(late_upwards, {"drive.lag": library(SLIDE)["drive.lag"]}, names)
    assert [one.effect.name for one in found.tried] == ["drive.lag"]
    assert found.final.names == ("drive.up_of_f",)
    assert found.final.values["drive.up_of_f.A"] == pytest.approx(0.005, rel=0.25)


def times(stretch: Stretch, size: float) -> Stretch:
    """The same recording with places and forces so many times as large; of a plant that says how large they are."""
    slots = {name: one._replace(speed=one.speed * size) for name, one in SLIDE.slots.items()}
    scales = {"x": 0.5 * size, "dx": 1.0 * size, "F": 5.0 * size}
    plant = replace(SLIDE, name="sized", inputs=(Input("F", "N", 10.0 * size, "x"),), slots=slots, scales=scales)
    return replace(stretch, plant=plant, u=stretch.u * size, y=stretch.y * size, every=stretch.y * size)


def test_a_screen_sees_the_same_where_everything_is_a_thousand_times_as_large() -> None:
    wanted = [MECHANISMS[n] for n in ("slide.swing_of_dx", "slide.loose_of_dx", "slide.dahl_of_x", "slide.cubic_of_x")]
    one = recorded("day1", 1, hanging)
    here, there = (
        {p.mechanism.name: p for p in MechanismScreen(fit([s], (), SLIDE.values), wanted, level=False).proposals}
        for s in (times(one, 1.0), times(one, 1e3))
    )
    assert [*here] == [*there] and next(iter(here)) == "slide.swing_of_dx"
    for name, usual in here.items():
        assert there[name].gain == pytest.approx(usual.gain, rel=0.02, abs=0.1), name
        assert there[name].constants.get("w", 0.0) == pytest.approx(usual.constants.get("w", 0.0)), name


def test_a_cogging_has_one_number_over_all_recordings_and_a_phase_in_each() -> None:
    plant = shipped_plant()
    cogging = library(plant)["actuator.cogging"]
    law = {"actuator.cogging.A": 0.012, "actuator.cogging.n": 14.0}
    train = [
        stretch_with(plant, name, 3 + i, 10.0, [cogging], {**law, "actuator.cogging.phi": phase})
        for i, (name, phase) in enumerate({"a": 0.4, "b": 2.4}.items())
    ]
    base, judge = fit(train, (), plant.values), Judge(train, {"actuator.cogging": cogging}, Settings())
    (score,) = judge.proposals(base, ())
    found = judge.tried(base, score).fit.values
    assert found["actuator.cogging.n"] == 14.0
    assert not any(name.startswith("actuator.cogging.n@") for name in found)
    apart = found["actuator.cogging.phi@b"] - found["actuator.cogging.phi@a"] - 2.0
    assert np.cos(apart) > 0.9
