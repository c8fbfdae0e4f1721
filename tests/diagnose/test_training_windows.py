"""A name that blocks of the training data are simulated worse with is weak, says so, and is in no model."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from diagnose.confirming import FRICTION, SIZE, confirmed, named_with, recorded
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.proof import confirmation as confirmation_module, training_windows
from hoopd.diagnose.proof.training_windows import harm, reason_of, simulated_worse
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


def test_what_is_there_does_no_harm(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    assert simulated_worse(named_with(*fits), [FRICTION.name]) == {}
    assert simulated_worse(named_with(*fits), []) == {}


def test_a_wave_that_is_not_there_does_harm(fits: tuple[HypothesisFit, HypothesisFit]) -> None:
    base, final = fits
    wrong = fit(
        [recorded("train", 1, friction=True)],
        (FRICTION, COGGING),
        {**final.values, **WAVE},
        noise=final.noise,
        free=(),
    )
    named = named_with(base, wrong, COGGING)
    (friction,) = named_with(base, final).accepted
    named = replace(
        named,
        accepted=[friction, *named.accepted],
        losses={FRICTION.name: 300.0, COGGING.name: 100.0},
        without={FRICTION.name: base, COGGING.name: final},
    )
    (name, lost), *rest = simulated_worse(named, [FRICTION.name, COGGING.name]).items()
    assert name == COGGING.name and not rest and max(lost.values()) > 1.0
    assert reason_of(lost).startswith("with it blocks of the training data that were held back are simulated worse: ")
    # of what is denied already nothing is asked, and nothing is asked beside it
    assert simulated_worse(named, [FRICTION.name]) == {}


def test_where_another_channel_is_better_by_more_it_is_no_harm(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    named, asked = named_with(*fits), [FRICTION.name]
    for better, harms in (({"psi": 4.0}, False), ({"psi": 1.0}, True), ({}, True)):
        monkeypatch.setattr(
            training_windows,
            "lowered",
            lambda one, _, *more, better=better: {"theta_rate": 2.0} if one.fit is named.base else better,
        )
        assert simulated_worse(named, asked) == ({FRICTION.name: {"theta_rate": 2.0}} if harms else {})


def test_a_law_with_a_phase_that_moves_the_plant_has_to_bring_a_sure_gain(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    base, final = fits
    sensor = library(PLANT)["encoder.harmonic"]
    monkeypatch.setattr(training_windows, "lowered", lambda *_: {})
    each = [harm(lambda one, _: one, base, final, one, 0, 1) for one in (FRICTION, sensor, COGGING)]  # type: ignore[arg-type, return-value]
    assert each == [None, None, {}]
    assert reason_of({}).startswith("blocks of the training data that were held back are not surely simulated better")
    monkeypatch.setattr(training_windows, "lowered", lambda one, *_: {"psi": 2.0} if one is final else {})
    assert harm(lambda one, _: one, base, final, COGGING, 0, 1) is None  # type: ignore[arg-type, return-value]


def test_a_law_with_a_phase_may_not_lose_its_place_in_a_run_over_a_block(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Better in windows, and a point worse where the run is longer: it is in no model."""
    base, final = fits

    def lowered(one: Any, *_: Any) -> dict[str, float]:
        fitted, length_s = one
        return {"psi": 2.0} if (fitted is final) is (length_s is not None) else {}

    monkeypatch.setattr(training_windows, "lowered", lowered)
    assert harm(lambda *one: one, base, final, COGGING, 0, 1) == {}  # type: ignore[arg-type, return-value]
    assert harm(lambda *one: one, base, final, FRICTION, 0, 1) is None  # type: ignore[arg-type, return-value]


def test_laws_without_a_phase_are_asked_beside_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """What two say together neither says alone: the first of them, taken up by itself, would be left."""
    known = library(PLANT)
    one, two = known["actuator.delay"], known["hoop.quadratic_drag"]
    stretch = recorded("train", 1, friction=True)
    base = fit([stretch], (), PLANT.values)
    pair = fit([stretch], (one, two), base.values, like=base, noise=base.noise, move=False)
    named = named_with(base, pair, one)
    named.accepted.append(replace(named.accepted[0], effect=two))
    named.losses.update({one.name: 50.0, two.name: 40.0})
    named.without.clear()
    alone = {"theta_rate": 5.0}
    monkeypatch.setattr(
        training_windows, "lowered",
        lambda before, after, *_: alone if before.fit is base and len(after.fit.names) == 1 else {},
    )  # fmt: skip
    assert simulated_worse(named, [one.name, two.name]) == {}


def test_it_is_weak_and_in_no_model_however_much_held_out_data_gain(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    named: Named = named_with(*fits)
    monkeypatch.setattr(confirmation_module, "simulated_worse", lambda *_: {FRICTION.name: {"theta_rate": 2.0}})
    found, _ = confirmed(named, recorded("held", 2, friction=True))
    assert found.statuses == {FRICTION.name: "weak"} and found.kept is named.final and found.written.names == ()
    assert (
        found.reason(FRICTION.name)
        == "with it blocks of the training data that were held back are simulated worse: theta_rate by 2.0 points"
    )


def test_a_true_wave_is_not_worse_and_is_a_finding_whether_its_gain_is_sure_or_not(
    fits: tuple[HypothesisFit, HypothesisFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    values = {**PLANT.values, **WAVE}
    train = [stretch_with(PLANT, "train", 4, 16.0, [COGGING], values)]
    base = fit(train, (), PLANT.values)
    final = fit(train, (COGGING,), {**base.values, **WAVE}, like=base, noise=base.noise)
    assert simulated_worse(named_with(base, final, COGGING), [COGGING.name]).get(COGGING.name, {}) == {}
    # what is no sure gain is in no model, and no doubt of the name
    monkeypatch.setattr(confirmation_module, "simulated_worse", lambda *_: {FRICTION.name: {}})
    found, _ = confirmed(named_with(*fits), recorded("held", 2, friction=True))
    assert found.statuses == {FRICTION.name: "confirmed"} and found.reason(FRICTION.name) == reason_of({})
    assert found.kept.names == (FRICTION.name,) and found.written.names == ()
