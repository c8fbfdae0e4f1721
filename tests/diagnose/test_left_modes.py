"""A ball that leaves the hoop: where its normal force nears zero is said and set aside, and names no physics."""

from __future__ import annotations

import numpy as np
import pytest
from harness.effectcases import VALUES, composite

from hoopd.diagnose.quality.left_modes import LEAST_MARGIN, left_modes
from hoopd.diagnose.search.excluded_intervals import without_events
from hoopd.lab import diagnose
from hoopd.plants.effects.library import library
from hoopd.plants.free_run import readings, run
from hoopd.plants.hoop.declaration import hoop_plant, pressed
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.recording.recording import Recording

V = VALUES["rolling"]
R = V["Ro"] - V["Rb"]
STEP_S = 0.02
# rad/s of the ball that rolls at the bottom: past the axis and too slow for the top, or well below the axis; and N m
FLIES, STAYS = (17.0, 0.1), (4.0, 0.03)


def torques(seed: int, seconds: float, most: float) -> np.ndarray:
    levels = np.random.default_rng(seed).choice([-1.0, -0.5, 0.5, 1.0], round(seconds / STEP_S) // 8 + 1)
    return most * np.repeat(levels, 8)[: round(seconds / STEP_S)]


def recorded(seed: int, drive: tuple[float, float], seconds: float = 12.0) -> tuple[Stretch, np.ndarray]:
    """A stretch with encoder and camera, and the true N / (m g) at its nodes (that of rolling, in the air, too)."""
    rate, most = drive
    random, u = np.random.default_rng(seed), torques(seed, seconds, most)
    t, x0, model = np.arange(len(u) + 1) * STEP_S, np.array([0.0, rate * R / V["Ro"], 0.0, rate]), ("ball.lift_off",)
    seen = readings(composite("rolling", *model), {}, x0, t, u)
    noise = {"theta": 4e-4, "dtheta": 0.1, "psi": 2e-3}
    y = np.stack([seen[name] + level * random.normal(size=len(t)) for name, level in noise.items()], axis=1)
    x = run(composite("rolling", *model), {}, x0, t, u)
    return Stretch("r", plant(), t, u, y), R * x[:, 3] ** 2 / V["g"] + np.cos(x[:, 2])


def plant():
    return hoop_plant("rolling", V)


def fitted(stretches) -> HypothesisFit:
    return fit(stretches, (), V)


def test_at_rest_the_hoop_carries_the_whole_weight() -> None:
    assert float(pressed(plant().point([0.0] * 4, V))) == 1.0


def test_where_the_normal_force_nears_zero_nothing_counts() -> None:
    stretch, margin = recorded(1, FLIES)
    assert margin.min() < 0.0
    data, base = without_events([stretch], fitted)
    (gone, *more) = data.removed
    assert "the ball's rolling nears its end" in gone.reason and gone in data.ignored
    kept = np.concatenate([one.t for one in data.kept])
    assert not np.isin(stretch.t[margin < 0.5 * LEAST_MARGIN], kept).any()
    # no more than what is near, and a margin
    assert len(kept) > len(stretch.t) - (margin < 2 * LEAST_MARGIN).sum() - 60 * (1 + len(more))
    # what the flight bent is straight again
    assert max(beside_the_truth(base).values()) < 0.03
    assert max(beside_the_truth(fitted([stretch])).values()) > 0.5


def beside_the_truth(found: HypothesisFit) -> dict[str, float]:
    return {name: abs(found.values[name] / V[name] - 1.0) for name in found.free}


def test_a_ball_that_stays_keeps_all_of_its_recording() -> None:
    stretch, margin = recorded(1, STAYS)
    assert margin.min() > 2 * LEAST_MARGIN
    data, _ = without_events([stretch], fitted)
    assert data.removed == [] and data.notes == [] and len(data.kept) == 1


def test_a_recording_of_little_else_is_kept_and_told_of() -> None:
    stretch, _ = recorded(1, FLIES)
    removed, (told,) = left_modes(fitted([stretch.seconds(7.2, 8.4)]))
    assert removed == [] and "too little would be left" in told


def test_a_model_that_has_the_flight_is_judged_by_all_of_it() -> None:
    stretch, _ = recorded(1, FLIES)
    flight = library(plant())["ball.lift_off"]
    assert left_modes(fit([stretch], (flight,), V)) == ([], [])


@pytest.mark.proof
def test_the_diagnosis_tells_of_it_and_names_nothing() -> None:
    whole = [recording(seed, FLIES, 20.0) for seed in (1, 2)]
    found = diagnose(whole[0], holdout=whole[1], model="hoop", grammar=False, free_run=False).diagnosis
    assert any("nears its end" in reason for _, _, reason in found.data_quality.segments_ignored)
    assert found.verdict == "consistent" and found.effects == []


def recording(seed: int, drive: tuple[float, float], seconds: float) -> Recording:
    made, _ = recorded(seed, drive, seconds)
    columns = dict(zip(("theta", "dtheta", "psi"), made.y.T, strict=True))
    return Recording(made.t, u=np.append(made.u, made.u[-1]), source=f"{seed}.csv", **columns)
