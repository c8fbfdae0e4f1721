"""Recordings simulated from known parameters with the noise of encoder and camera: what recovery is tested on."""

from __future__ import annotations

from collections.abc import Mapping
from math import tau

import numpy as np

from hoopd.plants.fits.runs import Run
from hoopd.plants.hoop.recordings.fit_data import prepare
from hoopd.plants.hoop.simulate import HoopModel
from hoopd.recording.recording import Recording, from_columns

DEVICE = {
    "mb": 0.0608,
    "Ro": 0.0957,
    "Rb": 0.0104,
    "g": 9.81,
    "Ib": 3.679e-6,
    "Ih": 1.518e-3,
    "bb": 2.6e-6,
    "bh": 7e-4,
}
# The camera's noise and the encoder's step of the device.
PSI_SIGMA_RAD = 0.003
COUNT_RAD = tau / 4096


def recording_of(
    structure: str,
    parameters: Mapping[str, float],
    seed: int,
    seconds: float = 20.0,
    torque_nm: float = 0.03,
    unknown_nm: float = 0.0,
) -> Recording:
    """A two-level torque held for 0.1 to 0.3 s, 50 Hz, from 0.1 rad at rest: the ball stays below the axis.

    `unknown_nm`: standard deviation of a torque that the recording does not know, correlated over 0.3 s.
    """
    random = np.random.default_rng(seed)
    n = int(seconds * 50) + 1
    t = np.arange(n) * 0.02
    levels = np.repeat(random.choice([-1.0, 1.0], n), random.integers(5, 16, n))[:n] * torque_nm
    unknown = unknown_nm * _coloured(random, n, 0.3 / 0.02)
    x = HoopModel(structure, parameters).run([], [0.0, 0.0, 0.1, 0.0], t, (levels + unknown)[:-1])
    theta = np.round(x[:, 0] / COUNT_RAD) * COUNT_RAD
    psi = x[:, 2] + random.normal(0.0, PSI_SIGMA_RAD, n)
    return from_columns({"t": t, "u": levels, "theta": theta, "dtheta": x[:, 1], "psi": psi}, source=f"seed {seed}")


def runs_of(structure: str, parameters: Mapping[str, float], seed: int, **options: float) -> list[Run]:
    """The same, ready for a fit."""
    return prepare([recording_of(structure, parameters, seed, **options)])


def _coloured(random: np.random.Generator, n: int, samples: float) -> np.ndarray:
    """First-order noise of variance 1 with this correlation time."""
    keep, out = float(np.exp(-1.0 / samples)), np.zeros(n)
    white = random.normal(0.0, np.sqrt(1.0 - keep**2), n)
    for k in range(1, n):
        out[k] = keep * out[k - 1] + white[k]
    return out
