"""A name that the training data themselves are simulated worse with is weak, says so, and is in no model."""

from __future__ import annotations

from dataclasses import replace

import pytest
from diagnose.madeup import shipped_plant, stretch_with
from diagnose.test_confirmation import FRICTION, SIZE, confirmed, named_with, recorded

from hoopd.diagnose.proof import confirmation as confirmation_module
from hoopd.diagnose.proof import training_windows
from hoopd.diagnose.proof.fit_tables import Played, played
from hoopd.diagnose.proof.training_windows import reason_of, simulated_worse
from hoopd.diagnose.search.naming import Named
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit

PLANT = shipped_plant()
COGGING = library(PLANT)["actuator.cogging"]
WAVE = {f"{COGGING.name}.A": 0.03, f"{COGGING.name}.n": 7.0, f"{COGGING.name}.phi": 0.4}


@pytest.fixture(scope="module")
def fits() -> tuple[HypothesisFit, HypothesisFit]:
    """Without and with a friction, fitted to data that have it."""
    train = [recorded("train", 1, friction=True)]
    base = fit(train, (), PLANT.values)
    return base, fit(train, (FRICTION,), {**base.values, **SIZE}, like=base, noise=base.noise)


def play(fitted: HypothesisFit) -> Played:
    return played({"": fitted})[""]


def test_what_is_there_does_no_harm(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    assert simulated_worse(named_with(*fits), play) == {}


def test_a_wave_that_is_not_there_does_harm(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    base, final = fits
    wrong = fit(
        [recorded("train", 1, friction=True)],
        (FRICTION, COGGING),
        {**final.values, **WAVE},
        noise=final.noise,
        move=False,
    )
    named = named_with(base, wrong, COGGING)
    (friction,) = named_with(base, final).accepted
    named = replace(
        named,
        accepted=[friction, *named.accepted],
        losses={FRICTION.name: 300.0, COGGING.name: 100.0},
        without={FRICTION.name: base, COGGING.name: final},
    )
    (name, lost), *rest = simulated_worse(named, play).items()
    assert name == COGGING.name and not rest and max(lost.values()) > 1.0
    assert reason_of(lost).startswith("with it the simulation of the training data is worse: ")


def test_where_another_channel_is_better_by_more_it_is_no_harm(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    named, shown = named_with(*fits), {id(one): play(one) for one in fits}
    for better, harms in (({"psi": 4.0}, False), ({"psi": 1.0}, True), ({}, True)):
        monkeypatch.setattr(
            training_windows,
            "lowered",
            lambda one, _, *more, better=better: {"theta_rate": 2.0} if one.fit is named.base else better,
        )
        assert simulated_worse(named, lambda one: shown[id(one)]) == (
            {FRICTION.name: {"theta_rate": 2.0}} if harms else {}
        )


def test_it_is_weak_and_in_no_model_however_much_held_out_data_gain(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    named: Named = named_with(*fits)
    monkeypatch.setattr(confirmation_module, "simulated_worse", lambda *_: {FRICTION.name: {"theta_rate": 2.0}})
    found, _ = confirmed(named, recorded("held", 2, friction=True))
    assert found.statuses == {FRICTION.name: "weak"} and found.kept is named.final and found.written.names == ()
    assert (
        found.reason(FRICTION.name) == "with it the simulation of the training data is worse: theta_rate by 2.0 points"
    )


def test_a_true_wave_does_no_harm_where_the_simulation_keeps_its_place() -> None:
    values = {**PLANT.values, **WAVE}
    train = [stretch_with(PLANT, "train", 4, 16.0, [COGGING], values)]
    base = fit(train, (), PLANT.values)
    final = fit(train, (COGGING,), {**base.values, **WAVE}, like=base, noise=base.noise)
    assert simulated_worse(named_with(base, final, COGGING), play) == {}
