"""Recordings that have a number in different ways are told, and which number; those that agree are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from diagnose.examples import parameters
from diagnose.madeup import NOISE, shipped_plant, stretch_with

from hoopd.diagnose.findings import disagreement_of
from hoopd.diagnose.proof.disagreement import Differs, differing
from hoopd.diagnose.proof.probabilities import where_recordings_differ
from hoopd.diagnose.record import NONE_OF_THESE, PARAMETERS, Disagreement
from hoopd.diagnose.report.headline import verdict_sentence
from hoopd.files.shipped import or_shipped
from hoopd.plants.effects.vocabulary import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.model_file import load_model

PLANT = shipped_plant()
EVERY = library(PLANT)
KNOWN = [EVERY[name] for name in ("actuator.torque_bias", "actuator.torque_gain", "camera.angle_offset", "frame.tilt")]
SECONDS, NEEDED = 20.0, 12.0


def fitted(*stretches: Stretch) -> HypothesisFit:
    return fit(stretches, (), PLANT.values)


def as_demanded(one: Stretch, gain: float = 1.0, push: float = 0.0) -> Stretch:
    """The recording of a drive that gave `gain` times what was demanded, and `push` beside it, N m."""
    return replace(one, u=(one.u - push) / gain)


@pytest.mark.parametrize("seed", range(4))
def test_recordings_of_one_device_agree(seed: int) -> None:
    assert (
        differing(fitted(*(stretch_with(PLANT, str(k), 10 * seed + k, SECONDS) for k in range(3))), KNOWN, NEEDED)
        is None
    )


@pytest.mark.parametrize("seed", range(4))
def test_a_slow_disturbance_of_one_recording_is_no_disagreement(seed: int) -> None:
    slow = NOISE._replace(force=5.0 * NOISE.force, time_s=np.array([1.0, 1.0]))
    quiet = stretch_with(PLANT, "a", 10 * seed + 7, SECONDS)
    stormy = stretch_with(PLANT, "b", 10 * seed + 8, SECONDS, noise=slow)
    assert differing(fitted(quiet, stormy), KNOWN, NEEDED) is None


def test_recordings_of_the_hoop_alone_and_with_its_ball_are_asked_what_both_know() -> None:
    alone = hoop_plant("entries", load_model(or_shipped(Path("models/thesis.yaml"))).values(), moving="hoop")
    noise = Noise(NOISE.force[:1], NOISE.time_s[:1], NOISE.reading[: len(alone.channels)])
    first = stretch_with(alone, "a", 1, SECONDS, noise=noise)
    found = fitted(first, as_demanded(stretch_with(PLANT, "b", 2, SECONDS), gain=0.9))
    told = differing(found, [EVERY["actuator.torque_gain"]], NEEDED)
    assert told is None or set(told.values) <= {"a", "b"}


def test_where_nothing_is_free_constants_are_asked() -> None:
    a, b = (stretch_with(PLANT, name, seed, SECONDS) for name, seed in (("a", 1), ("b", 2)))
    found = differing(fit([a, as_demanded(b, push=4e-3)], (), PLANT.values, free=()), KNOWN, NEEDED)
    assert found is not None and found.name == "actuator.torque_bias.b"


def test_a_single_recording_has_nobody_to_disagree_with() -> None:
    assert differing(fitted(stretch_with(PLANT, "a", 1, SECONDS)), KNOWN, NEEDED) is None


def test_a_drive_that_gives_less_in_one_recording_is_told_with_its_gains() -> None:
    a, b = (stretch_with(PLANT, name, seed, SECONDS) for name, seed in (("a", 1), ("b", 2)))
    found = differing(fitted(a, as_demanded(b, gain=0.94)), KNOWN, NEEDED)
    assert found is not None and found.gain > 3.0 * found.needed
    assert found.name == "actuator.torque_gain.k" or "actuator.torque_gain.k" in found.alike


def test_a_push_in_one_recording_is_told_with_its_size() -> None:
    a, b = (stretch_with(PLANT, name, seed, SECONDS) for name, seed in (("a", 1), ("b", 2)))
    found = differing(fitted(a, as_demanded(b, push=4e-3)), KNOWN, NEEDED)
    assert found is not None and found.name == "actuator.torque_bias.b"
    assert found.values["b"] == pytest.approx(4e-3, rel=0.3) and abs(found.values["a"]) < 1.5e-3
    assert 0.5 < found.probability <= 1.0


def test_the_order_of_the_recordings_says_nothing() -> None:
    a, b = (stretch_with(PLANT, name, seed, SECONDS) for name, seed in (("a", 1), ("b", 2)))
    b = as_demanded(b, push=4e-3)
    one, other = differing(fitted(a, b), KNOWN, NEEDED), differing(fitted(b, a), KNOWN, NEEDED)
    assert one is not None and other is not None and one.name == other.name
    assert one.gain == pytest.approx(other.gain, rel=1e-3)
    np.testing.assert_allclose([one.values[k] for k in "ab"], [other.values[k] for k in "ab"], rtol=1e-2, atol=1e-5)


def test_it_is_told_in_words_and_parameters_alone_are_no_longer_likely() -> None:
    differs = Differs(
        "actuator.torque_bias.b", {"one/a.csv": -2e-5, "one/b.csv": 5.9e-4}, 24.0, 10.2, ("frame.tilt.d",)
    )
    record = disagreement_of(differs, fitted(stretch_with(PLANT, "a", 1, 5.0)), EVERY)
    assert isinstance(record, Disagreement) and record.unit == "N m"
    said = verdict_sentence(msgspec.structs.replace(parameters()[0], disagreement=record))
    assert "the recordings disagree" in said and "a.csv" in said and "590" in said and "frame.tilt.d may be" in said
    assert "disagree" not in verdict_sentence(parameters()[0])
    shares = where_recordings_differ({PARAMETERS: 0.9, NONE_OF_THESE: 0.1}, differs.probability)
    assert shares[PARAMETERS] < 0.01 and sum(shares.values()) == pytest.approx(1.0)
    assert differs.probability > 0.99 and replace(differs, gain=10.2).probability == pytest.approx(0.5)
