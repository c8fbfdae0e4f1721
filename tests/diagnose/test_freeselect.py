"""Effects chosen by the free run itself: what is there is taken, of what is not there nothing; chance is told."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from hoopd.diagnose.engine.filtering import Noise
from hoopd.diagnose.engine.track import Track
from hoopd.diagnose.proof.freechoice import effects_of
from hoopd.diagnose.proof.freeselect import Selected, Selection, Step, worth
from hoopd.diagnose.proof.refine import Refined, refine
from hoopd.diagnose.proof.sensitivity import Sensitivity, largest, memory
from hoopd.diagnose.search.screen import Column, Member
from hoopd.physics.effects.catalogue import library
from tests.diagnose.madeup import NOISE, shipped_plant, stretch_with

PLANT = shipped_plant()
FEW = ("hoop.coulomb_friction", "camera.latency", "actuator.torque_bias", "hoop.imbalance")
LIBRARY = {name: library(PLANT)[name] for name in FEW}
COULOMB, LATENCY = LIBRARY["hoop.coulomb_friction"], LIBRARY["camera.latency"]
SOME = Noise(0.3 * NOISE.force, NOISE.time_s, NOISE.reading)
TRUE = {"hoop.coulomb_friction.Fc": 0.008}


def selection(fc: float) -> Selection:
    effects, values = ([COULOMB], {"hoop.coulomb_friction.Fc": fc}) if fc else ([], {})
    stretches = [
        stretch_with(PLANT, name, seed, 8.0, effects, {**PLANT.values, **values}, torque=0.1, noise=SOME)
        for name, seed in (("a", 11), ("b", 12))
    ]
    return Selection(stretches[:1], stretches[1:], LIBRARY)


def test_a_friction_is_taken_and_a_false_name_left_out() -> None:
    over = selection(0.008)
    found = over.run([LATENCY], {**PLANT.values, "camera.latency.d": 0.03})
    assert "hoop.coulomb_friction" in found.names and "camera.latency" not in found.names
    assert found.refined.values["hoop.coulomb_friction.Fc"] == pytest.approx(0.008, abs=0.002)
    base = Selected((), over.grown((), PLANT.values))
    assert over.heldout_error(found) < 0.7 * over.heldout_error(base)
    taken = next(step for step in found.steps if step.effect == "hoop.coulomb_friction")
    assert taken.taken and taken.fitted > 0.3 and taken.chance <= 0.02


def test_of_nothing_nothing_is_taken() -> None:
    found = selection(0.0).run((), PLANT.values)
    assert found.names == () and found.steps == []


def test_several_starts_are_never_worse_than_the_base() -> None:
    over = selection(0.0)
    base = over.grown((), PLANT.values)
    wrong = {**PLANT.values, "hoop.imbalance.A": 0.05, "hoop.imbalance.phi": 2.0}
    assert over.fitted([LIBRARY["hoop.imbalance"]], wrong, base).cost < 1.001 * base.cost


def test_the_sensitivity_is_the_change_of_the_run() -> None:
    stretch = selection(0.008).train[0]
    base = refine([stretch], [Track(stretch).z], (), PLANT.values, PLANT.free)
    screen = Sensitivity(base, (), list(LIBRARY.values()), 0)
    scores = {score.member.effect.name: score for score in screen.scores()}
    assert max(scores, key=lambda name: scores[name].gain) == "hoop.coulomb_friction"
    assert scores["hoop.coulomb_friction"].start["hoop.coulomb_friction.Fc"] == pytest.approx(0.008, rel=0.4)
    # never more than there is, and rarer the larger it is
    assert all(0.0 <= score.gain <= np.sum(screen.residual**2) / 2.0 for score in scores.values())
    assert screen.chance("actuator.torque_bias", 0.0) == 1.0
    assert screen.chance("actuator.torque_bias", np.inf) == pytest.approx(1.0 / 400.0)


def test_the_memory_of_an_error() -> None:
    random = np.random.default_rng(1)
    white, rho = random.normal(size=20000), 0.9
    slow = np.zeros(20000)
    for k in range(1, len(slow)):
        slow[k] = rho * slow[k - 1] + white[k]
    assert memory(white) == pytest.approx(1.0, abs=0.3)
    assert memory(slow) == pytest.approx((1 + rho) / (1 - rho), rel=0.25)


def test_a_negative_friction_gains_nothing() -> None:
    z = np.eye(4)[:, :1]
    signed = Member(COULOMB, {}, (Column((("Fc", 0.003),), signed=True),))
    free = Member(COULOMB, {}, (Column((("Fc", 0.003),)),))
    drawn = np.array([[2.0, -2.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    assert largest(z, drawn, signed) == pytest.approx([2.0, 0.0])
    assert largest(z, drawn, free) == pytest.approx([2.0, 2.0])


def every_subset(z: np.ndarray, drawn: np.ndarray, signed: np.ndarray) -> np.ndarray:
    """The largest gain by trying all of them."""
    best = np.zeros(drawn.shape[1])
    for count in range(1, len(signed) + 1):
        for some in map(list, combinations(range(len(signed)), count)):
            weight = np.linalg.lstsq(z[:, some], drawn, rcond=None)[0]
            allowed = np.all((weight >= 0.0) | ~signed[some, None], axis=0)
            best = np.maximum(best, np.where(allowed, np.sum(weight * (z[:, some].T @ drawn), axis=0) / 2.0, 0.0))
    return best


@pytest.mark.parametrize("signed", [(False,), (True, True), (True, False, True), (False, False, True, False)])
def test_only_signed_columns_are_left_out(signed: tuple[bool, ...]) -> None:
    random = np.random.default_rng(len(signed))
    z, drawn = random.normal(size=(40, len(signed))), random.normal(size=(40, 200))
    member = Member(COULOMB, {}, tuple(Column((), signed=one) for one in signed))
    assert largest(z, drawn, member) == pytest.approx(every_subset(z, drawn, np.array(signed)), rel=1e-6)


def test_many_recordings_with_a_phase_each_are_one_regression() -> None:
    """Eight recordings: sixteen columns, 65535 subsets, of which none but all of them can be the best."""
    random = np.random.default_rng(3)
    z, drawn = random.normal(size=(200, 16)), random.normal(size=(200, 5))
    member = Member(LIBRARY["hoop.imbalance"], {}, tuple(Column((), f"r{i // 2}") for i in range(16)))
    with pytest.MonkeyPatch.context() as patch:
        solved: list[int] = []
        solve = np.linalg.solve
        patch.setattr(np.linalg, "solve", lambda a, b: solved.append(len(a)) or solve(a, b))
        gains = largest(z, drawn, member)
    whole = np.sum((z @ np.linalg.lstsq(z, drawn, rcond=None)[0]) ** 2, axis=0) / 2.0
    assert solved == [16] and gains == pytest.approx(whole, rel=1e-6)


def test_a_parameter_has_its_price() -> None:
    less, more = (Refined({}, free, [], cost) for free, cost in ((("a",), 1.0), (("a", "b"), 0.9)))
    assert worth(more, less, 100.0) and not worth(more, less, 10.0)


def test_the_record_tells_what_was_named_already() -> None:
    refined = Refined({**PLANT.values, **TRUE, "camera.latency.d": 0.02}, (), [], 1.0)
    chosen = Selected((LATENCY, COULOMB), refined, [Step("hoop.coulomb_friction", True, 0.4, 0.005)])
    first, second = effects_of(chosen, ["camera.latency"])
    assert first.named and first.error_share is None and first.parameters["d"].value == 0.02
    assert not second.named and (second.error_share, second.chance) == (0.4, 0.005)
