"""Memories that are bodies: what swings on a variable, hangs on what moves, or is loose on it.

    resonance  z'' = w^2 (v - z) - 2 zeta w z'             something that swings on it; z - v is what it adds
    swing      z' = -w (w r + 2 zeta r'), r' = z - v: a body that hangs on what moves at the rate v, and feels z'/w
    loose      z' = -w (w o + r') where it is pushed, r' = z - v, o what r exceeds +-b: a body that coasts in a gap
               on what moves at the rate v, and feels z'/w at its stops (Nordin, Gutman 2002)

Rules of this file: no plant; laws only, each as rates and as a recursion over samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hoopd.files.dimensions import product_text
from hoopd.plants.effects.grammar.axes import INPUT, POSITION, RATE, STATE
from hoopd.plants.effects.grammar.memory_law import DAMPING, PARTS, Array, Constants, MemoryLaw, turned

# Frequencies that a search tries below half of Nyquist's.
RESONANCES, SWINGS = 12, 96
# Gaps, in ways at the mean rate; a stop's radians in a memory's substep; its damping: hardly anything bounces.
GAPS_S = tuple(0.005 * 1.3**k for k in range(12))
STOPS, STOP_DAMPING = (0.25, 0.5), 0.5
SLOWEST_SAMPLES = 100.0  # of a period
LARGEST_DAMPING = 0.99
# Of a part that hangs, each beside every so many of its frequencies: these lie a little farther apart than the part's
# response is half as wide.
DAMPINGS = ((0.03, 1), (0.1, 3), (0.3, 9))


# ---------------------------------------------------------------------------------------------- resonance


def _resonance_rates(ops: Any, z: Sequence[Any], v: Any, dv: Any, c: Constants, shortest_s: float) -> Sequence[Any]:
    return [z[1], c["w"] ** 2 * (v - z[0]) - 2.0 * c["zeta"] * c["w"] * z[1]]


def _resonance_along(v: Array, way: Array, t: Array, c: Constants) -> Array:
    # the impulse response is w^2/wd Im(e^(p t)),  p = w (-zeta + i sqrt(1 - zeta^2)),  wd = Im p
    zeta, h = min(c.get("zeta", DAMPING), LARGEST_DAMPING), float(np.median(np.diff(t)))
    p = c["w"] * complex(-zeta, np.sqrt(1.0 - zeta**2))
    left = np.exp(p * h)
    middle = (v[1:] + v[:-1]) / 2.0
    after = turned(left, middle * (left - 1.0) / p, -v[0] / p)[1:]
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
    y = turned(left, -np.diff(v) / h * (left - 1.0) / p, 0j)
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


BODIES: tuple[MemoryLaw, ...] = (
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
