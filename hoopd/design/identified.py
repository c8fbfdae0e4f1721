"""LQG on a model identified by any method: what arrives in each tick of (dtheta, psi), by the torque that was sent.

Rules of this file: models, plants and specifications in, a `Law` out; nothing is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.core.controllers import LinearGains
from hoopd.design.arx import linear_lqg
from hoopd.design.controller_text import plain
from hoopd.design.laws import Law, Spec, on_both
from hoopd.design.lqg import observer_law, seen_plant
from hoopd.plants.hoop.plant import HoopPlant

Array = NDArray[Any]

OUTPUTS = ("dtheta", "psi")


def design_identified(plant: HoopPlant, spec: Spec, model: Mapping[str, Array], sample_time_s: float) -> Law:
    """LQG on matrices a, b, c, d, k, r of an innovation form; the plant judges it. ValueError: not such a model."""
    if abs(sample_time_s / spec.sample_time_s - 1.0) > 0.01:
        raise ValueError(f"the model has a step of {sample_time_s:g} s, the tick {spec.sample_time_s:g} s")
    if model["b"].shape[1] != 1 or len(model["c"]) != len(OUTPUTS):
        raise ValueError(f"a law needs a model of one torque and the outputs {', '.join(OUTPUTS)}")
    if np.any(model["d"] != 0.0):
        raise ValueError("the model answers in the tick in which its torque is sent: no tick can see that")
    gains = gains_of(model, spec)
    own = control.ss(gains.a, gains.b[:, None], gains.c, 0, spec.sample_time_s)
    law = observer_law(own, gains.filter_gain, gains.feedback[None, :])
    deviations = np.sqrt(np.diag(model["r"]))
    numbers = {
        "weights": asdict(spec.weights),
        "states": len(model["a"]),
        "innovation_std": {"dtheta_rad_s": float(deviations[0]), "psi_rad": float(deviations[1])},
    }
    plant_seen = seen_plant(plant, spec.sample_time_s, spec.delay_ticks)
    return on_both("lqg_linear", plain(gains._asdict()), law, plant_seen, numbers)


def gains_of(model: Mapping[str, Array], spec: Spec) -> LinearGains:
    """Feedback and filter: dpsi is the change of psi in a tick by the model alone."""
    a, b, c, h = model["a"], model["b"][:, 0], model["c"], spec.sample_time_s
    rate = c[1] @ (a - np.eye(len(a))) / h
    return linear_lqg(a, b, c, rate, model["k"] @ model["r"] @ model["k"].T, model["r"], spec.weights, h)
