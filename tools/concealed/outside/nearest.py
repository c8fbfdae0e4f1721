"""The name of the library that comes nearest to a mechanism outside it, and how many nats it leaves.

Along the true trajectory the mechanism's force and what it adds to the sensors are one column, a name of the library is
one or some of its own size; a name leaves |P d|^2/2, P without the eight entries and the columns of the name. Constants
that a name has inside (a cogging's n, a speed, a time) are on a grid, all at once, so that too little is left rather
than too much.

Rules of this file: numpy only, nothing of `hoopd`; `concealed.library` has most of the columns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from concealed import library, nats
from concealed.baselines import read
from concealed.disturbances import Colour
from concealed.plant import PIECES, SAMPLE_S, Array, Body, body
from concealed.simulate import WARM, Trace

MOTION = ("true_theta", "true_dtheta", "true_psi", "true_dpsi")
SENSORS = ("theta", "dtheta", "psi")
DRIFTS_S = (3.0, 15.0)
SPEEDS_RAD_S = (0.5, 2.0, 5.0)


class _Along(NamedTuple):
    """A recording at its samples, arrays (n,)."""

    s: library.Sample
    t: Array
    acceleration: Array
    device: Mapping[str, float]


def _stribeck(a: _Along) -> tuple[Array, ...]:
    one = np.tanh(a.s.dtheta / 0.1)
    return (one, *(one * np.exp(-((a.s.dtheta / speed) ** 2)) for speed in SPEEDS_RAD_S))


def _drift(a: _Along) -> tuple[Array, ...]:
    return tuple(a.s.dtheta * -np.expm1(-a.t / time_s) for time_s in DRIFTS_S)


def _resistance(a: _Along) -> tuple[Array, ...]:
    radius = a.device["Ro"] - a.device["Rb"]
    normal = np.maximum(radius * a.s.dpsi**2 + a.device["g"] * np.cos(a.s.psi), 0.0)
    return (np.tanh((a.s.dtheta - a.s.dpsi) / 0.1) * normal,)


# What `library` lacks: on the hoop, along the rolling rate, on theta and theta' together.
_ON_HOOP: Mapping[str, Callable[[_Along], tuple[Array, ...]]] = {
    "hoop.stribeck_friction": _stribeck,
    "hoop.friction_drift": _drift,
}
_ON_ROLL: Mapping[str, Callable[[_Along], tuple[Array, ...]]] = {
    "ball.coulomb_friction": lambda a: (np.tanh((a.s.dtheta - a.s.dpsi) / 0.1),),
    "ball.rolling_resistance": _resistance,
}


def nearest(
    files: Mapping[str, bytes], signals: Mapping[str, bytes], answer: Mapping[str, Any]
) -> dict[str, float | str | dict[str, float]]:
    """{"name", "left_nats", "nats", "left"}: the nearest name, what it leaves of all nats, what every name leaves."""
    total, names = None, {}
    for name in ("train_1.csv", "train_2.csv"):
        gram, names = _gram(read(files[name]), read(signals[name]), answer)
        total = gram if total is None else total + gram
    keep = list(range(nats.ENTRIES))
    own = _left(total, keep)
    left = {name: _left(total, [*keep, *(nats.ENTRIES + 1 + i for i in places)]) for name, places in names.items()}
    best = min(left, key=lambda name: left[name])
    return {"name": best, "left_nats": left[best], "nats": own, "left": left}


def _left(gram: Array, keep: list[int]) -> float:
    """Nats of the mechanism's column without those that are kept."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    normal = (gram / np.outer(scale, scale))[np.ix_(keep, keep)]
    seen = gram[keep, nats.ENTRIES] / scale[keep]
    left = gram[nats.ENTRIES, nats.ENTRIES] - seen @ np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ seen
    return float(max(left, 0.0) / 2)


def _gram(
    table: Mapping[str, Array], truth: Mapping[str, Array], answer: Mapping[str, Any]
) -> tuple[Array, dict[str, list[int]]]:
    """Gram matrix of entries, mechanism and the library's columns, and which columns are whose."""
    device = body({key: np.array([value]) for key, value in answer["base"].items()})
    states = np.stack([truth[key] for key in MOTION], axis=1)
    trace = _trace(table, truth, states)
    steps = nats.linear(trace, device)
    columns, names = _columns(table, states, answer["base"])
    own = (np.stack([truth[f"on_{key}"] for key in ("theta", "psi", "phi")]), np.stack([truth[key] for key in SENSORS]))
    changes = [_change(steps, device, *one) for one in (own, *columns)]
    noise, disturbed = answer["noise"], answer["disturbance"]
    sigmas = nats.sigmas_of(np.array([noise["dtheta_rad_s"]]), np.array([noise["psi_rad"]]))
    colour = Colour(disturbed["kind"], tuple(disturbed["rms_nm"]), tuple(disturbed["time_s"]))
    return nats.gram(trace, _Device(device), [colour], sigmas, changes)[0], names  # type: ignore[arg-type]


class _Device(NamedTuple):
    """As much of a batch's columns as information needs."""

    device: Body


def _trace(table: Mapping[str, Array], truth: Mapping[str, Array], states: Array) -> Trace:
    # the state after the last sample is not told: its motion goes on in a straight line
    last = states[-1].copy()
    last[[0, 2]] += SAMPLE_S * states[-1, [1, 3]]
    history = fine(np.concatenate((states, last[None])))[WARM * PIECES :]
    rows = np.stack([table[key] for key in SENSORS], axis=1)
    clean = states[:, :3] + np.stack([truth[key] for key in SENSORS], axis=1)
    return Trace(history[..., None], table["u"][:, None], clean[..., None], rows[..., None])


def _change(steps: nats.Linear, device: Body, forces: Array, sensors: Array) -> nats.Change:
    """forces (3, n) on theta, psi and phi' held for a sample, sensors (3, n)."""
    roll = device.ratio * forces[2]
    on_theta, on_psi = forces[0] + roll, forces[1] - roll
    push = np.stack((device.i11 * on_theta + device.i12 * on_psi, device.i12 * on_theta + device.i22 * on_psi), axis=-1)
    return nats.Change((steps.g[:, 0] @ push[..., None]), sensors.T[..., None])


def _columns(
    table: Mapping[str, Array], states: Array, base: Mapping[str, float]
) -> tuple[list[tuple[Array, Array]], dict[str, list[int]]]:
    """(forces (3, n), sensors (3, n)) of every column, and the columns of each name."""
    theta, dtheta, psi, dpsi = states.T
    u = table["u"]
    s = library.Sample(theta, dtheta, psi, dpsi, u, np.diff(u, prepend=u[:1]))
    a = _Along(s, np.arange(len(u)) * SAMPLE_S, np.gradient(dtheta, SAMPLE_S), base)
    none = np.zeros((3, len(u)))
    found: dict[str, list[tuple[Array, Array]]] = {}
    for name in library.FORCES:
        pairs = library.forces_of(name, s)
        found[name] = [(np.stack((hoop, ball, none[0])), none) for hoop, ball in pairs]
    for table_of, axis in ((_ON_HOOP, 0), (_ON_ROLL, 2)):
        for name, make in table_of.items():
            found[name] = [(np.where(np.arange(3)[:, None] == axis, x, 0.0), none) for x in make(a)]
    for name, sense in library.SENSORS.items():
        found[name] = [(none, np.where(np.arange(3)[:, None] == axis, x, 0.0)) for x, axis in sense(s, a.acceleration)]
    found["encoder.latency"] = [(none, np.stack((dtheta, a.acceleration, none[0])))]
    found["camera.angle_offset"] = [(none, np.stack((none[0], none[0], np.ones_like(u))))]
    columns, names = [], {}
    for name, parts in found.items():
        names[name] = list(range(len(columns), len(columns) + len(parts)))
        columns += parts
    return columns, names


def fine(states: Array) -> Array:
    """True motion (n, 4) every 2.5 ms, cubic between samples, with WARM samples in a straight line before the first."""
    back_s = SAMPLE_S * np.arange(WARM, 0, -1)[:, None]
    before = np.tile(states[0], (WARM, 1))
    before[:, [0, 2]] -= back_s * states[0, [1, 3]]
    x = np.concatenate((before, states))
    s = (np.arange(PIECES) / PIECES)[None, :, None]
    place, speed = x[:, None, [0, 2]], x[:, None, [1, 3]] * SAMPLE_S
    d, v0, v1 = place[1:] - place[:-1], speed[:-1], speed[1:]
    c2, c3 = 3 * d - 2 * v0 - v1, v0 + v1 - 2 * d
    there, rate = place[:-1] + s * (v0 + s * (c2 + s * c3)), (v0 + s * (2 * c2 + 3 * s * c3)) / SAMPLE_S
    inner = np.stack((there[..., 0], rate[..., 0], there[..., 1], rate[..., 1]), axis=-1).reshape(-1, 4)
    return np.concatenate((inner, x[-1:]))
