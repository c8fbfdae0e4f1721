"""A number at the end of its range is said: the recordings ask for more than it allows."""

from __future__ import annotations

from dataclasses import replace

from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.proof.ends_of_ranges import end_sentences
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit

PLANT = shipped_plant()
FRICTION = library(PLANT)["hoop.coulomb_friction"]
SIZE = FRICTION.key("Fc")


def test_what_is_larger_than_its_range_is_said_and_nothing_else() -> None:
    stretch = stretch_with(PLANT, "day", 1, 8.0, [FRICTION], {SIZE: 0.02})
    found = fit([stretch], (FRICTION,), {**PLANT.values, SIZE: 0.015})
    assert end_sentences(found) == []
    parameters = tuple(replace(p, high=0.01) for p in FRICTION.parameters)
    tight = replace(FRICTION, parameters=parameters)
    (said,) = end_sentences(fit([stretch], (tight,), {**PLANT.values, SIZE: 0.005}))
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
