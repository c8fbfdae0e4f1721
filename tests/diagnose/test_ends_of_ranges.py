"""A range holds what is usual: where a recording asks for more it is widened, once, and that is said."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.proof.ends_of_ranges import end_sentences
from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.naming import name_effects, widen_ranges
from hoopd.diagnose.search.range_widening import in_wider_ranges
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.library import library
from hoopd.plants.found_effects import EffectError, FoundEffect, FoundEffects, checked
from hoopd.plants.likelihood.fitting import fit

PLANT = shipped_plant()
FRICTION = library(PLANT)["hoop.coulomb_friction"]
SIZE = FRICTION.key("Fc")
TRUE_NM = 0.02


def up_to(high: float, **physics: float) -> Effect:
    """The friction in a narrower range."""
    return replace(FRICTION, parameters=tuple(replace(p, high=high, **physics) for p in FRICTION.parameters))


def test_what_is_larger_than_its_range_may_be_is_said_and_nothing_else() -> None:
    stretch = stretch_with(PLANT, "day", 1, 8.0, [FRICTION], {SIZE: TRUE_NM})
    found = fit([stretch], (FRICTION,), {**PLANT.values, SIZE: 0.015})
    assert end_sentences(found) == []
    (said,) = end_sentences(fit([stretch], (up_to(0.01),), {**PLANT.values, SIZE: 0.005}))
    assert said.startswith(f"{SIZE} stands at the end of its range, 0.01 N m: ")


def test_what_is_declared_there_and_no_effect_at_all_are_not_said() -> None:
    stretch = stretch_with(PLANT, "day", 1, 8.0)
    none = fit([stretch], (FRICTION,), {**PLANT.values, SIZE: 0.0}, move=False)
    assert none.values[SIZE] == 0.0 and end_sentences(none) == []
    bounded = replace(PLANT, bounds={**PLANT.bounds, "L1": (PLANT.values["L1"], 1e6)})
    there = fit([replace(stretch, plant=bounded)], (), PLANT.values, move=False)
    assert end_sentences(there) == []
    other = fit([replace(stretch, plant=bounded)], (), {**PLANT.values, "L1": 1e6}, move=False)
    assert [one.split(" ")[0] for one in end_sentences(other)] == ["L1"]


def test_what_lies_outside_of_the_usual_range_is_found_in_its_interval() -> None:
    stretch = stretch_with(PLANT, "day", 1, 8.0, [FRICTION], {SIZE: TRUE_NM})
    nominal = fit([stretch], (), PLANT.values, move=False)
    base = fit([stretch], (), PLANT.values, like=nominal, noise=nominal.noise)
    found = name_effects([stretch], {FRICTION.name: up_to(0.01)}, nominal, base)
    assert found.final.names == (FRICTION.name,)
    assert abs(found.final.values[SIZE] - TRUE_NM) < 2.0 * found.final.deviation(SIZE) < 0.005
    # what is asked for the name afterwards is asked in the wider range, too
    (named,) = found.accepted
    assert named.effect is found.final.effects[-1] and named.effect.parameter("Fc").usual == (0.0, 0.01)
    (said,) = end_sentences(found.final)
    assert "outside of its usual range of 0 to 0.01 N m, which was widened" in said


def test_of_names_that_were_accepted_each_may_reach_the_end_of_its_range_later() -> None:
    stretch = stretch_with(PLANT, "day", 1, 8.0, [FRICTION], {SIZE: TRUE_NM})
    tight = up_to(0.01)
    nominal = fit([stretch], (), PLANT.values, move=False)
    base = fit([stretch], (), PLANT.values, like=nominal, noise=nominal.noise)
    found = name_effects([stretch], {FRICTION.name: FRICTION}, nominal, base)
    at_end = fit([stretch], (tight,), {**PLANT.values, SIZE: 0.005})
    found.accepted, found.final = [replace(found.accepted[0], effect=tight, fit=at_end)], at_end
    widen_ranges(found, Judge([stretch], {}, Settings()))
    assert found.final.values[SIZE] == pytest.approx(TRUE_NM, rel=0.1)
    assert found.accepted[0].effect is found.final.effects[-1]


def test_a_range_is_widened_once_and_to_what_can_be() -> None:
    stretch = stretch_with(PLANT, "day", 1, 8.0, [FRICTION], {SIZE: TRUE_NM})
    at_end = fit([stretch], (up_to(0.001),), {**PLANT.values, SIZE: 0.0005})
    wider = in_wider_ranges(at_end, [stretch])
    assert wider.values[SIZE] == 0.004 and in_wider_ranges(wider, [stretch]) is wider
    (said,) = end_sentences(wider)
    assert "stands at the end of its range, widened already, 0.004 N m" in said
    physical = fit([stretch], (up_to(0.01, most=0.01),), {**PLANT.values, SIZE: 0.005})
    assert in_wider_ranges(physical, [stretch]) is physical


@pytest.mark.parametrize(
    ("parameter", "at", "ends"),
    [
        (EffectParameter("A", "N", 0.0, 0.0, 2.0), 2.0, (0.0, 8.0)),
        (EffectParameter("b", "N", 0.0, -1.0, 2.0), -1.0, (-4.0, 2.0)),
        (EffectParameter("v", "m/s", 1.0, 0.4, 2.0, "shape"), 0.4, (0.1, 2.0)),
        (EffectParameter("k", "-", 1.0, 0.2, 3.0), 3.0, (0.2, 12.0)),
        (EffectParameter("s", "N", inf, 0.2, 3.0, most=3.0), 3.0, (0.2, 3.0)),
        (EffectParameter("share", "-", 0.5, 0.0, 1.0), 1.0, (0.0, 1.0)),
        (EffectParameter("n", "-", 1.0, 1.0, 36.0, "shape", (1.0, 36.0), discrete=True), 36.0, (1.0, 36.0)),
        (EffectParameter("T", "s", 0.0, 0.0, 2.0, "shape"), 0.0, (0.0, 2.0)),
    ],
)
def test_which_end_moves_and_how_far(parameter: EffectParameter, at: float, ends: tuple[float, float]) -> None:
    wider = parameter.widened(at)
    assert (wider.low, wider.high) == ends and wider.size == parameter.size
    assert parameter.widened((parameter.low + parameter.high) / 2.0) is parameter


def test_the_drives_limit_stays_one() -> None:
    limit = library(PLANT)["actuator.saturation"].parameter("s")
    assert limit.widest == (limit.low / 4.0, PLANT.limit)


def test_a_model_keeps_what_was_found_outside_of_the_usual_range() -> None:
    high = FRICTION.parameter("Fc").high
    assert checked(PLANT, FRICTION.name, {"Fc": 2.0 * high}) == {"Fc": 2.0 * high}
    with pytest.raises(EffectError, match="must be 0 to"):
        checked(PLANT, FRICTION.name, {"Fc": 5.0 * high})
    (own,) = FoundEffects("entries", PLANT.values, (FoundEffect(FRICTION.name, {"Fc": 2.0 * high}),)).effects()
    assert own.parameter("Fc").low <= 2.0 * high <= own.parameter("Fc").high
