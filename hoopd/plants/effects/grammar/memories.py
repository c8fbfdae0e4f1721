"""What a mechanism remembers of its variable: hysteresis, play, a lag, a way, a reversal, a vibration.

A memory is one or two states beside the plant's. Each is given twice: as rates for the model, and as a recursion over
samples for a screen that tries many constants at once. Both are the same law; a test compares them.

    dahl       z' = (x' - |x'| z) / xs                     friction that is a spring first (Dahl 1968), -1..1
    play       z' = x' / b inside of -1..1                 backlash, or a spring that yields (Jenkin's element)
    lag        z' = (v - z) / T                            a relaxation, and what warms up and cools down
    wear       z' = (1 - z) |x'| / W                       what changes with the way that was gone, 0..1
    fading     1 - z of the same                           what was there at first and wears off
    reversal   z' = (sign x' - z) |x'| / W, from 0 at a reversal; 1 - |z| is 1 there and dies out over the way W
    resonance  z'' = w^2 (v - z) - 2 zeta w z'             something that swings on it; z - v is what it adds
    swing      z' = -w (w r + 2 zeta r'), r' = z - v: a body that hangs on what moves at the rate v, and feels z'/w
    loose      z' = -w (w o + r') where it is pushed, r' = z - v, o what r exceeds +-b: a body that coasts in a gap
               on what moves at the rate v, and feels z'/w at its stops (Nordin, Gutman 2002)
    age        z' = 1/T - z |x'| / L, T a usual sample: how old a contact is that its way renews; it strengthens with
               log(1 + z) (Dieterich 1979, Ruina 1983)
    twist      z' = (v - z)/T of an input that is held between samples, T of some samples and less
    hesitation T z' = v - z, T a part of a sample; (z - v) exp(-|v|/v0) makes a small v later than a large one

Rules of this file: no plant; laws only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.files.dimensions import product_text
from hoopd.plants.effects.grammar.axes import INPUT, LOSS, POSITION, POWER, RATE, STATE, Axis

Array = NDArray[np.float64]
Constants = Mapping[str, Any]

# Lags that a search tries, in sample times; ways in mean ways a second; frequencies below half of Nyquist's.
LAG_SAMPLES = (3.0, 8.0, 20.0, 60.0, 200.0, 600.0)
HEAT_SAMPLES = (50.0, 150.0, 500.0, 1500.0)
TWIST_SAMPLES = (0.25, 0.75, 2.0, 6.0)
WAY_S = (0.01, 0.03, 0.1, 0.3, 1.0)
WEAR_SHARES = (0.05, 0.15, 0.4, 1.0)
RESONANCES, SWINGS = 12, 96
# Gaps, in ways at the mean rate; a stop's radians in a memory's substep; its damping: hardly anything bounces.
GAPS_S = tuple(0.005 * 1.3**k for k in range(12))
STOPS, STOP_DAMPING = (0.25, 0.5), 0.5
SLOWEST_SAMPLES = 100.0  # of a period
DAMPING, LARGEST_DAMPING = 0.1, 0.99
# Of a part that hangs, each beside every so many of its frequencies: these lie a little farther apart than the part's
# response is half as wide.
DAMPINGS = ((0.03, 1), (0.1, 3), (0.3, 9))
# Sizes below which something is late, in usual ones.
SIZES = (0.1, 0.3, 1.0, 3.0)
# What is late by a part of a sample is so by this one: as many substeps as a memory has.
PARTS = 5
# Below this nothing moves: what is divided by it is far beyond any recording.
LEAST = 1e-12


@dataclass(frozen=True)
class MemoryLaw:
    """One law of this file.

    Attributes
    ----------
    name : str
        As it stands in a name.
    kinds : tuple of str
        Axes that it may remember.
    rates : callable
        (ops, z, v, dv, constants, shortest_s) -> rates of the states z; dv is the rate of the way.
    value : callable
        (ops, z, v, constants) -> what the mechanism follows.
    along : callable
        (v (n,), way (n,), t (n,), constants) -> that value (n,) at samples.
    constant : str
        Its first constant.
    unit : callable
        Of an axis, the constant's.
    grid : callable
        (way (n,), t (n,)) -> values of the constant that a search tries.
    held : bool
        Of an input that is held between samples: its value at a sample is its mean until the next one.
    text, words : str
        As a formula and a sentence say it.
    states : int
        How many states it has.
    second : str
        Its other constant, where it has one.
    seconds : callable
        Of the usual sample time, values of it that a search tries, each with how far on the next of the first
        constant's values is that it tries beside it.
    is_body : bool
        Its states are the angle of a body against what it goes with, and its rate: it begins to move along.
    is_led : bool
        An estimator leads its states along the others and does not correct them; its constants are chosen, not fitted.
    dissipates : bool
        As a force on what moves, it takes energy away: its amplitude has a sign.
    """

    name: str
    kinds: tuple[str, ...]
    rates: Callable[[Any, Sequence[Any], Any, Any, Constants, float], Sequence[Any]]
    value: Callable[[Any, Sequence[Any], Any, Constants], Any]
    along: Callable[[Array, Array, Array, Constants], Array]
    constant: str
    unit: Callable[[Axis], str]
    grid: Callable[[Array, Array], Sequence[float]]
    text: str
    words: str
    states: int = 1
    is_body: bool = False
    is_led: bool = False
    dissipates: bool = False
    scaled: bool = False  # its value has the unit of the variable; else it is a number
    held: bool = False
    second: str = ""
    seconds: Callable[[float], Sequence[tuple[float, int]]] = lambda h: ((DAMPING, 1),)


def _steps(x: Array) -> Array:
    return np.diff(x, prepend=x[:1])


def _carried(left: Array, added: Array) -> Array:
    """z_k = left_k z_k-1 + added_k from z_0 = 0: a triangular matrix of two bands."""
    from scipy.linalg.lapack import dtbtrs  # the daemon, which never asks for it, starts without scipy

    bands, right = np.ones((2, len(left))), added.copy()
    bands[1, :-1], right[0] = -left[1:], 0.0
    found, _ = dtbtrs(bands, right, uplo="L", diag="U")
    return np.asarray(found)


def _turned(left: complex, added: NDArray[np.complex128], begin: complex) -> NDArray[np.complex128]:
    """z_k = left z_k-1 + added_k-1 from z_0 = begin, the beginning with it."""
    from scipy.linalg.lapack import ztbtrs  # the daemon, which never asks for it, starts without scipy

    bands, right = np.ones((2, len(added) + 1), dtype=complex), np.append(begin, added)
    bands[1, :-1] = -left
    found, _ = ztbtrs(bands, right, uplo="L", diag="U")
    return np.asarray(found)


# ---------------------------------------------------------------------------------------------- dahl


def _dahl_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    # no faster than a step of integration can follow
    return [(dv - ops.fabs(dv) * z[0]) / ops.fmax(c["xs"], ops.fabs(dv) * shortest_s)]


def _dahl_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    d = _steps(v)
    way, left = np.sign(d), np.exp(-np.abs(d) / c["xs"])
    return _carried(left, way * (1.0 - left))


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
    for d in (_steps(v) / c["b"]).tolist():
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
    left = np.exp(-_steps(t) / c["T"])
    middle = (v + np.concatenate([v[:1], v[:-1]])) / 2.0
    return _carried(left, middle * (1.0 - left))


def _twist_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    # what was held until a sample has acted by then
    left = np.exp(-_steps(t) / c["T"])
    return _carried(left, np.concatenate([v[:1], v[:-1]]) * (1.0 - left))


def _lags(samples: Sequence[float]) -> Callable[[Array, Array], list[float]]:
    def grid(v: Array, t: Array) -> list[float]:
        h, length = float(np.median(np.diff(t))), float(t[-1] - t[0])
        return [h * one for one in samples if h * one < length]

    return grid


# ---------------------------------------------------------------------------------------------- wear, reversal


def _wear_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    return [(1.0 - z[0]) * ops.fabs(dv) / c["W"]]


def _wear_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    return np.asarray(1.0 - np.exp(-np.cumsum(np.abs(_steps(v))) / c["W"]))


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
        d = _steps(way)
        sign, left = side(np, v, d), np.exp(-np.abs(d) / c["W"])
        moving = sign != 0.0
        # the sign before: of the last sample that had one
        last = np.maximum.accumulate(np.where(moving, np.arange(len(v)), 0))
        before = sign[np.concatenate([[0], last[:-1]])]
        # where it turns all is forgotten, where it rests nothing changes
        kept = np.where(moving, np.where(sign * before >= 0.0, left, 0.0), 1.0)
        return np.asarray(1.0 - np.abs(_carried(kept, sign * (1.0 - left))))

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
    renewed, onward = np.abs(_steps(v)) / c["L"], np.ones(len(v))
    # exact while the speed is constant, T a sample: z -> z e^-r + (1 - e^-r)/r
    np.divide(-np.expm1(-renewed), renewed, out=onward, where=renewed > LEAST)
    return np.asarray(np.log1p(np.maximum(_carried(np.exp(-renewed), onward), 0.0)))


def _hesitation(ops: Any, z: Sequence[Any], v: Any, c: Constants) -> Any:
    return (z[0] - v) * ops.exp(-ops.fabs(v) / c["v0"])


def _hesitation_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    return [(v - z[0]) / shortest_s]


def _hesitation_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    # of what was held until a sample, the mean of (z - v) until the next one, with z' = (v - z)/(h/PARTS)
    return np.asarray(-_steps(v) / PARTS * np.exp(-np.abs(v) / c["v0"]))


def _sizes(v: Array, t: Array) -> list[float]:
    size = float(np.sqrt(np.mean(v**2)))
    return [share * size for share in SIZES] if size > 0.0 else []


# ---------------------------------------------------------------------------------------------- resonance


def _resonance_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    return [z[1], c["w"] ** 2 * (v - z[0]) - 2.0 * c["zeta"] * c["w"] * z[1]]


def _resonance_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    # the impulse response is w^2/wd Im(e^(p t)),  p = w (-zeta + i sqrt(1 - zeta^2)),  wd = Im p
    zeta, h = min(c.get("zeta", DAMPING), LARGEST_DAMPING), float(np.median(np.diff(t)))
    p = c["w"] * complex(-zeta, np.sqrt(1.0 - zeta**2))
    left = np.exp(p * h)
    middle = (v[1:] + v[:-1]) / 2.0
    after = _turned(left, middle * (left - 1.0) / p, -v[0] / p)[1:]
    return np.asarray(np.append(v[:1], c["w"] ** 2 / p.imag * after.imag) - v)


def _frequencies(count: int) -> Callable[[Array, Array], list[float]]:
    def grid(v: Array, t: Array) -> list[float]:
        h = float(np.median(np.diff(t)))
        return [float(one) for one in np.geomspace(2 * np.pi / (SLOWEST_SAMPLES * h), np.pi / (2 * h), count)]

    return grid


# ---------------------------------------------------------------------------------------------- swing


def _swing(ops: Any, z: Sequence[Any], v: Any, c: Constants) -> Any:
    return -(c["w"] * z[0] + 2.0 * c["zeta"] * (z[1] - v))


def _swing_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    return [z[1] - v, c["w"] * _swing(ops, z, v, c)]


def _swing_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    # r'' + 2 zeta w r' + w^2 r = -v';  y = r' - conj(p) r follows y' = p y - v', p as of a resonance
    zeta, h = min(c.get("zeta", DAMPING), LARGEST_DAMPING), float(np.median(np.diff(t)))
    p = c["w"] * complex(-zeta, np.sqrt(1.0 - zeta**2))
    left = np.exp(p * h)
    # the body moves along at first
    y = _turned(left, -np.diff(v) / h * (left - 1.0) / p, 0j)
    r = y.imag / p.imag
    return np.asarray(-(c["w"] * r + 2.0 * zeta * (y.real + p.real * r)))


# ---------------------------------------------------------------------------------------------- loose


def _pushed(ops: Any, r: Any, slip: Any, b: Any, w: Any) -> Any:
    """Acceleration of a loose body over the stop's rate: it is pushed out of a stop, never pulled into it."""
    into = ops.fmax(r - b, 0.0) - ops.fmax(-r - b, 0.0)
    push = ops.fmax(ops.fabs(into) * w + 2.0 * STOP_DAMPING * slip * ops.sign(into), 0.0)
    return -ops.sign(into) * push


def _loose(ops: Any, z: Sequence[Any], v: Any, c: Constants) -> Any:
    return _pushed(ops, z[0], z[1] - v, c["b"], c["w"])


def _loose_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    # no faster than a step of integration can follow
    w = ops.fmin(c["w"], 1.0 / shortest_s)
    return [z[1] - v, w * _pushed(ops, z[0], z[1] - v, c["b"], w)]


def _loose_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    b, w, step = float(c["b"]), float(c["w"]), float(np.median(np.diff(t))) / PARTS
    rates = np.interp(np.arange((len(v) - 1) * PARTS) / PARTS, np.arange(len(v)), v).tolist()
    r, z = 0.0, float(v[0])
    felt = []
    for rate in rates:
        r += step * (z - rate)
        into = r - b if r > b else r + b if r < -b else 0.0
        f = 0.0
        if into > 0.0:
            f = -max(into * w + 2.0 * STOP_DAMPING * (z - rate), 0.0)
        elif into < 0.0:
            f = max(-into * w - 2.0 * STOP_DAMPING * (z - rate), 0.0)
        z += step * w * f
        felt.append(f)
    # of a blow, which is over within a sample, the mean until the next one
    return np.append(np.reshape(felt, (-1, PARTS)).mean(axis=1), 0.0)


def _gaps(v: Array, t: Array) -> list[float]:
    rate = float(np.mean(np.abs(v)))
    return [share * rate for share in GAPS_S] if rate > 0.0 else []


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
    _reversal(POSITION),
    _reversal(INPUT),
    MemoryLaw(
        "resonance", (RATE, INPUT, POSITION, STATE), _resonance_rates, lambda ops, z, v, c: z[0] - v, _resonance_along,
        "w", lambda axis: "rad/s", _frequencies(RESONANCES),
        "(z - {v}), z'' = w^2 ({v} - z) - 2 zeta w z'",
        "swings, elastically driven by,", states=2, scaled=True, second="zeta",
    ),
    MemoryLaw(
        "swing", (RATE,), _swing_rates, _swing, _swing_along, "w", lambda axis: "rad/s", _frequencies(SWINGS),
        "z'/w, z' = -w (w r + 2 zeta r'), r' = z - {v}", "comes from a part that hangs elastically and swings with",
        states=2, is_body=True, dissipates=True, scaled=True, second="zeta", seconds=lambda h: DAMPINGS,
    ),
    MemoryLaw(
        "loose", (RATE,), _loose_rates, _loose, _loose_along, "b", lambda axis: product_text((axis.unit, 1), ("s", 1)),
        _gaps, "z'/w, z' = -w (w o + r') at the stops, o = r beyond +-b, r' = z - {v}",
        "comes from a part that is loose and is taken along at the ends of its play, by", states=2, is_body=True,
        is_led=True, dissipates=True, scaled=True, held=True, second="w",
        seconds=lambda h: [(one * PARTS / h, 1) for one in STOPS],
    ),
)  # fmt: skip
