"""How likely each finding is: shares of evidence, what nothing tells apart, and what remains beside a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.camera_faults import CountedFault
from hoopd.diagnose.curves.unknown_effects import survey
from hoopd.diagnose.findings import _fault, remains_of, told
from hoopd.diagnose.proof.finding_standings import Asked, Standing, Standings, _caveat, _left_of, standings
from hoopd.diagnose.proof.probabilities import (
    PARAMETERS,
    TOO_SMALL,
    UNLISTED,
    Option,
    among_what_acts,
    beside_faults,
    likely,
    too_small,
)
from hoopd.diagnose.proof.remainder import Remainder, explained, held_back
from hoopd.diagnose.proof.rivals_in_place import NEARLY_NATS, EffectTakenOut, nearest
from hoopd.diagnose.record import NONE_OF_THESE
from hoopd.diagnose.search.candidates import Judge, Settings, Tried
from hoopd.diagnose.search.mechanism_screen import MechanismScreen
from hoopd.diagnose.search.naming import Named, name_effects
from hoopd.diagnose.search.scan_score import scanned
from hoopd.diagnose.search.screen import Member, Score, Screen
from hoopd.plants.effects.grammar.mechanism import TEXTBOOK_COST_NATS
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch


def test_probabilities_are_shares_of_the_evidence_and_sum_to_one() -> None:
    found = likely([Option("a", 20.0, True), Option("b", 20.0 - np.log(3.0)), Option(PARAMETERS, -30.0)])
    assert found.named == pytest.approx(0.75) and found.shares["b"] == pytest.approx(0.25)
    assert sum(found.shares.values()) == pytest.approx(1.0) and found.none < 1e-6


def test_what_nothing_tells_apart_counts_together() -> None:
    found = likely([Option("a", 10.0, True), Option("b", 10.0, True), Option("c", 10.0)])
    assert found.named == pytest.approx(2.0 / 3.0) and found.shares["a"] == pytest.approx(1.0 / 3.0)


def test_what_remains_takes_its_part_first() -> None:
    for left, low, high in ((-10.0, 0.0, 1e-3), (0.0, 0.49, 0.51), (3.0, 0.9, 1.0)):
        found = likely([Option("a", 50.0, True)], left)
        assert low <= found.none <= high and found.named == pytest.approx(1.0 - found.none)


def test_a_name_is_among_what_acts_when_it_is_in_any_place() -> None:
    places = [likely([Option("a", 1.0, True), Option("b", 1.0)]), likely([Option("c", 1.0, True), Option("b", 1.0)])]
    assert among_what_acts(places)["b"] == pytest.approx(0.75, abs=1e-6)


def test_a_fault_of_the_camera_is_as_likely_as_it_is_beyond_the_threshold() -> None:
    faults = [CountedFault("camera.outliers", 0.05, (0.04, 0.06), 40.0, surprise, 14.0) for surprise in (12.0, 30.0)]
    found = [_fault(one, 12.0) for one in faults]
    assert [one.probability for one in found] == [pytest.approx(0.5), pytest.approx(1.0, abs=1e-6)]
    assert told(found, Standings()) == found and found[0].formula == "a share of the samples is a false detection"


def remaining(surprise: float, held: float) -> Remainder:
    return Remainder("hoop", "theta", surprise, 9.0, 5.0, held)


def test_a_remainder_fires_above_its_level_and_only_where_other_blocks_bear_it_out() -> None:
    assert remaining(9.5, 1.0).fires and remaining(9.5, 1.0).log_odds > 0.0
    assert not remaining(8.5, 1.0).fires and not remaining(30.0, -1.0).fires
    assert remaining(30.0, -1.0).log_odds < 0.0


def test_shares_are_of_names_and_remainder_together() -> None:
    assert explained([20.0], 20.0, None) == [1.0]
    assert explained([20.0], 20.0, remaining(25.0, 5.0)) == [pytest.approx(0.5)]
    assert explained([20.0, 10.0], 40.0, remaining(6.0, 1.0)) == [pytest.approx(0.5), pytest.approx(0.25)]


def test_a_direction_must_hold_in_blocks_that_its_size_was_not_estimated_on() -> None:
    n = 300
    track = SimpleNamespace(stretch=SimpleNamespace(t=np.arange(n) * 0.02, recording="day", y=np.zeros((n, 1))))
    made: Any = SimpleNamespace(tracks=[track], rows=[np.zeros((n, 1))])
    direction = np.tile([1.0, -1.0], n // 2)
    assert held_back(made, direction, direction) == pytest.approx(n / 2.0)
    odd = direction * np.repeat([3.0, -1.0, -1.0], n // 3)
    assert direction @ odd > 0.0 and held_back(made, direction, odd) < 0.0


# ---------------------------------------------------------------------------------------------- on recordings made up

PLANT = shipped_plant()
EFFECTS = library(PLANT)
FRICTION = EFFECTS["hoop.coulomb_friction"]


@cache
def fits() -> tuple[list[Stretch], HypothesisFit, HypothesisFit]:
    """Dry friction of 2 mN m: recordings, and what is fitted to them without any effect."""
    train = [stretch_with(PLANT, f"day{k}", k, 8.0, [FRICTION], {FRICTION.key("Fc"): 2e-3}) for k in (1, 2)]
    nominal = fit(train, (), PLANT.values, move=False)
    return train, nominal, fit(train, (), PLANT.values, like=nominal, noise=nominal.noise)


def named(*names: str) -> Named:
    """Looked for among some names."""
    train, nominal, base = fits()
    return name_effects(train, {name: EFFECTS[name] for name in names}, nominal, base, Settings())


def taken_for(name: str) -> Named:
    """Whatever the recordings say, this name and no other."""
    train, nominal, base = fits()
    judge = Judge(train, {name: EFFECTS[name]}, Settings())
    one = judge.tried(base, judge.proposals(base, ())[0])
    found = Named(nominal, base, one.fit, [one], without={name: base})
    found.losses[name] = base.criterion - one.fit.criterion
    return found


def standing(found: Named, names: Sequence[str], grammar: Sequence[str], denied: Sequence[str] = ()) -> Standings:
    known = {name: EFFECTS[name] for name in names}
    laws = [one for name, one in mechanisms(PLANT).items() if name in grammar]
    about = survey(found.base, [*known.values()])
    beside = survey(found.final, [*known.values()])
    return standings(Asked(found, known, laws, about, beside, None, Settings().threshold, denied=denied))


LAWS = ("hoop.threshold_of_dtheta", "hoop.saturation_of_dtheta", "hoop.cubic_of_dtheta", "hoop.linear_of_theta")


def test_the_right_name_is_likely_and_explains_nearly_all() -> None:
    names = ("hoop.coulomb_friction", "hoop.quadratic_drag", "camera.latency")
    found = standing(named(*names), names, LAWS)
    mine = found.findings["hoop.coulomb_friction"]
    assert mine.probability is not None and mine.probability > 0.8
    assert mine.explained is not None and mine.explained > 0.9
    assert mine.nearest is None and mine.caveat == ""
    assert found.candidates["hoop.coulomb_friction"] > found.candidates.get("camera.latency", 0.0)


def test_a_name_that_held_out_data_deny_is_as_likely_another_law() -> None:
    names = ("hoop.coulomb_friction", "hoop.quadratic_drag", "camera.latency")
    found = standing(named(*names), names, LAWS, denied=names[:1])
    mine = found.findings["hoop.coulomb_friction"]
    assert mine.probability is not None and mine.probability < 0.5 < found.candidates[NONE_OF_THESE] + 0.05
    undenied = standing(named(*names), names, LAWS).findings["hoop.coulomb_friction"].probability
    assert undenied is not None and undenied > 1.5 * mine.probability


def test_what_nothing_tells_from_a_name_is_counted_with_it() -> None:
    name, other = "camera.angle_offset", "frame.tilt"
    found = standing(taken_for(name), (name, other, "hoop.quadratic_drag"), ())
    mine = found.findings[name].probability
    assert found.counted_with == {other: name}
    assert mine is not None and mine == pytest.approx(found.candidates[name] + found.candidates[other])


def test_a_wrong_name_is_the_nearest_known_one_at_most() -> None:
    wrong = taken_for("hoop.friction_drift")
    assert wrong.losses["hoop.friction_drift"] > 3.0  # it stands for a part of the friction
    found = standing(wrong, ("hoop.friction_drift", "camera.latency"), LAWS)
    mine = found.findings["hoop.friction_drift"]
    assert mine.probability is not None and mine.probability < 0.5
    assert found.rest is not None and found.rest.fires and found.candidates[NONE_OF_THESE] > 0.5
    assert mine.explained is not None and 0.1 < mine.explained < 0.6
    assert mine.caveat.startswith("explains ") and "hoop.friction_drift is the nearest known name" in mine.caveat


def worths(found: Named, grammar: Sequence[str] = LAWS, colour: float | None = None) -> dict[str, Option]:
    """In the place of the only name."""
    place = EffectTakenOut(
        found, found.accepted[0], EFFECTS, [one for name, one in mechanisms(PLANT).items() if name in grammar]
    )
    place.colour = place.colour if colour is None else colour
    return {one.name: one for one in place.options(12.0)}


def test_what_was_refitted_in_a_place_counts_as_it_was_fitted_and_what_folds_refused_does_not() -> None:
    found, name, rival = named("hoop.coulomb_friction"), "hoop.coulomb_friction", "hoop.quadratic_drag"
    found.rivals = {name: [(rival, 5.0)]}
    fitted = worths(found)
    assert fitted[rival].worth > 0.5 * fitted[name].worth and not fitted[rival].alike
    found.refused = {name: (rival,)}
    assert worths(found)[rival].worth == 0.0


def test_what_only_the_screen_has_as_likely_as_the_name_is_refitted_and_takes_no_more_than_it_gains_then() -> None:
    """A screen is linear about a reference that has the name in it: here it has another law as good as the name."""
    found, rival = named("hoop.coulomb_friction"), "hoop.threshold_of_dtheta"
    place = EffectTakenOut(found, found.accepted[0], EFFECTS, [mechanisms(PLANT)[rival]])
    (proposed,) = (one for one in place.grammar.proposals if one.effect.name == rival)
    before = {one.name: one.worth for one in place.options(12.0)}
    assert 20.0 < before[rival] < before["hoop.coulomb_friction"] - NEARLY_NATS
    place.__dict__["_proposed"] = {rival: replace(proposed, gain=proposed.gain + 1e3, surprise=proposed.surprise + 1e3)}
    told_anew = {one.name: one.worth for one in place.options(12.0)}
    assert told_anew[rival] < 12.0 and told_anew["hoop.coulomb_friction"] == before["hoop.coulomb_friction"]


def test_what_holds_a_name_in_it_is_alike_and_parameters_are_as_likely_as_a_name_that_just_passes() -> None:
    found = worths(named("hoop.coulomb_friction"))
    assert found["hoop.coulomb_friction"].alike and found["hoop.stribeck_friction"].alike
    assert not found["camera.latency"].alike and not found["hoop.threshold_of_dtheta"].alike
    assert found[PARAMETERS] == Option(PARAMETERS, 12.0)


def test_what_is_the_same_for_every_sensor_is_alike_however_far_apart_its_change_is() -> None:
    place: Any = EffectTakenOut.__new__(EffectTakenOut)
    place.one, place.__dict__["_late"] = SimpleNamespace(effect=EFFECTS["frame.tilt"]), frozenset({"encoder.latency"})
    assert place._same(EFFECTS["camera.angle_offset"], 1e9) and place._same(EFFECTS["encoder.latency"], 1e9)
    assert not place._same(EFFECTS["hoop.imbalance"], 0.0)


def test_a_residual_that_is_coloured_along_a_name_makes_everything_there_less_worth() -> None:
    wrong = taken_for("hoop.friction_drift")
    place = EffectTakenOut(wrong, wrong.accepted[0], EFFECTS, [])
    assert place.colour > 1.0 and 0.0 < place.scale <= 1.0
    own, white = worths(wrong, ()), worths(wrong, (), 1.0)
    for name in ("hoop.friction_drift", "hoop.coulomb_friction"):
        assert own[name].worth < white[name].worth


def test_a_name_that_is_worth_nothing_turns_no_sign_round() -> None:
    nothing = taken_for("hoop.quadratic_drag")
    assert abs(nothing.losses["hoop.quadratic_drag"]) < 1e-3
    assert worths(nothing)["hoop.coulomb_friction"].worth > 20.0


def test_the_nearest_name_is_that_of_the_most_parallel_change() -> None:
    base = fits()[2]
    screen = Screen(base, [EFFECTS["hoop.coulomb_friction"], EFFECTS["camera.latency"]])
    first = screen.vectors[:, 0]
    assert nearest(screen, 3.0 * first) == "hoop.coulomb_friction"
    assert nearest(screen, 3.0 * first, ("hoop.coulomb_friction",)) is None


def test_mechanisms_that_were_nearest_in_the_search_are_those_in_a_name_s_place() -> None:
    found = taken_for("hoop.quadratic_drag")
    every = [one for one in mechanisms(PLANT).values() if one.site.slot == "hoop"]
    library_only = {"hoop.quadratic_drag": EFFECTS["hoop.quadratic_drag"]}
    whole = EffectTakenOut(found, found.accepted[0], library_only, every)
    found.in_place["hoop.quadratic_drag"] = MechanismScreen(found.base, every, level=False)
    quick = EffectTakenOut(found, found.accepted[0], library_only, every)
    costs = {one.effect.name: one.cost for one in whole.grammar.proposals}
    assert {
        one.effect.name: one.cost for one in quick.grammar.proposals if one.effect.name in costs
    }.items() <= costs.items()
    assert max(costs.values()) > 0.0
    best = {one.name: one.worth for one in sorted(whole.options(12.0), key=lambda one: -one.worth)[:10]}
    assert {one.name: one.worth for one in quick.options(12.0) if one.name in best} == pytest.approx(best)


def test_the_level_of_a_screen_that_was_made_without_one_is_not_asked_for() -> None:
    laws = [one for name, one in mechanisms(PLANT).items() if name in LAWS]
    with pytest.raises(ValueError, match="without its level"):
        MechanismScreen(fits()[2], laws, level=False).null  # noqa: B018


@pytest.mark.parametrize(("gain", "low", "high"), [(1000.0, 0.0, 0.05), (20.0, 0.45, 0.55), (2.0, 0.8, 1.0)])
def test_what_is_small_beside_a_name_leaves_it_likely(gain: float, low: float, high: float) -> None:
    # 20 nats beyond chance follow a law: half of the odds where the name explains as many
    left = _left_of(gain, remaining(25.0, 5.0), None)
    assert low <= likely([Option("a", 50.0, True)], left).none <= high
    assert left <= remaining(25.0, 5.0).log_odds


def test_what_several_names_leave_is_told_once() -> None:
    rest = remaining(25.0, 5.0)
    share = "explains 70 % of the mismatch, counted in nats"
    one = f"{share}; a.b is the nearest known name, and what remains follows theta"
    assert _caveat("a.b", 0.7, rest, 1) == one
    assert (
        _caveat("a.b", 0.7, rest, 2)
        == f"{share} (what is lost without it; findings overlap, so that shares need not add up)"
    )
    told_once = remains_of(Standings({"a.b": Standing()}, {}, rest=rest))
    assert told_once is not None and (told_once.follows, told_once.log_likelihood_gain) == ("theta", 25.0)
    assert remains_of(Standings({"a.b": Standing()}, {}, remaining(8.0, 5.0))) is None
    assert remains_of(Standings({}, {}, rest)) is None


def test_parameters_alone_are_never_sure_and_wrong_beside_a_fault() -> None:
    assert 0.02 < TOO_SMALL < 0.5  # a belief of next to nothing would call parameters sure
    found = likely([Option(PARAMETERS, 12.0), too_small(12.0), Option("a", 2.0)])
    assert found.shares[PARAMETERS] == pytest.approx(1.0 - TOO_SMALL, abs=1e-3)
    assert found.none == pytest.approx(TOO_SMALL, abs=1e-3)
    shares = beside_faults(found.shares, [0.9, 0.5])
    assert shares[PARAMETERS] == pytest.approx(0.05 * found.shares[PARAMETERS]) and shares["a"] == found.shares["a"]


def test_a_law_may_be_in_no_vocabulary_whatever_the_data_say() -> None:
    assert 0.02 < UNLISTED < 0.2
    found = likely([Option("a", 500.0, True), Option(PARAMETERS, 12.0)], unlisted=UNLISTED)
    assert found.named == pytest.approx(1.0 - UNLISTED) and found.none == pytest.approx(UNLISTED)


def test_screens_of_a_place_are_told_the_noise_that_a_refit_without_the_name_takes() -> None:
    found = taken_for("hoop.coulomb_friction")
    one = found.accepted[0]
    screened = EffectTakenOut(found, one, EFFECTS, [])._screened
    half = replace(found, losses={one.effect.name: 0.5 * screened})
    assert EffectTakenOut(half, one, EFFECTS, []).scale == pytest.approx(0.5)
    twice = replace(found, losses={one.effect.name: 2.0 * screened})
    assert EffectTakenOut(twice, one, EFFECTS, []).scale == 1.0


def test_a_textbook_s_law_is_another_one_however_near_it_is() -> None:
    """Coulomb's friction and that under a load which hardly changes: told apart by nothing, and still two laws."""
    found = taken_for("hoop.coulomb_friction")
    laws = mechanisms(PLANT)
    name = "hoop.linear_of_load_on_sign_dtheta"
    place = EffectTakenOut(found, found.accepted[0], EFFECTS, [laws[name]])
    (load,) = [one for one in place.options(12.0) if one.name == name]
    assert laws[name].textbook and not load.alike
    plain = EffectTakenOut(found, found.accepted[0], EFFECTS, [replace(laws[name], textbook=False)])
    (dear,) = [one for one in plain.options(12.0) if one.name == name]
    assert dear.worth - load.worth == pytest.approx(TEXTBOOK_COST_NATS, abs=1e-6)  # and the rarer one


def test_what_was_refitted_counts_as_many_choices_as_it_was_found_among() -> None:
    """A push has times: its gain is worth less than that of a name that has none."""
    found = taken_for("hoop.coulomb_friction")
    score = Score(Member(EFFECTS["external.disturbance"], {}, ()), 30.0, {}, np.zeros(1))
    pushed = Tried(EFFECTS["external.disturbance"], found.final, 30.0, 20.0, scanned(score, 1, 1e4))
    found.tried = [pushed]
    found.rivals["hoop.coulomb_friction"] = [("external.disturbance", found.losses["hoop.coulomb_friction"] - 30.0)]
    place = EffectTakenOut(found, found.accepted[0], EFFECTS, [])
    worth = next(one.worth for one in place.options(12.0) if one.name == "external.disturbance")
    assert worth < 30.0 / place.colour + 3.0 - np.log(1e4) + 0.5
