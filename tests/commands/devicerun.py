"""Short runs of the thesis's device with dry friction on the hoop, as files: what a command line is tried on."""

from __future__ import annotations

from functools import cache
from math import tau
from pathlib import Path

import numpy as np

from hoopd.files.shipped import or_shipped
from hoopd.plants.model_file import load_model, plant_of
from hoopd.recording import save
from hoopd.recording.recording import Recording, from_columns

STEP_S, SUBSTEPS = 0.02, 10
# Of the disturbance on the hoop, N m and s; readings: an encoder's count, a rate's and a camera's noise.
PUSH_NM, PUSH_S = 1.5e-3, 0.15
COUNT, RATE_NOISE, PSI_NOISE = tau / 4096, 0.1, 0.002


@cache
def recorded(seed: int, seconds: float, friction_nm: float) -> Recording:
    """Torques of several levels, 0.12 s each; friction and disturbance are added to the torque every 2 ms."""
    plant, random, n = plant_of(load_model(or_shipped(Path("models/thesis.yaml")))), np.random.default_rng(seed), 0
    n, x, push = round(seconds / STEP_S), np.array([0.0, 0.0, random.uniform(-0.5, 0.5), 0.0]), 0.0
    u = np.repeat(random.choice([-0.12, -0.08, 0.08, 0.12], n // 6 + 1), 6)[:n]
    keep, rows = np.exp(-STEP_S / PUSH_S), []
    for k in range(n):
        rows.append(x)
        push = keep * push + np.sqrt(1.0 - keep**2) * PUSH_NM * random.normal()
        for _ in range(SUBSTEPS):
            x = plant.advance(x, u[k] + push - friction_nm * np.tanh(x[1] / 0.02), STEP_S / SUBSTEPS)
    theta, dtheta, psi, _ = np.array(rows).T
    theta = COUNT * np.round(theta / COUNT)
    dtheta, psi = dtheta + RATE_NOISE * random.normal(size=n), psi + PSI_NOISE * random.normal(size=n)
    return from_columns({"t": STEP_S * np.arange(n), "u": u, "theta": theta, "dtheta": dtheta, "psi": psi}, "made.csv")


def written(path: Path, seed: int, seconds: float, friction_nm: float = 0.0) -> Path:
    """The run as a file."""
    save(recorded(seed, seconds, friction_nm), path)
    return path
