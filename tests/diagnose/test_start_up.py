"""A drive that ignores what it is told at first: set aside as a start-up, not named as a push."""

from __future__ import annotations

import numpy as np
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.search.excluded_intervals import CountedData, start_ups
from hoopd.diagnose.search.naming import Named, name_effects
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch

PLANT = shipped_plant()
PUSH = library(PLANT)["external.disturbance"]


def named_in(stretch: Stretch) -> Named:
    nominal = fit([stretch], (), PLANT.values, move=False)
    return name_effects([stretch], {PUSH.name: PUSH}, nominal, fit([stretch], (), PLANT.values))


def test_a_drive_that_is_off_at_first_is_a_start_up() -> None:
    told = stretch_with(PLANT, "r", 3, 15.0).u
    done = told.copy()
    done[:30] = 0.0
    made = stretch_with(PLANT, "r", 3, 15.0, u=done)
    late = Stretch("r", PLANT, made.t, told, made.y)
    named = named_in(late)
    assert [one.effect.name for one in named.accepted] == [PUSH.name]
    (early,) = start_ups(named, {"r": 0.0})
    # it began with the recording, not with what is left of it
    assert start_ups(named, {"r": -1.0}) == []
    assert (early.recording, early.t0, early.where, early.kind) == ("r", 0.0, "theta", "force")
    data = CountedData([late], [late]).begun_later([early])
    assert data.ignored == [early] and data.kept[0].t[0] >= early.t1 >= 1.0
    assert data.brought_back(named.final) is data
    assert not named_in(data.kept[0]).accepted


def test_a_push_later_on_is_an_effect() -> None:
    values = {f"{PUSH.name}.A": 0.02, f"{PUSH.name}.t0@r": 6.0, f"{PUSH.name}.t1@r": 6.5}
    own = {f"{PUSH.name}.t0": 6.0, f"{PUSH.name}.t1": 6.5}
    named = named_in(stretch_with(PLANT, "r", 4, 15.0, [PUSH], {**values, **own}))
    assert [one.effect.name for one in named.accepted] == [PUSH.name]
    assert np.isclose(named.final.values[f"{PUSH.name}.t0@r"], 6.0, atol=0.1)
    assert start_ups(named, {"r": 0.0}) == []
