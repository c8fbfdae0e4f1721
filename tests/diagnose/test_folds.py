"""Folds of the training data: what an effect gains in blocks whose rows it was not fitted to."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.search import folds
from hoopd.diagnose.search.candidates import Judge, Settings
from hoopd.diagnose.search.folds import FOLDS, fold_gain
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch

PLANT = shipped_plant()
FRICTION = library(PLANT)["hoop.coulomb_friction"]
BIAS = library(PLANT)["actuator.torque_bias"]
SECONDS = 18.0


def fits(stretch: Stretch, effect: object) -> tuple[HypothesisFit, HypothesisFit]:
    before = fit([stretch], (), PLANT.values)
    return before, fit([stretch], (effect,), before.values, like=before, noise=before.noise)  # type: ignore[arg-type]


def with_bias(sizes: tuple[float, ...]) -> Stretch:
    """A torque that is not told, another one in each part of the recording."""
    told = stretch_with(PLANT, "r", 3, SECONDS).u
    n = len(told) // len(sizes) + 1
    made = stretch_with(PLANT, "r", 3, SECONDS, u=told + np.repeat(sizes, n)[: len(told)])
    return replace(made, u=told)


def test_what_holds_throughout_gains_in_every_block_as_it_does_when_blocks_are_left_out_of_the_fit() -> None:
    stretch = stretch_with(PLANT, "r", 5, SECONDS, [FRICTION], {**PLANT.values, f"{FRICTION.name}.Fc": 0.006})
    before, after = fits(stretch, FRICTION)
    found = fold_gain(before, after)
    assert found is not None and found > 0.8 * (before.criterion - after.criterion) > 20.0
    edges = np.linspace(0.0, SECONDS, FOLDS + 1)
    gain = 0.0
    for k, (low, high) in enumerate(pairwise(edges)):
        rest = [stretch.seconds(a, b) for j, (a, b) in enumerate(pairwise(edges)) if j != k]
        own = [fit(rest, one.effects, one.values, noise=one.noise, tune_noise=False) for one in (before, after)]
        block = [stretch.seconds(low, high)]
        told = [fit(block, o.effects, o.values, noise=o.noise, tune_noise=False, free=()).criterion for o in own]
        gain += told[0] - told[1]
    assert found == pytest.approx(gain, rel=0.15)


def test_what_one_part_of_a_recording_asks_for_and_the_others_do_not_is_refused() -> None:
    before, after = fits(with_bias((0.03, -0.03, 0.03)), BIAS)
    gain = before.criterion - after.criterion
    loss = Judge([], {}, Settings()).fold_loss(before, after, max(gain, 0.0))
    assert loss is not None and loss > 3.0
    before, after = fits(with_bias((0.03, 0.03, 0.03)), BIAS)
    assert Judge([], {}, Settings()).fold_loss(before, after, before.criterion - after.criterion) is None


def test_a_block_is_asked_only_where_the_others_know_the_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """Next to nothing of it is elsewhere, and what there is is misleading: the block's own rows stay unasked."""
    n = 30
    track = SimpleNamespace(stretch=SimpleNamespace(t=np.arange(n) * 1.0, recording="day", y=np.zeros((n, 1))))
    for name, made in (("prior", (np.full(1, 1e-6), np.zeros(1))), ("ranges", {})):
        monkeypatch.setattr(folds, name, lambda *_, made=made: made)
    monkeypatch.setattr(folds, "_log_s", lambda found: np.zeros(n))

    def losses(first: float, others: float) -> list[float | None]:
        x = np.where(np.arange(n) < 10, first, others)
        rows = np.column_stack([np.where(x == others, -3.0, 0.0), -x])
        found: Any = SimpleNamespace(
            stacked=lambda: rows,
            effects=(),
            tracks=[track],
            free=("hoop.friction.Fc",),
            values={"hoop.friction.Fc": 0.0},
        )
        return [*folds._losses(found, {"hoop.friction"})]

    alone, *rest = losses(5.0, 0.5)
    assert alone is None and None not in rest
    assert None not in losses(1.0, 0.9)


def test_what_a_single_block_shows_is_not_refuted_by_the_others() -> None:
    push = library(PLANT)["external.disturbance"]
    own = {f"{push.name}.A": 0.02, f"{push.name}.t0": 7.0, f"{push.name}.t1": 7.6}
    stretch = stretch_with(PLANT, "r", 4, SECONDS, [push], {**PLANT.values, **own})
    before = fit([stretch], (), PLANT.values)
    start = {**before.values, **own, f"{push.name}.t0@r": 7.0, f"{push.name}.t1@r": 7.6}
    after = fit([stretch], (push,), start, like=before, noise=before.noise)
    assert before.criterion - after.criterion > 20.0
    assert Judge([], {}, Settings()).fold_loss(before, after, before.criterion - after.criterion) is None
