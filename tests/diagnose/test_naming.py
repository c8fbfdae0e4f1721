"""The order in which effects that were tried are accepted, and what folds of the training data refuse."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from hoopd.diagnose.search import candidates, naming
from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.naming import _in_order


def tried(name: str, gain: float, contains: tuple[str, ...] = ()) -> Any:
    return SimpleNamespace(effect=SimpleNamespace(name=name, contains=contains), gain=gain, surprise=gain)


def names(*given: Any) -> list[str]:
    return [one.effect.name for one in _in_order(given)]


def test_a_simple_effect_goes_before_the_one_that_contains_it_and_gains_little_more() -> None:
    assert names(tried("rich", 99.0, ("simple",)), tried("simple", 97.0)) == ["simple", "rich"]
    assert names(tried("rich", 150.0, ("simple",)), tried("simple", 97.0)) == ["rich", "simple"]


def test_the_best_effect_stays_first_when_a_richer_form_of_it_comes_last() -> None:
    found = names(tried("simple", 97.0), tried("other", 95.0), tried("rich", 92.0, ("simple",)))
    assert found == ["simple", "other", "rich"]


class Written(Judge):
    """A judge whose criterion in folds is written down, by the criterion of the fit."""

    def __init__(self, folds: dict[float, float], monkeypatch: pytest.MonkeyPatch, other: Any = None) -> None:
        super().__init__([], {}, Settings())
        self.other = other
        gain = lambda before, after: folds[before.criterion] - folds[after.criterion]  # noqa: E731
        monkeypatch.setattr(candidates, "fold_gain", gain)

    def proposals(self, about: Any, taken: Any) -> Any:
        return [SimpleNamespace(gain=1e3)]

    def tried(self, before: Any, score: Any) -> Any:
        return self.other


@pytest.mark.parametrize(("lost", "swapped"), [(2.0, True), (40.0, False)])
def test_a_swap_that_gains_little_may_lose_little_in_folds(
    lost: float, swapped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without either 500 nats more; of the two the other gains 8, and may not lose a tenth of 508."""
    final, without, fit = (SimpleNamespace(criterion=c, names=()) for c in (100.0, 600.0, 92.0))
    other = SimpleNamespace(fit=fit, gain=508.0, surprise=505.0)
    one = SimpleNamespace(effect=SimpleNamespace(name="one"), score=None)
    monkeypatch.setattr(naming, "surprise_of", lambda score, gain, stretches: gain - 3.0)
    judge = Written({100.0: 50.0, 92.0: 50.0 + lost}, monkeypatch, other)
    found: Any = SimpleNamespace(final=final)
    better = naming._better(found, judge, one, without, 500.0)  # type: ignore[arg-type]
    assert (better is other) is swapped
    other.surprise = 497.0 + naming.OCCAM_NATS - 0.1  # hardly ahead: the first name stays
    assert naming._better(found, judge, one, without, 500.0) is None  # type: ignore[arg-type]


def test_folds_may_lose_a_tenth_of_what_is_gained_and_three_nats_of_little(monkeypatch: pytest.MonkeyPatch) -> None:
    before: Any = SimpleNamespace(criterion=0.0)
    for gain, lost, refused in ((500.0, 49.0, False), (500.0, 51.0, True), (9.0, 2.9, False), (9.0, 3.1, True)):
        after: Any = SimpleNamespace(criterion=-gain)
        judge = Written({0.0: 0.0, -gain: lost}, monkeypatch)
        assert judge.fold_loss(before, after, gain) == (pytest.approx(lost) if refused else None)


def test_who_was_refused_by_folds_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = tried("first", 90.0), tried("second", 60.0)
    first.fit, second.fit = SimpleNamespace(criterion=10.0), SimpleNamespace(criterion=40.0)
    judge = Written({100.0: 50.0, 10.0: 80.0, 40.0: 30.0}, monkeypatch)
    found: Any = SimpleNamespace(final=SimpleNamespace(criterion=100.0), rivals={}, refused={}, refusals={})
    assert naming._taken(found, judge, [first, second]) is second
    assert found.rivals == {"second": [("first", -30.0)]} and found.refused == {"second": ("first",)}
    assert found.refusals == {"first": naming.Refusal(90.0, 30.0)}


@pytest.mark.parametrize(("loss", "stays"), [(3.0, False), (30.0, True)])
def test_an_earlier_name_that_is_worth_nothing_beside_a_later_one_goes(
    loss: float, stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = tried("first", 90.0), tried("second", 60.0)
    first.score = second.score = None
    without = SimpleNamespace(criterion=loss)
    monkeypatch.setattr(naming, "fit", lambda *_, **__: without)
    monkeypatch.setattr(naming, "surprise_of", lambda score, gain, stretches: gain)
    final = SimpleNamespace(criterion=0.0, values={}, noise={})
    found: Any = SimpleNamespace(accepted=[first, second], final=final, base=SimpleNamespace(effects=()))
    naming.reconsider(found, Written({}, monkeypatch), swaps=False)
    assert found.accepted == ([first, second] if stays else [second])
    assert found.final is (final if stays else without)


def test_of_a_name_that_was_fitted_from_several_starts_the_best_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a base that a large lag has bent the fit of the lag may stop half way: it is no rival of itself."""
    half_way, whole, other = tried("lag", 1592.0), tried("lag", 3408.0), tried("delay", 2000.0)
    monkeypatch.setattr(naming, "tried_all", lambda judge, about, chosen: [half_way, other, whole])
    monkeypatch.setattr(naming, "_taken", lambda found, judge, every: every[0])
    found: Any = SimpleNamespace(accepted=[], final=None, tried=[])
    assert naming._best_of(found, Written({}, monkeypatch), []) is whole
    assert found.tried == [whole, other]


def test_from_the_parameters_as_given_the_same_names_are_fitted_too(monkeypatch: pytest.MonkeyPatch) -> None:
    score: Any = SimpleNamespace(
        member=SimpleNamespace(effect=SimpleNamespace(name="lag", contains=(), same_as=())), gain=99.0
    )
    monkeypatch.setattr(naming, "surprise_of", lambda score, gain, stretches: gain)
    monkeypatch.setattr(naming, "far_beyond", lambda about: False)
    judge = Written({}, monkeypatch)
    monkeypatch.setattr(judge, "proposals", lambda about, taken: [score])
    found: Any = SimpleNamespace(nominal=SimpleNamespace(names=()))
    assert naming._given_starts(found, [score], judge) == [score]
