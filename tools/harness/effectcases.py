"""Plants and parameters for the tests of effects: sizes that matter on the device."""

from __future__ import annotations

from functools import cache

import numpy as np

from hoopd.files.shipped import defaults_folder
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.model_file import load_model
from hoopd.plants.plant_with_effects import Composite

VALUES = {
    "rolling": load_model(defaults_folder() / "models/hoop.yaml").values(),
    "published": load_model(defaults_folder() / "models/hoop.yaml").values(),
    "entries": load_model(defaults_folder() / "models/thesis.yaml").values(),
}
SIZES: dict[str, dict[str, float]] = {
    "actuator.torque_gain": {"k": 1.3},
    "actuator.torque_bias": {"b": 0.006},
    "actuator.deadzone": {"d": 0.02},
    "actuator.saturation": {"s": 0.06},
    "actuator.lag": {"T": 0.03},
    "actuator.delay": {"d": 0.027},
    "actuator.cogging": {"A": 0.008, "n": 7.0, "phi": 0.4},
    "actuator.ripple": {"a": 0.2, "n": 3.0, "phi": -0.7},
    "actuator.back_emf_limit": {"w0": 9.0},
    "hoop.coulomb_friction": {"Fc": 0.005},
    "hoop.stribeck_friction": {"Fc": 0.004, "Fs": 0.004, "vs": 0.8},
    "hoop.quadratic_drag": {"c": 1e-4},
    "hoop.imbalance": {"A": 0.01, "phi": 0.9},
    "hoop.friction_drift": {"a": 0.8, "T": 0.7},
    "ball.coulomb_friction": {"Fc": 1e-4},
    "ball.rolling_resistance": {"r": 1.5e-4},
    "ball.quadratic_drag": {"c": 1e-4},
    "ball.slip": {"mu": 0.08},
    "frame.tilt": {"d": 0.05},
    "frame.vibration": {"A": 0.5, "w": 25.0, "phi": 0.3},
    "external.disturbance": {"t0": 0.313, "t1": 0.622, "A": 0.03},
    "camera.latency": {"d": 0.033},
    "camera.angle_offset": {"d": 0.05},
    "camera.center_offset": {"dx": 0.05, "dy": -0.08},
    "camera.late_frames": {"share": 0.1},
    "camera.outliers": {"share": 0.05},
    "encoder.eccentricity": {"a": 0.05, "phi": 0.2, "follows": 1.0},
    "encoder.harmonic": {"a": 0.03, "n": 3.0, "phi": 0.4, "follows": 1.0},
    "encoder.latency": {"d": 0.011},
    "encoder.speed_lag": {"T": 0.06},
}
NAMES = tuple(SIZES)


@cache
def plant(structure: str, moving: str = "both") -> Plant:
    return hoop_plant(structure, VALUES[structure], moving)


@cache
def effects(structure: str, moving: str = "both") -> dict[str, Effect]:
    return library(plant(structure, moving))


def composite(
    structure: str, *names: str, moving: str = "both", substeps: int | None = None, **changes: float
) -> Composite:
    declared = hoop_plant(structure, {**VALUES[structure], **changes}, moving)
    return Composite(declared, [library(declared)[name] for name in names], substeps)


def sizes(*names: str) -> dict[str, float]:
    """Parameters of these effects by `slot.effect.parameter`."""
    return {f"{name}.{key}": value for name in names for key, value in SIZES[name].items()}


def two_level(seconds: float = 1.0, size: float = 0.1, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and torques of 20 ms."""
    n = round(seconds / 0.02)
    u = size * np.random.default_rng(seed).choice([-1.0, 1.0, 0.4], -(-n // 5))
    return np.arange(n + 1) * 0.02, np.repeat(u, 5)[:n]


def slide() -> Plant:
    """A motor-driven mass on a slide: m x'' = F - b x'."""
    return Plant(
        name="slide",
        coordinates=("x",),
        accelerations=lambda s, force: (force - s.p["b"] * s.dx) / s.p["m"],
        values={"m": 2.0, "b": 3.0},
        free=("m", "b"),
        inputs=(Input("u", "N", 20.0, "x"),),
        channels={"x": Channel("x")},
        slots={
            "drive": Slot("actuator", "x"),
            "slide": Slot("body", "x", speed=0.3),
            "ruler": Slot("sensor", "x", ("x",)),
            "push": Slot("push", "x"),
        },
        units={"m": "kg", "b": "N s/m"},
    )
