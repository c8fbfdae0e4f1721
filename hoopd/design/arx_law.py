"""LQG on an ARX model of a recording, judged on the plant.

Rules of this file: recordings and plants in, a `Law` out; nothing is read.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.design.arx import arx_lqg, fit_arx
from hoopd.design.controller_text import plain
from hoopd.design.laws import Law, Spec, on_both
from hoopd.design.lqg import observer_law, seen_plant
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.recording.recording import Recording

Array = NDArray[Any]

# What the law's tick is given: the hoop's speed, and the ball's angle of the newest picture.
SEEN = ("dtheta", "psi")


def design_arx(plant: HoopPlant, spec: Spec, recording: Recording, orders: tuple[int, int] = (4, 6)) -> Law:
    """LQG on an ARX model of what arrives in each tick; the plant judges it."""
    u, y = arriving(recording, spec)
    model = fit_arx(u, y, *orders)
    gains = arx_lqg(model, spec.weights, spec.sample_time_s)
    own = control.ss(gains.a, gains.b[:, None], gains.c, 0, spec.sample_time_s)
    law = observer_law(own, gains.filter_gain, gains.feedback[None, :])
    numbers = {
        "weights": asdict(spec.weights),
        "orders": {"outputs": orders[0], "torque": orders[1]},
        "innovation_std": {"dtheta_rad_s": model.covariance[0, 0] ** 0.5, "psi_rad": model.covariance[1, 1] ** 0.5},
    }
    plant_seen = seen_plant(plant, spec.sample_time_s, spec.delay_ticks)
    return on_both("lqg_linear", plain(gains._asdict()), law, plant_seen, numbers)


def arriving(recording: Recording, spec: Spec) -> tuple[Array, Array]:
    """u (n,), y (n, 2) = (dtheta, psi) by the tick in which they come; a file without times of its own is made late.

    A daemon's recording has each value in the row of its arrival. In a .mat, .csv or HDF5 file all of a row was taken
    at once, so the law's tick sees dtheta one row and psi `delay_ticks` rows later.
    """
    if abs(recording.sample_time_s / spec.sample_time_s - 1.0) > 0.01:
        reason = f"rows are {recording.sample_time_s:g} s apart, the tick has {spec.sample_time_s:g} s"
        raise ValueError(f"{reason}: resample the recording (hoopd convert --step)")
    y = np.stack([*(getattr(recording, name) for name in SEEN)], axis=1)
    if np.array_equal(recording.psi_t, recording.t):
        y = np.stack([_later(y[:, 0], 1), _later(y[:, 1], spec.delay_ticks)], axis=1)
    return recording.u, y


def _later(values: Array, rows: int) -> Array:
    return np.concatenate([np.full(rows, np.nan), values[: len(values) - rows]])
