"""What can be hidden: every effect of the library, seven that it lacks, decoys, and the family outside the library.

Rules of this file: the table decides; what a line of it means stands in `hidden`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from concealed.hidden import Hidden, Values, nothing, phase, sign
from concealed.outside.kinds import KINDS


def _plain(name: str, key: str, first: float, cap: float, **more: object) -> Hidden:
    """An effect whose one parameter is its size."""
    return Hidden(name, {key: 0.0}, nothing, lambda z, f: {key: z}, first, cap, sized=(key,), **more)  # type: ignore[arg-type]


def _signed(name: str, key: str, first: float, cap: float) -> Hidden:
    """An effect whose one parameter may have either sign."""
    return Hidden(
        name,
        {key: 0.0},
        lambda rng: {"sign": sign(rng)},
        lambda z, f: {key: f["sign"] * z},
        first,
        cap,
        sized=(key,),
    )


def _wave(name: str, key: str, orders: tuple[int, ...], first: float, cap: float) -> Hidden:
    """An effect periodic in the hoop's angle."""
    alone = orders == (1,)
    return Hidden(
        name,
        {key: 0.0, "phi": 0.0} if alone else {key: 0.0, "n": 1.0, "phi": 0.0},
        lambda rng: {"phi": phase(rng)} | ({} if alone else {"n": float(rng.choice(orders))}),
        lambda z, f: {**f, key: z},
        first,
        cap,
        sized=(key,),
    )


def _stribeck(rng: np.random.Generator) -> Values:
    return {"ratio": rng.uniform(0.6, 2.0), "vs": np.exp(rng.uniform(np.log(0.5), np.log(5.0)))}


def _eccentric(rng: np.random.Generator) -> Values:
    return {"phi": phase(rng), "follows": float(rng.integers(2))}


def _pulse(rng: np.random.Generator) -> Values:
    length, start = rng.uniform(0.2, 1.5), rng.uniform(3.0, 25.0)
    return {"t0": start, "t1": start + length, "sign": sign(rng), "recording": float(rng.integers(2))}


def _drift(rng: np.random.Generator) -> Values:
    return {"T": rng.uniform(3.0, 15.0), "sign": sign(rng)}


def _direction(rng: np.random.Generator) -> Values:
    return {"angle": phase(rng)}


_ORDERS = (2, 3, 4, 6, 7, 8, 12)

_TABLE: tuple[Hidden, ...] = (
    # A base parameter of `entries`: the right verdict is "parameters".
    Hidden(
        "actuator.torque_gain", {"k": 1.0}, lambda rng: {"sign": sign(rng)},
        lambda z, f: {"k": 1.0 + f["sign"] * z}, 0.15, 0.3, drawn=(0.1, 0.25), sized=("k",),
    ),
    _signed("actuator.torque_bias", "b", 2e-3, 0.03),
    _plain("actuator.deadzone", "d", 5e-3, 0.05),
    # The size is the share of the largest demanded torque that is cut; `peak` comes with the input.
    Hidden(
        "actuator.saturation", {"s": 1e6}, nothing,
        lambda z, f: {"s": f["peak"] * (1.0 - z)}, 0.15, 0.85, sized=("s",),
    ),
    _plain("actuator.lag", "T", 5e-3, 0.1),
    _plain("actuator.delay", "d", 5e-3, 0.06),
    _wave("actuator.cogging", "A", _ORDERS, 2e-3, 0.03),
    _wave("actuator.ripple", "a", (1, *_ORDERS), 0.05, 0.6),
    # The size is 0.7/w0 in units of the largest torque at the largest speed: the limit begins to bite near 1.
    Hidden(
        "actuator.back_emf_limit", {"w0": 1e9}, nothing,
        lambda z, f: {"w0": max(f["fastest"] / z, 4.0)}, 1.0, 8.0, sized=("w0",),
    ),
    _plain("hoop.coulomb_friction", "Fc", 2e-3, 0.03),
    Hidden(
        "hoop.stribeck_friction", {"Fc": 0.0, "Fs": 0.0, "vs": 1.0}, _stribeck,
        lambda z, f: {"Fc": z, "Fs": f["ratio"] * z, "vs": f["vs"]}, 2e-3, 0.02, sized=("Fc", "Fs"),
    ),
    _plain("hoop.quadratic_drag", "c", 1e-5, 2e-4),
    _wave("hoop.imbalance", "A", (1,), 2e-3, 0.03),
    Hidden(
        "hoop.friction_drift", {"a": 0.0, "T": 1.0}, _drift,
        lambda z, f: {"a": f["sign"] * z if f["sign"] > 0 else -min(z, 0.95), "T": f["T"]}, 0.5, 4.0, sized=("a",),
    ),
    _plain("ball.coulomb_friction", "Fc", 2e-5, 5e-4),
    _plain("ball.rolling_resistance", "r", 4e-5, 1e-3),
    _plain("ball.quadratic_drag", "c", 1e-5, 1e-3),
    # The size is 0.05/mu.
    Hidden("ball.slip", {"mu": 1e6}, nothing, lambda z, f: {"mu": 0.05 / z}, 1.0, 10.0, sized=("mu",)),
    _signed("frame.tilt", "d", 0.01, 0.1),
    Hidden(
        "frame.vibration", {"A": 0.0, "w": 1.0, "phi": 0.0},
        lambda rng: {"w": np.exp(rng.uniform(np.log(3.0), np.log(40.0)))},
        lambda z, f: {"A": z, "w": f["w"], "phi": f.get("phi", 0.0)}, 0.05, 3.0, sized=("A",), phased=True,
    ),
    _plain("camera.latency", "d", 2e-3, 0.06),
    _signed("camera.angle_offset", "d", 0.01, 0.1),
    Hidden(
        "camera.center_offset", {"dx": 0.0, "dy": 0.0}, _direction,
        lambda z, f: {"dx": z * np.cos(f["angle"]), "dy": z * np.sin(f["angle"])}, 0.02, 0.25, sized=("dx", "dy"),
    ),
    _plain("camera.late_frames", "share", 0.1, 0.25, drawn=(0.03, 0.2)),
    _plain("camera.outliers", "share", 0.1, 0.25, drawn=(0.03, 0.2)),
    Hidden(
        "encoder.eccentricity", {"a": 0.0, "phi": 0.0, "follows": 0.0}, _eccentric,
        lambda z, f: {**f, "a": z}, 5e-3, 0.1, sized=("a",),
    ),
    _plain("encoder.latency", "d", 1e-3, 0.06),
    _plain("encoder.speed_lag", "T", 2e-3, 0.15),
    Hidden(
        "external.disturbance", {"A": 0.0, "t0": 0.0, "t1": 0.0}, _pulse,
        lambda z, f: {"A": f["sign"] * z, "t0": f["t0"], "t1": f["t1"]}, 0.01, 0.2, sized=("A",),
    ),
)  # fmt: skip

# Outside every table: the right answer is that it is unknown, and where it sits.
_UNKNOWN: tuple[Hidden, ...] = (
    Hidden(
        "unknown.detent", {"A": 0.0, "q": 0.0, "w": 1.0},
        lambda rng: {"q": phase(rng), "w": rng.uniform(0.12, 0.35)}, lambda z, f: {**f, "A": z}, 5e-3, 0.1,
        location="hoop",
    ),
    Hidden(
        "unknown.reversal_loss", {"a": 0.0, "q": 1.0}, lambda rng: {"q": rng.uniform(0.3, 3.0)},
        lambda z, f: {**f, "a": z}, 0.2, 0.95, location="actuator",
    ),
    Hidden(
        "unknown.angle_friction", {"c": 0.0}, nothing, lambda z, f: {"c": z}, 5e-6, 1e-3, location="ball"
    ),
    Hidden(
        "unknown.heating", {"c": 0.0, "T": 1.0}, lambda rng: {"T": rng.uniform(1.0, 5.0)},
        lambda z, f: {**f, "c": z}, 1e-6, 1e-4, location="hoop",
    ),
    Hidden(
        "unknown.cable", {"k": 0.0, "q": 0.0}, nothing, lambda z, f: {"k": z, "q": f.get("q", 0.0)}, 1e-3, 0.1,
        location="hoop",
    ),
    Hidden("unknown.speed_delay", {"d": 0.0}, nothing, lambda z, f: {"d": z}, 5e-3, 0.08, location="camera"),
    Hidden(
        "unknown.track", {"k": 0.0}, lambda rng: {"sign": sign(rng)}, lambda z, f: {"k": f["sign"] * z}, 0.02, 0.3,
        location="ball",
    ),
)  # fmt: skip

# What leaves the verdict: neither sized by nats nor an effect.
_DECOYS: tuple[Hidden, ...] = (
    Hidden("decoy.hand", {"A": 0.0, "t0": 0.0, "t1": 1.0}, nothing, lambda z, f: {**f, "A": f["sign"] * z}, 0.01, 0.05),
    Hidden("decoy.drive_off", {"t1": 0.0}, nothing, lambda z, f: {"t1": z}, 0.5, 1.0),
)

ALL: Mapping[str, Hidden] = {item.name: item for item in (*_TABLE, *_UNKNOWN, *_DECOYS, *KINDS)}
SINGLES = tuple(item.name for item in _TABLE)
UNKNOWN = tuple(item.name for item in _UNKNOWN)
OUTSIDE = tuple(item.name for item in KINDS)
