"""A model is written with the parameters that simulate best what was held back in the fit."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.proof import written_parameters as module
from hoopd.diagnose.proof.fit_tables import nrmse
from hoopd.diagnose.proof.fold_runs import blocks_of, fold_runs
from hoopd.diagnose.proof.free_run_refinement import Pull
from hoopd.diagnose.proof.two_estimates import beyond_chance
from hoopd.diagnose.proof.written_parameters import (
    ParameterSet,
    chosen,
    least_moved,
    mean_percent,
    written_parameters,
)
from hoopd.diagnose.search.folds import FOLDS, fold_values
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretch_scatter import interval

PLANT = shipped_plant()
SECONDS = 12.0


@pytest.fixture(scope="module")
def found() -> HypothesisFit:
    """The base, of data that the shipped numbers made."""
    return fit([stretch_with(PLANT, "train", 3, SECONDS)], (), PLANT.values)


def test_blocks_are_thirds_with_the_states_that_stood_there(found: HypothesisFit) -> None:
    blocks = blocks_of(found)
    assert len(blocks) == FOLDS and [len(one) for one in blocks] == [1] * FOLDS
    (track,) = found.tracks
    for k, (one,) in enumerate(blocks):
        assert one.stretch.t[0] == pytest.approx(SECONDS * k / FOLDS, abs=0.05)
        at = int(np.searchsorted(track.stretch.t, one.stretch.t[0]))
        np.testing.assert_array_equal(one.reference, track.z[at : at + len(one.stretch.t)])


def test_a_block_is_simulated_with_parameters_that_the_others_ask_for(found: HypothesisFit) -> None:
    values = fold_values(found)
    own = np.array([[one[name] for name in found.free] for one in values])
    assert (np.ptp(own, axis=0) > 0.0).all()
    held = fold_runs(found)
    assert mean_percent(held) == pytest.approx(mean_percent(fold_runs(found, values)))
    # a block that is simulated with what is wrong is worse
    wrong = [{**one, "K2": 0.8 * one["K2"]} for one in values]
    assert nrmse(fold_runs(found, wrong).runs)["psi"] < nrmse(held.runs)["psi"] - 5.0


def test_a_held_back_block_has_no_say_in_the_parameters_that_simulate_it(
    found: HypothesisFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def simulated(_: Any, values: Any, blocks: Any, *more: Any) -> Any:
        asked.append([round(one.stretch.t[0], 6) for block in blocks for one in block])
        return SimpleNamespace(values=dict(values), cost=1.0)

    monkeypatch.setattr(module, "_simulated", simulated)
    module._by_output_error(found, PLANT.values, Pull({}, {}, 0.0), 0.1)
    whole, *held = asked
    assert len(whole) == FOLDS and held == [[t for j, t in enumerate(whole) if j != k] for k in range(FOLDS)]


def test_what_has_nothing_free_is_simulated_as_it_is(found: HypothesisFit) -> None:
    stretches = [track.stretch for track in found.tracks]
    held = fit(stretches, (), PLANT.values, free=())
    assert fold_values(held) == [held.values] * FOLDS
    assert written_parameters(held, PLANT.values).fit is held


def _candidate(kind: str, percent: float) -> ParameterSet:
    nothing: Any = None
    return ParameterSet(kind, {}, nothing, percent, nothing)


def test_of_equally_good_ones_the_one_nearest_to_the_users_is_taken() -> None:
    each = [_candidate(*one) for one in (("yours", 80.0), ("drawn", 91.95), ("less", 92.0), ("likelihood", 91.0))]
    assert chosen(each).kind == "drawn"
    assert chosen([_candidate("yours", float("nan")), *each]).kind == "drawn"
    assert chosen([each[0], each[3]]).kind == "likelihood"


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_the_written_model_is_simulated_no_worse_than_any_kind_and_says_which_it_is(
    found: HypothesisFit, monkeypatch: pytest.MonkeyPatch, wrong: float
) -> None:
    """Where two estimates agree the likelihood's are the surer ones, and output error's are not asked."""
    each: list[ParameterSet] = []
    judged = module._judged
    monkeypatch.setattr(module, "_judged", lambda *a: each.append(judged(*a)) or each[-1])  # type: ignore[func-returns-value]
    monkeypatch.setattr(module, "beyond_chance", lambda *_: {**dict.fromkeys(found.free, 0.0), "K2": wrong})
    users = {**PLANT.values, "K2": 0.9 * PLANT.values["K2"]}
    written = written_parameters(found, users)
    kinds = ["yours", *["output error"] * (len(module.DRAWN) if wrong else 0), "the likelihood's"]
    each = each[: len(kinds)]  # those after them hold some parameters
    assert [one.kind.split(",")[0] for one in each] == kinds
    best = max(each, key=lambda one: one.percent)
    assert best.percent > each[0].percent + 1.0  # the user's is off
    assert written.note.startswith(f"parameters of the model are those of {chosen(each).kind}: ")
    assert abs(written.fit.values["K2"] / PLANT.values["K2"] - 1.0) < 0.03
    assert found.values["K2"] != users["K2"]  # the fit itself is as it was


def test_only_what_the_blocks_ask_for_moves(found: HypothesisFit) -> None:
    users = {**PLANT.values, "K2": 0.9 * PLANT.values["K2"]}
    written = written_parameters(found, users)
    stays = {name for name in found.free if written.fit.values[name] == users[name]}
    assert "K2" not in stays and len(stays) > len(found.free) / 2  # of the others the user's are the true ones
    note = written.note.partition("; of these ")[2]
    assert all(name in note for name in stays) and "yours" in note and "K2" not in note
    for name in stays:
        low, high = interval(written.fit, name) or (0.0, 0.0)
        assert low <= found.values[name] <= high  # what the likelihood has is not ruled out


def test_what_matters_only_in_a_sum_stays_where_the_others_make_up_for_it(found: HypothesisFit) -> None:
    """Each is asked as it is first, then with the others fitted beside it; nothing stays that makes a channel worse."""
    runs = fold_runs(found)
    worse = fold_runs(found, [{**one, "K2": 0.8 * one["K2"]} for one in fold_values(found)])
    asked: list[tuple[tuple[str, ...], bool]] = []

    def held(names: Any, others: bool) -> ParameterSet:
        asked.append((tuple(names), others))
        good = "bad" not in names and ("sum" not in names or others)
        return ParameterSet("held", {}, runs if good else worse, 90.0 + len(asked) / 100.0, held)

    best = ParameterSet("best", {}, runs, 90.0, held)
    told: list[str] = []
    _, stay = least_moved(best, ["bad", "alone", "sum"], told.append)
    assert stay == ["alone", "sum"]
    assert told[0] == "whether bad moves" and told[-1] == "whether sum moves, the others fitted beside it"
    assert (("alone", "sum"), True) in asked and (("sum",), False) in asked


def test_where_the_users_own_are_as_good_they_stay(found: HypothesisFit) -> None:
    """What the data move by noise alone is not moved."""
    written = written_parameters(found, PLANT.values)
    assert written.note.startswith("parameters of the model are those of yours")
    moved = [abs(written.fit.values[name] - PLANT.values[name]) for name in found.free]
    least = [abs(found.values[name] - PLANT.values[name]) for name in found.free]
    assert all(one <= other + 1e-12 for one, other in zip(moved, least, strict=True)) and sum(moved) < sum(least)


def test_an_interval_holds_what_two_kinds_of_estimate_are_apart_by(found: HypothesisFit) -> None:
    half = {name: (ends[1] - ends[0]) / 2.0 for name in found.free if (ends := interval(found, name)) is not None}
    off = {**found.values, "K2": found.values["K2"] + 3.0 * half["K2"]}
    low, high = interval(module._with(found, off), "K2") or (0.0, 0.0)
    assert low < found.values["K2"] < high
    assert (high - low) / 2.0 == pytest.approx(np.sqrt(10.0) * half["K2"])
    same: Any = interval(module._with(replace(found, widths={}), found.values), "K2")
    assert (same[1] - same[0]) / 2.0 == pytest.approx(half["K2"])


def test_where_the_model_is_right_two_estimates_agree_and_where_it_is_not_they_are_apart(found: HypothesisFit) -> None:
    """What the likelihood is off by is told, in the parameter's unit; nothing of the others."""
    simulated = module._simulated(found, found.values, blocks_of(found), None, found.free)
    assert beyond_chance(found, simulated) == dict.fromkeys(found.free, 0.0)
    off = {**found.values, "K2": 1.3 * found.values["K2"]}
    told = beyond_chance(replace(found, values=off), simulated)
    assert told["K2"] == pytest.approx(off["K2"] - simulated.values["K2"])
    assert {name for name, apart in told.items() if apart} == {"K2"}


def test_what_they_are_apart_by_widens_an_interval_whichever_is_written(
    found: HypothesisFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The likelihood's numbers simulate blocks best, and are as doubtful for it."""
    half = {name: (ends[1] - ends[0]) / 2.0 for name in found.free if (ends := interval(found, name)) is not None}
    monkeypatch.setattr(module, "beyond_chance", lambda *_: {**dict.fromkeys(found.free, 0.0), "K2": 3.0 * half["K2"]})
    monkeypatch.setattr(module, "chosen", lambda each: each[-1])
    monkeypatch.setattr(module, "_unsure", lambda *_: [])
    written = written_parameters(found, PLANT.values).fit
    assert written.values == found.values
    assert written.widths["K2"] == pytest.approx(np.sqrt(10.0) * half["K2"])
    assert written.widths["K1"] == pytest.approx(half["K1"])
