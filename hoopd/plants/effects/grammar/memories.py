"""What a mechanism remembers of its variable: hysteresis, play, a lag, a way, a reversal, a vibration.

A memory is one or two states beside the plant's. Each is given twice: as rates for the model, and as a recursion over
samples for a screen that tries many constants at once. Both are the same law; a test compares them.

    dahl       z' = (x' - |x'| z) / xs                     friction that is a spring first (Dahl 1968), -1..1
    play       z' = x' / b inside of -1..1                 backlash, or a spring that yields (Jenkin's element)
    lag        z' = (v - z) / T                            a relaxation, and what warms up and cools down
    wear       z' = (1 - z) |x'| / W                       what changes with the way that was gone, 0..1
    fading     1 - z of the same                           what was there at first and wears off
    reversal   z' = (sign x' - z) |x'| / W, from 0 at a reversal; 1 - |z| is 1 there and dies out over the way W
    age        z' = 1/T - z |x'| / L, T a usual sample: how old a contact is that its way renews; it strengthens with
               log(1 + z) (Dieterich 1979, Ruina 1983)
    twist      z' = (v - z)/T of an input that is held between samples, T of some samples and less
    hesitation T z' = v - z, T a part of a sample; (z - v) exp(-|v|/v0) makes a small v later than a large one
    rise, fall, up, down
               T z' = v - z; (z - v)/T where |v| grows, falls, v goes up, down: late in one direction alone

Bodies that swing or are loose: `memory_bodies`.

Rules of this file: no plant; laws only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hoopd.plants.effects.grammar.axes import INPUT, LOSS, POSITION, POWER, RATE, STATE
from hoopd.plants.effects.grammar.memory_bodies import BODIES
from hoopd.plants.effects.grammar.memory_law import PARTS, Array, Constants, MemoryLaw, carried, steps_of

# Lags that a search tries, in sample times; ways in mean ways a second.
LAG_SAMPLES = (3.0, 8.0, 20.0, 60.0, 200.0, 600.0)
HEAT_SAMPLES = (50.0, 150.0, 500.0, 1500.0)
TWIST_SAMPLES = (0.25, 0.75, 2.0, 6.0)
ONE_WAY_SAMPLES = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
WAY_S = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
WEAR_SHARES = (0.05, 0.15, 0.4, 1.0)
# Sizes below which something is late, in usual ones.
SIZES = (0.1, 0.3, 1.0, 3.0)
# Below this nothing moves: what is divided by it is far beyond any recording.
LEAST = 1e-12


# ---------------------------------------------------------------------------------------------- dahl


def _dahl_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    # no faster than a step of integration can follow
    return [(dv - ops.fabs(dv) * z[0]) / ops.fmax(c["xs"], ops.fabs(dv) * shortest_s)]


def _dahl_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    d = steps_of(v)
    way, left = np.sign(d), np.exp(-np.abs(d) / c["xs"])
    return carried(left, way * (1.0 - left))


def _ways(v: Array, t: Array) -> list[float]:
    """Lengths that the mean speed takes WAY_S for."""
    speed = float(np.sum(np.abs(np.diff(v))) / max(t[-1] - t[0], 1e-12))
    return [share * speed for share in WAY_S] if speed > 0.0 else []


# ---------------------------------------------------------------------------------------------- play


def _play_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    inside = ops.fmin(ops.fmax(z[0], -1.0), 1.0)
    return [dv / c["b"] - (z[0] - inside) / shortest_s]


def _play_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    z, out = 0.0, []
    for d in (steps_of(v) / c["b"]).tolist():
        z += d
        # conditions are half the time of min and max
        if z > 1.0:
            z = 1.0
        elif z < -1.0:
            z = -1.0
        out.append(z)
    return np.array(out)


# ---------------------------------------------------------------------------------------------- lag


def _lag_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    return [(v - z[0]) / ops.fmax(c["T"], shortest_s)]


def _lag_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    left = np.exp(-steps_of(t) / c["T"])
    middle = (v + np.concatenate([v[:1], v[:-1]])) / 2.0
    return carried(left, middle * (1.0 - left))


def _twist_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    # what was held until a sample has acted by then
    left = np.exp(-steps_of(t) / c["T"])
    return carried(left, np.concatenate([v[:1], v[:-1]]) * (1.0 - left))


def _lags(samples: Sequence[float]) -> Callable[[Array, Array], list[float]]:
    def grid(v: Array, t: Array) -> list[float]:
        h, length = float(np.median(np.diff(t))), float(t[-1] - t[0])
        return [h * one for one in samples if h * one < length]

    return grid


# ---------------------------------------------------------------------------------------------- wear, reversal


def _wear_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    return [(1.0 - z[0]) * ops.fabs(dv) / c["W"]]


def _wear_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    return np.asarray(1.0 - np.exp(-np.cumsum(np.abs(steps_of(v))) / c["W"]))


def _wear_grid(v: Array, t: Array) -> list[float]:
    way = float(np.sum(np.abs(np.diff(v))))
    return [share * way for share in WEAR_SHARES] if way > 0.0 else []


def _sign_of(kind: str) -> Callable[[Any, Any, Any], Any]:
    """What turns back: the way itself, or the input that drives it."""
    return (lambda ops, v, dv: ops.sign(dv)) if kind == POSITION else (lambda ops, v, dv: ops.sign(v))


def _reversal(kind: str) -> MemoryLaw:
    side = _sign_of(kind)

    def rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
        way = side(ops, v, dv)
        onward = (way - z[0]) * ops.fabs(dv) / ops.fmax(c["W"], ops.fabs(dv) * shortest_s)
        # the other way: forgotten within a step
        return [onward - ops.fmin(way * z[0], 0.0) * way / shortest_s]

    def along(v: Array, way: Array, t: Array, c: Constants) -> Array:
        d = steps_of(way)
        sign, left = side(np, v, d), np.exp(-np.abs(d) / c["W"])
        moving = sign != 0.0
        # the sign before: of the last sample that had one
        last = np.maximum.accumulate(np.where(moving, np.arange(len(v)), 0))
        before = sign[np.concatenate([[0], last[:-1]])]
        # where it turns all is forgotten, where it rests nothing changes
        kept = np.where(moving, np.where(sign * before >= 0.0, left, 0.0), 1.0)
        return np.asarray(1.0 - np.abs(carried(kept, sign * (1.0 - left))))

    turn = "changed its sign" if kind == INPUT else "turned back"
    return MemoryLaw(
        "reversal", (kind,), rates, lambda ops, z, v, c: 1.0 - ops.fabs(z[0]), along, "W", lambda axis: axis.way_unit,
        _ways, f"exp(-s/W), s the way since {{v}} {turn}", "dies out after each reversal of",
    )  # fmt: skip


# ---------------------------------------------------------------------------------------------- age, hesitation


def _age_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    # no faster than a step of integration can follow
    return [1.0 / (PARTS * shortest_s) - z[0] * ops.fabs(dv) / ops.fmax(c["L"], ops.fabs(dv) * shortest_s)]


def _age_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    renewed, onward = np.abs(steps_of(v)) / c["L"], np.ones(len(v))
    # exact while the speed is constant, T a sample: z -> z e^-r + (1 - e^-r)/r
    np.divide(-np.expm1(-renewed), renewed, out=onward, where=renewed > LEAST)
    return np.asarray(np.log1p(np.maximum(carried(np.exp(-renewed), onward), 0.0)))


def _hesitation(ops: Any, z: Sequence[Any], v: Any, c: Constants) -> Any:
    return (z[0] - v) * ops.exp(-ops.fabs(v) / c["v0"])


def _hesitation_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    return [(v - z[0]) / shortest_s]


def _hesitation_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    # of what was held until a sample, the mean of (z - v) until the next one, with z' = (v - z)/(h/PARTS)
    return np.asarray(-steps_of(v) / PARTS * np.exp(-np.abs(v) / c["v0"]))


def _sizes(v: Array, t: Array) -> list[float]:
    size = float(np.sqrt(np.mean(v**2)))
    return [share * size for share in SIZES] if size > 0.0 else []


# ---------------------------------------------------------------------------------------------- late one way


def _late(name: str, when: str, words: str) -> MemoryLaw:
    """What is late in one direction alone: a drive that conducts at once and lets go slowly, or the other way round."""
    by_size, grows = name in ("rise", "fall"), name in ("rise", "up")

    def value(ops: Any, z: Sequence[Any], v: Any, c: Constants) -> Any:
        more = ops.fabs(v) - ops.fabs(z[0]) if by_size else v - z[0]
        return (z[0] - v) / c["T"] * (1.0 + ops.sign(more if grows else -more)) / 2.0

    def along(v: Array, way: Array, t: Array, c: Constants) -> Array:
        # v is held until the next sample; exact: what is left of a step, and where its size passes that of v
        h = np.diff(t, append=t[-1:])
        left, rate = np.exp(-h / c["T"]), np.divide(1.0, h, out=np.zeros(len(h)), where=h > 0.0)
        before = np.concatenate([[1.0], left[:-1]])
        z = carried(before, (1.0 - before) * np.concatenate([v[:1], v[:-1]]))
        far = z - v
        if not by_size:
            whole = (far < 0.0) == grows
            return np.where(whole, far * (1.0 - left), 0.0) * rate
        # |v| > |z| where z is behind v and no farther than -v
        passed = np.where(far * v < 0.0, np.minimum(2.0 * np.abs(v) / np.maximum(np.abs(far), LEAST), 1.0), 0.0)
        growing = np.maximum(passed - left, 0.0)
        return np.asarray(far * (growing if grows else 1.0 - left - growing) * rate)

    return MemoryLaw(
        name, (INPUT,), _lag_rates, value, along, "T", lambda axis: "s", _lags(ONE_WAY_SAMPLES),
        f"(z - {{v}})/T where {when}, T z' = {{v}} - z", f"lags each {words} of", scaled=True, held=True,
        is_rate=True, is_chosen=True,
    )  # fmt: skip


ONE_WAY = (
    _late("rise", "|{v}| > |z|", "growth in size"), _late("fall", "|{v}| < |z|", "fall in size"),
    _late("up", "{v} > z", "step up"), _late("down", "{v} < z", "step down"),
)  # fmt: skip

MEMORIES: tuple[MemoryLaw, ...] = (
    MemoryLaw(
        "dahl", (POSITION,), _dahl_rates, lambda ops, z, v, c: z[0], _dahl_along, "xs", lambda axis: axis.unit, _ways,
        "z, z' = ({v}' - |{v}'| z)/xs", "comes from friction that gives way like a spring before it slides, along",
        dissipates=True,
    ),
    MemoryLaw(
        "play", (POSITION,), _play_rates, lambda ops, z, v, c: ops.fmin(ops.fmax(z[0], -1.0), 1.0), _play_along, "b",
        lambda axis: axis.unit, _ways, "z, z' = {v}'/b within -1..1", "comes from play, or a spring that yields, along",
        dissipates=True,
    ),
    MemoryLaw(
        "lag", (RATE, INPUT, STATE, POWER), _lag_rates, lambda ops, z, v, c: z[0], _lag_along, "T", lambda axis: "s",
        _lags(LAG_SAMPLES), "z, T z' = {v} - z", "follows, with a lag,", scaled=True,
    ),
    MemoryLaw(
        "twist", (INPUT,), _lag_rates, lambda ops, z, v, c: z[0], _twist_along, "T", lambda axis: "s",
        _lags(TWIST_SAMPLES), "z, T z' = {v} - z", "winds up under", scaled=True,
    ),
    MemoryLaw(
        "heat", (LOSS,), _lag_rates, lambda ops, z, v, c: z[0], _lag_along, "T", lambda axis: "s",
        _lags(HEAT_SAMPLES), "z, T z' = {v} - z", "warms up with, and cools down from,", scaled=True,
    ),
    MemoryLaw(
        "wear", (POSITION,), _wear_rates, lambda ops, z, v, c: z[0], _wear_along, "W",
        lambda axis: axis.unit, _wear_grid, "(1 - exp(-s/W)), s the way of {v}",
        "changes with the way that was gone along",
    ),
    MemoryLaw(
        "fading", (POSITION,), _wear_rates, lambda ops, z, v, c: 1.0 - z[0],
        lambda v, way, t, c: 1.0 - _wear_along(v, way, t, c), "W", lambda axis: axis.unit, _wear_grid,
        "exp(-s/W), s the way of {v}", "dies out with the way that was gone along",
    ),
    MemoryLaw(
        "age", (POSITION,), _age_rates, lambda ops, z, v, c: ops.log1p(ops.fmax(z[0], 0.0)), _age_along, "L",
        lambda axis: axis.unit, _ways, "log(1 + z), z' = 1/T - |{v}'| z/L, T a sample",
        "strengthens with the age of a contact, which is renewed by the way along",
    ),
    MemoryLaw(
        "hesitation", (INPUT,), _hesitation_rates, _hesitation, _hesitation_along, "v0", lambda axis: axis.unit,
        _sizes, "(z - {v}) exp(-|{v}|/v0), z after {v} by a part of a sample",
        "is late, the more so the smaller it is, behind", scaled=True, held=True,
    ),
    *ONE_WAY,
    _reversal(POSITION),
    _reversal(INPUT),
    *BODIES,
)  # fmt: skip
