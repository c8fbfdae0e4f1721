"""Effects chosen by the free run itself: what is there is taken, of what is not there nothing; chance is told."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from hoopd.diagnose.proof.best_of_library import BestOfAll, Choice, given_back, largest
from hoopd.diagnose.proof.free_run_record import effects_of
from hoopd.diagnose.proof.free_run_refinement import Refined, refine
from hoopd.diagnose.proof.free_run_selection import CHANCE, Selected, Selection, Step, worth
from hoopd.diagnose.proof.sensitivity import Sensitivity, memory
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.reference_track import Track
from tests.diagnose.madeup import NOISE, shipped_plant, stretch_with

PLANT = shipped_plant()
FEW = ("hoop.coulomb_friction", "camera.latency", "actuator.torque_bias", "hoop.imbalance")
LIBRARY = {name: library(PLANT)[name] for name in FEW}
COULOMB, LATENCY = LIBRARY["hoop.coulomb_friction"], LIBRARY["camera.latency"]
SOME = Noise(0.3 * NOISE.force, NOISE.time_s, NOISE.reading)
TRUE = {"hoop.coulomb_friction.Fc": 0.008}


def selection(fc: float, seconds: float = 8.0) -> Selection:
    effects, values = ([COULOMB], {"hoop.coulomb_friction.Fc": fc}) if fc else ([], {})
    stretches = [
        stretch_with(PLANT, name, seed, seconds, effects, {**PLANT.values, **values}, torque=0.1, noise=SOME)
        for name, seed in (("a", 11), ("b", 12))
    ]
    return Selection(stretches[:1], stretches[1:], LIBRARY)


def test_a_friction_is_taken_and_a_false_name_left_out() -> None:
    over = selection(0.008, 16.0)
    with pytest.MonkeyPatch.context() as patch:
        # held-out stretches are for the figures of what was chosen: nothing is chosen on them
        patch.setattr(Selection, "on_heldout", None)
        found = over.run([LATENCY], {**PLANT.values, "camera.latency.d": 0.03})
    assert "hoop.coulomb_friction" in found.names and "camera.latency" not in found.names
    assert found.refined.values["hoop.coulomb_friction.Fc"] == pytest.approx(0.008, abs=0.002)
    base = Selected((), over.grown((), PLANT.values))
    assert over.on_heldout(found).cost < 0.7 * over.on_heldout(base).cost
    taken = next(step for step in found.steps if step.effect == "hoop.coulomb_friction")
    assert taken.taken and taken.fitted > 0.3 and taken.chance <= CHANCE


def test_of_nothing_nothing_is_taken() -> None:
    found = selection(0.0).run((), PLANT.values)
    assert found.names == () and found.steps == []


@pytest.mark.proof
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
    # as rare as the largest draw of each of the four
    assert screen.chance("actuator.torque_bias", np.inf) <= 5e-4


def test_the_memory_of_an_error() -> None:
    random = np.random.default_rng(1)
    white, rho = random.normal(size=20000), 0.9
    slow = np.zeros(20000)
    for k in range(1, len(slow)):
        slow[k] = rho * slow[k - 1] + white[k]
    assert memory(white) == pytest.approx(1.0, abs=0.3)
    assert memory(slow) == pytest.approx((1 + rho) / (1 - rho), rel=0.25)


def test_a_negative_friction_gains_nothing() -> None:
    z, drawn = np.eye(4)[:, :1], np.array([[2.0, -2.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    for signed, gains in ((True, [2.0, 0.0]), (False, [2.0, 2.0])):
        assert largest(z.T @ z, z.T @ drawn, np.array([signed])) == pytest.approx(gains)


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
    found = largest(z.T @ z, z.T @ drawn, np.array(signed))
    assert found == pytest.approx(every_subset(z, drawn, np.array(signed)), rel=1e-6)


def test_many_recordings_with_a_phase_each_are_one_regression() -> None:
    """Eight recordings: sixteen columns, 65535 subsets, of which none but all of them can be the best."""
    random = np.random.default_rng(3)
    z, drawn = random.normal(size=(200, 16)), random.normal(size=(200, 5))
    solve, solved = np.linalg.solve, []

    def counted(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        solved.append(len(a))
        return np.asarray(solve(a, b))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np.linalg, "solve", counted)
        gains = largest(z.T @ z, z.T @ drawn, np.zeros(16, bool))
    whole = np.sum((z @ np.linalg.lstsq(z, drawn, rcond=None)[0]) ** 2, axis=0) / 2.0
    assert solved == [16] and gains == pytest.approx(whole, rel=1e-6)


def made_up_null(
    seed: int, blocks: int = 16, effects: int = 25
) -> tuple[list[Choice], np.ndarray, np.ndarray, np.ndarray]:
    """A library of coloured changes and an error that has nothing of them; blocks of twice the error's memory."""
    random, n, step = np.random.default_rng(seed), 40 * blocks, 20

    def coloured(memory: int, columns: int = 1) -> np.ndarray:
        white = random.normal(size=(n + memory, columns))
        return np.stack([np.convolve(one, np.ones(memory), "valid")[:n] for one in white.T], axis=1)

    known, _ = np.linalg.qr(coloured(30, 14))
    error = coloured(step)[:, 0]
    choices = []
    for k in range(effects):
        z = coloured(int(random.choice([3, 20, 60])), 1 + k % 2)
        choices.append(Choice(f"e{k}", z - known @ (known.T @ z), np.full(z.shape[1], k % 3 == 0)))
    return choices, error - known @ (known.T @ error), np.repeat(np.arange(blocks), n // blocks), known


def gain_of(one: Choice, error: np.ndarray) -> float:
    z = one.vectors
    return float(largest(z.T @ z, (z.T @ error)[:, None], one.signed)[0])


def chances(nulls: int) -> tuple[np.ndarray, np.ndarray]:
    """Of made-up nulls: the smallest of the effects' own chances, and of the chances of the best of the library."""
    own, best = [], []
    for seed in range(nulls):
        choices, error, blocks, known = made_up_null(seed)
        whole = given_back(error, known, blocks)
        found = BestOfAll(choices, whole, blocks, seed)
        alone = [BestOfAll([one], whole, blocks, seed).chance(one.name, gain_of(one, error)) for one in choices]
        own.append(min(alone))
        best.append(min(found.chance(one.name, gain_of(one, error)) for one in choices))
    return np.array(own), np.array(best)


@pytest.mark.proof
def test_chance_is_that_of_the_best_of_the_library_in_60_nulls() -> None:
    """Of made-up nulls some effect is below 5 % of its own chances in most, below 5 % of the best in few."""
    own, best = chances(60)
    assert np.mean(own <= CHANCE) > 0.5
    # 5 % of 60 are 3; of the right level, 8 or more come once in a hundred times
    assert np.mean(best <= CHANCE) < 8 / 60
    assert np.mean(best <= 0.5) > 0.25  # nor is nothing ever found


def test_chance_is_that_of_the_best_of_the_library() -> None:
    own, best = chances(15)
    assert np.mean(own <= CHANCE) > 0.5
    # 5 % of 15 are 1; of the right level, 4 or more come once in two hundred times
    assert np.mean(best <= CHANCE) < 4 / 15
    assert np.mean(best <= 0.5) > 0.25


def test_what_the_fit_took_of_the_error_is_given_back() -> None:
    """Of white errors with 24 free directions 10 rows a block are left less energy than they had."""
    random, blocks = np.random.default_rng(5), np.repeat(np.arange(8), 10)
    basis, _ = np.linalg.qr(random.normal(size=(80, 24)))
    errors = random.normal(size=(400, 80))
    rest = errors - errors @ basis @ basis.T
    found = np.array([given_back(one, basis, blocks) for one in rest])
    assert np.mean(rest**2) == pytest.approx(56 / 80, rel=0.05)
    assert np.mean(found**2) == pytest.approx(1.0, rel=0.05)


def test_what_is_there_is_rarer_than_the_best_by_chance() -> None:
    choices, error, blocks, _ = made_up_null(1)
    cause = choices[4].vectors[:, 0]
    with_it = error + 2.0 * cause * np.linalg.norm(error) / np.linalg.norm(cause)
    found = BestOfAll(choices, with_it, blocks, 0)
    assert found.chance("e4", gain_of(choices[4], with_it)) <= 0.01
    again = BestOfAll(choices, with_it, blocks, 0)
    assert again.chance("e5", 3.0) == found.chance("e5", 3.0)


def test_a_parameter_has_its_price() -> None:
    less, more = (Refined({}, free, [], cost) for free, cost in ((("a",), 1.0), (("a", "b"), 0.9)))
    assert worth(more, less, 100.0) and not worth(more, less, 10.0)


def test_the_record_tells_what_was_named_already() -> None:
    refined = Refined({**PLANT.values, **TRUE, "camera.latency.d": 0.02}, (), [], 1.0)
    chosen = Selected((LATENCY, COULOMB), refined, [Step("hoop.coulomb_friction", True, 0.4, 0.005)])
    first, second = effects_of(chosen, ["camera.latency"])
    assert first.named and first.error_share is None and first.parameters["d"].value == 0.02
    assert not second.named and (second.error_share, second.chance) == (0.4, 0.005)
