"""The filter behind known delays: readings at their own time, torques when they arrive, the state ahead."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hoopd.core.estimator import DelayedEkf
from hoopd.core.late import Delays, LateEstimator
from hoopd.core.records import CameraSample, DriverSample, Estimate
from hoopd.plants.model_file import load_model, plant_of

PLANT = plant_of(load_model(Path(__file__).resolve().parents[2] / "config" / "models" / "hoop.yaml"))
STEP = PLANT.step_and_jacobian
H = 0.02


def late(delays: Delays) -> LateEstimator:
    return LateEstimator(DelayedEkf(STEP), STEP, delays)


def torque(k: int) -> float:
    return 0.05 * (-1) ** (k // 9)


def watched(estimator: DelayedEkf | LateEstimator, delays: Delays, ticks: int = 150) -> tuple[list[Estimate], list]:
    """Estimates of a noiseless plant whose torque and readings are late by `delays`; and its states at the ticks."""
    fine = 0.001
    x, past, estimates, states = np.array([0.0, 0.0, 0.3, 0.0]), [], [], []
    for step in range(int(ticks * H / fine)):
        t = step * fine
        past.append(x)
        if step % 20 == 0:
            k = step // 20

            def at(age_s: float, now: int = step) -> np.ndarray:
                return past[max(0, now - round(age_s / fine))]

            seen, hoop = at(0.04 + delays.camera_s), at(delays.encoder_s)
            camera = CameraSample(k, t - 0.04, t, float(seen[2]), 1.0, 0.0, 0.0)
            driver = DriverSample(t, k % 256, 1, 0, float(hoop[0]), float(hoop[1]), 0.0, 0)
            before = torque(k - 1) if k else 0.0
            estimates.append(estimator.update(t, before, t - H, driver, camera if t >= 0.04 else None))
            states.append(x)
        sent = step - round(delays.torque_s / fine)
        x = PLANT.advance(x, torque(sent // 20) if sent >= 0 else 0.0, fine)
    return estimates, states


def test_no_delay_gives_the_same_bits() -> None:
    plain, _ = watched(DelayedEkf(STEP), Delays())
    wrapped, _ = watched(late(Delays()), Delays())
    for one, other in zip(plain, wrapped, strict=True):
        assert one.x.tobytes() == other.x.tobytes() and one[1:5] == pytest.approx(other[1:5], nan_ok=True)
        assert other.ahead is None


@pytest.mark.parametrize("delays", [Delays(0.03, 0.0, 0.0), Delays(0.0, 0.04, 0.0), Delays(0.0, 0.0, 0.02)])
def test_what_is_known_to_be_late_is_no_error(delays: Delays) -> None:
    for known, good in ((delays, True), (Delays(), False)):
        estimates, states = watched(late(known), delays)
        error = np.abs([e.x - x for e, x in zip(estimates, states, strict=True)])[50:].max(axis=0)
        assert (error < (2e-3, 2e-2, 2e-3, 2e-2)).all() == good, error


def test_the_state_ahead_is_where_this_ticks_torque_acts() -> None:
    delays = Delays(torque_s=0.04)
    estimates, states = watched(late(delays), delays)
    ahead = np.array([e.ahead for e in estimates])[50:-2]
    # the torque of the tick before is in it, that of this tick not yet: it acts from there on
    assert np.abs(ahead - np.array(states)[52:]).max(axis=0) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=0.03)
