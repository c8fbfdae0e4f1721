"""What encoder and camera say of the motion, with the faults they may have.

Rules of this file: numpy only; a map takes the stored motion (every 2.5 ms, exact between by cubic interpolation) and
gives what a sensor without noise would say; noise, quantisation and losses come after it, drawn beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from concealed.forces import Moment
from concealed.outside import mechanisms, sensing
from concealed.plant import PIECES, SAMPLE_S, Array

COUNT_RAD = 2 * np.pi / 4096
PIECE_S = SAMPLE_S / PIECES
Effects = Mapping[str, Mapping[str, Array]]


@dataclass(frozen=True)
class Noise:
    """Drawn beforehand for every sample and device, (samples, B)."""

    dtheta: Array  # rad/s
    psi: Array  # rad
    missing: NDArray[np.bool_]  # no frame
    late: NDArray[np.bool_]  # the previous frame again
    outlier: Array  # rad of a false detection, NaN where there is none


def at(history: Array, newest: int, age_s: Array, position: int) -> tuple[Array, Array]:
    """Position and velocity (B,) `age_s` before row `newest` of the history (rows, 4, B); cubic between rows."""
    # a run that left every bound has no age: it is refused by its size elsewhere
    place = np.maximum(newest - np.nan_to_num(age_s) / PIECE_S, 0.0)
    row = np.minimum(place.astype(np.int64), max(newest - 1, 0))
    s, column = place - row, np.arange(history.shape[2])
    x0, v0 = history[row, position, column], history[row, position + 1, column] * PIECE_S
    x1, v1 = history[row + 1, position, column], history[row + 1, position + 1, column] * PIECE_S
    # Hermite: x(s) = x0 + v0 s + (3 d - 2 v0 - v1) s^2 + (v0 + v1 - 2 d) s^3 with d = x1 - x0
    d = x1 - x0
    c2, c3 = 3 * d - 2 * v0 - v1, v0 + v1 - 2 * d
    return x0 + s * (v0 + s * (c2 + s * c3)), (v0 + s * (2 * c2 + 3 * s * c3)) / PIECE_S


def low_passed(time_s: Array, reading: Array, before: Array, after: Array, h: float) -> Array:
    """Reading m a step later of T m' = y - m, y going in a straight line from `before` to `after`; T = 0 is y."""
    slow = np.maximum(time_s, 1e-9)
    run = (after - before) / h * slow
    # m(h) = y_1 - s T + (m_0 - y_0 + s T) e^(-h/T),  s = (y_1 - y_0)/h
    return after - run + (reading - before + run) * np.exp(-h / slow)


def seen(history: Array, newest: int, slow: Array | None, effects: Effects, moment: Moment) -> Array:
    """(theta, theta', psi) (3, B) as sensors without noise say them at row `newest`; slow: theta' low-passed.

    moment: the time of this row, and what sensors remember."""
    return np.stack((*_encoder(history, newest, slow, effects, moment), _camera(history, newest, effects, moment)))


def _encoder(history: Array, newest: int, slow: Array | None, effects: Effects, moment: Moment) -> tuple[Array, Array]:
    theta, dtheta = history[newest, 0], history[newest, 1]
    if "encoder.latency" in effects:
        theta, dtheta = at(history, newest, effects["encoder.latency"]["d"], 0)
    if slow is not None:
        dtheta = np.where(effects["encoder.speed_lag"]["T"] > 0, slow, dtheta)
    if "encoder.eccentricity" in effects:
        p = effects["encoder.eccentricity"]
        # `follows`: 1 when the driver differentiates the angle it sees, 0 when the speed has a sensor of its own
        dtheta = dtheta * (1 + p["follows"] * p["a"] * np.cos(theta + p["phi"]))
        theta = theta + p["a"] * np.sin(theta + p["phi"])
    for name, read in mechanisms.ENCODERS.items():
        if name in effects:
            theta, dtheta = read(effects[name], theta, dtheta, moment)
    return theta, dtheta


def _camera(history: Array, newest: int, effects: Effects, moment: Moment) -> Array:
    psi = history[newest, 2]
    if "camera.latency" in effects:
        psi, _ = at(history, newest, effects["camera.latency"]["d"], 2)
    if "unknown.speed_delay" in effects:
        late_s = effects["unknown.speed_delay"]["d"] * np.abs(history[newest, 3]) / 3.0
        slowed, _ = at(history, newest, np.minimum(late_s, 0.1), 2)
        psi = np.where(effects["unknown.speed_delay"]["d"] > 0, slowed, psi)
    if mechanisms.BEAT in effects:
        p = effects[mechanisms.BEAT]
        aged, _ = at(history, newest, sensing.beat_age_s(p, moment.t), 2)
        psi = np.where(p["d"] > 0, aged, psi)
    if "camera.angle_offset" in effects:
        psi = psi + effects["camera.angle_offset"]["d"]
    if "camera.center_offset" in effects:
        p = effects["camera.center_offset"]
        turns = 2 * np.pi * np.round(psi / (2 * np.pi))
        psi = turns + np.arctan2(np.sin(psi) + p["dx"], np.cos(psi) + p["dy"])
    if mechanisms.LENS in effects:
        psi = sensing.distortion(effects[mechanisms.LENS], psi)
    return psi


def recorded(clean: Array, before: Array, noise: Noise, k: int) -> tuple[Array, Array]:
    """Row k as it is recorded, (theta, theta', psi) (3, B), and the frame that is on the screen (B,).

    clean: the sensors without noise; before: the frame that was on the screen one sample ago.
    """
    theta = COUNT_RAD * np.round(clean[0] / COUNT_RAD)
    frame = np.where(noise.late[k], before, clean[2] + noise.psi[k])
    frame = np.where(np.isnan(noise.outlier[k]), frame, noise.outlier[k])
    psi = np.where(noise.missing[k], np.nan, frame)
    return np.stack((theta, clean[1] + noise.dtheta[k], psi)), frame
