"""Two simulators that share nothing say the same of every effect: the generator's and hoopd's."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hoopd.plants import free_run as freerun
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.plant_with_effects import Composite

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

from concealed import plant  # noqa: E402
from concealed.control import Law  # noqa: E402
from concealed.effects import ALL, SINGLES  # noqa: E402
from concealed.sensors import Noise  # noqa: E402
from concealed.simulate import WARM, Columns, Trace, simulate  # noqa: E402

SAMPLES, QUIET = 75, 10  # rows; the first have no torque, so that what is late has settled
SETTLED = 25  # rows after which a low-passed reading has forgotten how it began
RANDOM = ("camera.late_frames", "camera.outliers")  # shares of samples, not equations
# Parameters that make each effect large on this run.
LARGE: dict[str, dict[str, float]] = {
    "actuator.torque_gain": {"k": 1.2},
    "actuator.torque_bias": {"b": 0.01},
    "actuator.deadzone": {"d": 0.03},
    "actuator.saturation": {"s": 0.09},
    "actuator.lag": {"T": 0.03},
    "actuator.delay": {"d": 0.0273},
    "actuator.cogging": {"A": 0.01, "n": 3.0, "phi": 0.7},
    "actuator.ripple": {"a": 0.3, "n": 2.0, "phi": -0.4},
    "actuator.back_emf_limit": {"w0": 18.0},
    "hoop.coulomb_friction": {"Fc": 0.01},
    "hoop.stribeck_friction": {"Fc": 0.008, "Fs": 0.01, "vs": 2.0},
    "hoop.quadratic_drag": {"c": 1e-4},
    "hoop.imbalance": {"A": 0.01, "phi": 1.0},
    "hoop.friction_drift": {"a": 3.0, "T": 1.0},
    "ball.coulomb_friction": {"Fc": 3e-4},
    "ball.rolling_resistance": {"r": 5e-4},
    "ball.quadratic_drag": {"c": 2e-4},
    "ball.slip": {"mu": 0.15},
    "frame.tilt": {"d": 0.08},
    "frame.vibration": {"A": 1.0, "w": 12.0, "phi": 0.5},
    "camera.latency": {"d": 0.0317},
    "camera.angle_offset": {"d": 0.05},
    "camera.center_offset": {"dx": 0.08, "dy": -0.05},
    "encoder.eccentricity": {"a": 0.05, "phi": 0.9, "follows": 1.0},
    "encoder.latency": {"d": 0.0137},
    "encoder.speed_lag": {"T": 0.04},
    "external.disturbance": {"A": 0.03, "t0": 0.5, "t1": 0.9},
}


def test_every_effect_of_the_table_is_compared() -> None:
    assert set(LARGE) | set(RANDOM) == set(SINGLES)


@pytest.mark.parametrize("name", LARGE)
def test_hoopd_simulates_an_effect_like_the_generator(name: str) -> None:
    plain, mine = generated(""), generated(name)
    moved = np.abs(mine.clean - plain.clean)[SETTLED:]
    missed = np.abs(mine.clean - theirs(name, mine))[SETTLED:]
    for channel in range(3):
        # 2 % of what the effect does, and what two integrators differ by anyway
        assert missed[:, channel].max() < 0.02 * moved[:, channel].max() + 5e-4, ("theta", "dtheta", "psi")[channel]


def torques() -> np.ndarray:
    """(WARM + SAMPLES,) N m: nothing, then levels of many sizes."""
    levels = np.random.default_rng(4).uniform(-0.16, 0.16, size=SAMPLES)
    held = np.repeat(levels, 4)[: SAMPLES - QUIET]
    return np.concatenate((np.zeros(WARM + QUIET), held))


@cache
def generated(name: str) -> Trace:
    """The generator's run with one effect, or with none."""
    effects = {name: LARGE[name]} if name else {}
    rows, none = WARM + SAMPLES, np.zeros(1)
    silent = np.zeros((rows, 1))
    never = np.zeros((rows, 1), bool)
    return simulate(
        Columns(
            device=plant.body({key: np.array([value]) for key, value in plant.DEVICE.items()}),
            effects={n: {k: np.array([p.get(k, v)]) for k, v in ALL[n].neutral.items()} for n, p in effects.items()},
            start=np.array([[0.3], [8.0], [0.5], [-2.0]]),
            feed=torques()[:, None],
            push=np.zeros((rows * plant.PIECES, 2, 1)),
            noise=Noise(silent, silent, never, never, np.full((rows, 1), np.nan)),
            law=Law(none, none, none, silent),
        )
    )


def theirs(name: str, mine: Trace) -> np.ndarray:
    """hoopd's readings (SAMPLES, 3) from the same first state."""
    hoop = hoop_plant("rolling", plant.DEVICE)
    effect = library(hoop)[name]
    composite = Composite(hoop, [effect])
    values = {effect.key(parameter.name): LARGE[name][parameter.name] for parameter in effect.parameters}
    t, u = np.arange(SAMPLES + 1) * plant.SAMPLE_S, torques()[WARM:]
    found = freerun.readings(composite, values, mine.states[0, :, 0], t, u)
    return np.stack([found[channel][:SAMPLES] for channel in ("theta", "dtheta", "psi")], axis=1)[..., None]
