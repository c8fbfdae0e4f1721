"""A law whose extra constants do nothing is told under the simpler name, a law that needs them keeps its own."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
from diagnose.test_mechanisms import SLIDE, Law, bristles, recorded

from hoopd.diagnose.case import Case
from hoopd.diagnose.proof.ends_of_ranges import end_sentences
from hoopd.diagnose.search import naming
from hoopd.diagnose.search.candidates import Judge, Settings, Tried, surprise_of
from hoopd.diagnose.search.excluded_intervals import CountedData
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import Named, name_effects
from hoopd.diagnose.search.screen import Score
from hoopd.diagnose.search.simpler_names import tell_simply
from hoopd.diagnose.searched import with_mechanisms
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.likelihood.stretches import Stretch

LIBRARY, GRAMMAR = library(SLIDE), mechanisms(SLIDE)
COULOMB, STRIBECK = "slide.coulomb_friction", "slide.stribeck_friction"
FRICTIONS = {name: LIBRARY[name] for name in (COULOMB, STRIBECK)}


def rubbing(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """Dry friction, the same at every speed."""
    return 0.0 if v == 0.0 else -0.6 if v > 0.0 else 0.6


def sticking(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """Dry friction with a peak at rest, a sixth of the usual speed wide."""
    return 0.0 if v == 0.0 else -(0.3 + 1.2 / (1.0 + (v / 0.15) ** 4)) * (1.0 if v > 0.0 else -1.0)


def spring(x: float, v: float, u: float, memory: dict[str, float]) -> float:
    """A weak spring."""
    return -6.0 * x


def days(law: Law) -> list[Stretch]:
    return [recorded("day1", 1, law), recorded("day2", 2, law)]


def started(train: Sequence[Stretch], names: Sequence[str]) -> Named:
    """What the search finds among these names."""
    nominal = fit(train, (), SLIDE.values, move=False)
    base = fit(train, (), SLIDE.values, like=nominal, noise=nominal.noise)
    return name_effects(train, {name: LIBRARY[name] for name in names}, nominal, base)


def larger_first(tried: Sequence[Tried]) -> list[Tried]:
    return sorted(tried, key=lambda one: -len(one.effect.parameters))


@pytest.mark.parametrize(("law", "name"), [(rubbing, COULOMB), (sticking, STRIBECK)])
def test_stribecks_friction_without_its_peak_is_coulombs(law: Law, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The larger law was taken first, as it is where it comes by a swap."""
    monkeypatch.setattr(naming, "_in_order", larger_first)
    train = days(law)
    found = started(train, [COULOMB, STRIBECK])
    assert found.final.names == (STRIBECK,)
    case = Case("slide", SLIDE.values, (), (), FRICTIONS)
    known = with_mechanisms(case, found, CountedData(train, train), [])
    assert found.final.names == (name,) and found.accepted[0].effect is known[name]
    assert found.losses.keys() == found.without.keys() == {name}
    if name == COULOMB:
        ((stood, behind),) = found.rivals[name]
        assert stood == STRIBECK and abs(behind) < 4.0


@pytest.mark.parametrize(
    ("law", "mechanism", "simple"),
    [
        (rubbing, "slide.settling_of_t_on_sign_dx", COULOMB),
        (spring, "slide.threshold_of_x", "slide.linear_of_x"),
    ],
)
def test_a_mechanism_at_the_limit_of_its_shape_is_told_as_that_limit(law: Law, mechanism: str, simple: str) -> None:
    train, offered = days(law), [GRAMMAR[name] for name in (mechanism, simple) if name in GRAMMAR]
    judge = Judge(train, FRICTIONS, Settings())
    found = started(train, [])
    name_mechanisms(found, judge, offered[:1])
    assert found.final.names == (mechanism,)
    tell_simply(found, judge, offered)
    assert found.final.names == (simple,)


def test_a_mechanism_for_which_more_speaks_is_not_told_as_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though the limit has lost next to nothing: it may have more columns, or more that was looked at."""
    train, offered = days(spring), [GRAMMAR[name] for name in ("slide.threshold_of_x", "slide.linear_of_x")]
    judge, found = Judge(train, {}, Settings()), started(train, [])
    name_mechanisms(found, judge, offered[:1])

    def much_for_the_larger(score: Score, gain: float, stretches: Sequence[Stretch]) -> float:
        return 1e6 if score.member.effect.name == "slide.threshold_of_x" else surprise_of(score, gain, stretches)

    monkeypatch.setattr("hoopd.diagnose.search.simpler_names.surprise_of", much_for_the_larger)
    tell_simply(found, judge, offered)
    assert found.final.names == ("slide.threshold_of_x",)


def test_a_mechanism_that_needs_its_constants_keeps_its_name() -> None:
    name, train = "slide.dahl_of_x", days(bristles)
    judge, found = Judge(train, FRICTIONS, Settings()), started(train, [])
    name_mechanisms(found, judge, [GRAMMAR[name]])
    before = found.final
    tell_simply(found, judge, [*GRAMMAR.values()])
    assert found.final is before and before.names == (name,)


def test_constants_of_a_mechanism_end_about_those_that_are_tried() -> None:
    """The time of what settles at once ends where the recordings could still tell it, and that is said."""
    train = days(rubbing)
    found = started(train, [])
    name_mechanisms(found, Judge(train, {}, Settings()), [GRAMMAR["slide.settling_of_t_on_sign_dx"]])
    (parameter,) = [one for one in found.final.effects[0].parameters if one.name == "v0"]
    # tried at 0.8 to 6.4 s of 16 s; a wider range is worth less than it costs
    assert parameter.usual is None and parameter.low == 0.01
    assert found.final.values["slide.settling_of_t_on_sign_dx.v0"] == parameter.low
    (said,) = end_sentences(found.final)
    assert said.startswith("slide.settling_of_t_on_sign_dx.v0 stands at the end of its range, 0.01 s")


def test_places_may_lie_anywhere_and_waves_a_turn_are_counted() -> None:
    place = GRAMMAR["slide.above_of_x"]
    assert place.effect_near([{"v0": 0.1}, {"v0": 0.3}]).parameters == place.effect.parameters
    well = GRAMMAR["slide.well_of_x"].effect_near([{"v0": -0.1, "w": 0.02}, {"v0": 0.3, "w": 0.05}])
    assert (well.parameter("w").low, well.parameter("w").high) == (1e-3, 1.0)
