"""The order in which effects that were tried are accepted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

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
