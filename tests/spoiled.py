"""Simulated recordings and what can go wrong with them: what data quality is tested on."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from freeruns import COUNT_RAD, DEVICE, PSI_SIGMA_RAD
from numpy.typing import NDArray

from hoopd.plants.hoop.simulate import HoopModel
from hoopd.recording.recording import Recording, from_columns

Array = NDArray[np.float64]
STEP_S = 0.02
MODEL = HoopModel("rolling", DEVICE)
DTHETA_SIGMA = 0.1


def torque(kind: str, random: np.random.Generator, n: int) -> Array:
    """Two levels, many levels, a sine, or nothing."""
    held = random.integers(2, 16, n)
    return {
        "two": np.repeat(random.choice([-1.0, 1.0], n), held)[:n] * 0.03,
        "many": np.repeat(random.uniform(-1.0, 1.0, n), held)[:n] * 0.1,
        "sine": 0.1 * np.sin(np.pi * STEP_S * np.arange(n)),
        "none": np.zeros(n),
    }[kind]


def clean(seed: int, seconds: float = 30.0, kind: str = "two", start: tuple[float, ...] = (0, 0, 0.1, 0)) -> Recording:
    """Encoder in counts, noise on speed and camera; the exact angle of the ball in `extra`."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds / STEP_S) + 1) * STEP_S
    u = torque(kind, random, len(t))
    x = MODEL.run([], start, t, u[:-1])
    return _measured(random, t, u, x)


def closed_loop(seed: int, seconds: float = 30.0) -> Recording:
    """A harsh controller on the noisy angle itself: the torque carries the camera's noise back into the motion."""
    random = np.random.default_rng(seed)
    n = round(seconds / STEP_S) + 1
    noise, wanted = random.normal(0.0, PSI_SIGMA_RAD, n), np.repeat(random.uniform(-0.8, 0.8, n), 100)[:n]
    x, u, before = np.zeros((n, 4)), np.zeros(n), 0.0
    for k in range(n):
        seen = x[k, 2] + noise[k]
        u[k] = np.clip(-0.3 * (seen - wanted[k]) - 1.2 * (seen - before) - 0.002 * x[k, 1], -0.7, 0.7)
        before = seen
        if k < n - 1:
            x[k + 1] = MODEL.run([], x[k], [0.0, STEP_S], [u[k]])[-1]
    recording = _measured(random, np.arange(n) * STEP_S, u, x)
    return replace(recording, psi=x[:, 2] + noise)


def _measured(random: np.random.Generator, t: Array, u: Array, x: Array) -> Recording:
    columns = {
        "t": t,
        "u": u,
        "theta": np.round(x[:, 0] / COUNT_RAD) * COUNT_RAD,
        "dtheta": x[:, 1] + random.normal(0.0, DTHETA_SIGMA, len(t)),
        "psi": x[:, 2] + random.normal(0.0, PSI_SIGMA_RAD, len(t)),
        "exact": x[:, 2],
    }
    return from_columns(columns, source="simulated")


def chosen(recording: Recording, share: float, seed: int = 0) -> NDArray[np.bool_]:
    """Rows at random, the first never."""
    rows = np.random.default_rng(seed).random(len(recording)) < share
    rows[0] = False
    return rows


def late(recording: Recording, rows: NDArray[np.bool_], equal: bool) -> Recording:
    """psi of these rows is the value before, to the bit, or the angle before with noise of its own."""
    psi, exact = recording.psi.copy(), recording.extra["exact"]
    for k in np.flatnonzero(rows):
        psi[k] = psi[k - 1] if equal else exact[k - 1] + psi[k] - exact[k]
    return replace(recording, psi=psi)


def false(recording: Recording, rows: NDArray[np.bool_], size_rad: float | None, seed: int = 0) -> Recording:
    """psi of these rows is off by +-size, or anywhere."""
    random, psi = np.random.default_rng(seed + 1), recording.psi.copy()
    count = int(rows.sum())
    anywhere = random.uniform(-1.5, 1.5, count)
    psi[rows] = anywhere if size_rad is None else psi[rows] + random.choice([-1.0, 1.0], count) * size_rad
    return replace(recording, psi=psi)


def changed(recording: Recording, name: str, rows: Any, values: Any) -> Recording:
    """One column with other values in some rows."""
    column = getattr(recording, name).copy()
    column[rows] = values
    return replace(recording, **{name: column})
