"""A wide family of made-up systems for whatever chooses a structure by itself, each with data to fit and data to judge.

Stiff, slow, late, with a direct term, with an integrator, with flexible modes; noise that is white, coloured or drifts;
short records, poor inputs, several inputs and outputs, a loop around it, a bent actuator. Parameters are drawn, so a
seed is a new family of the same kind.

Rules of this file: a seed gives the same data; the means of what is fitted are taken out of everything, as a user does;
a process knows the order that a textbook would say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.statespace.linear import states

from .statespacesets import pair

Array = NDArray[np.float64]
Drawn = np.random.Generator


class MadeUp(NamedTuple):
    """A process: data to fit, data to judge, the order of a textbook."""

    name: str
    own: Data
    held: Data
    order: int


class Process(NamedTuple):
    """x+ = A x + B u, y = C x + D u + noise, the noise's filter and its size beside the clean output's deviation."""

    a: Array
    b: Array
    c: Array
    d: Array
    noise: Callable[[Array, Drawn], Array]
    share: float


def family(seed: int, samples: int = 1000) -> Iterator[MadeUp]:
    """All kinds once; as many samples to judge as to fit."""
    for i, (name, (make, length)) in enumerate(KINDS.items()):
        rng = np.random.default_rng([seed, i])
        yield make(name, rng, max(round(samples * length), 60))


# ------------------------------------------------------------------------------------------------- parts


def white(e: Array, rng: Drawn) -> Array:
    """As it is."""
    return e


def coloured(e: Array, rng: Drawn) -> Array:
    """Through a pole and a zero."""
    pole, zero = rng.uniform(0.7, 0.95), rng.uniform(-0.6, 0.3)
    return np.asarray(lfilter([1.0, zero], [1.0, -pole], e, axis=0))


def drifting(e: Array, rng: Drawn) -> Array:
    """White, on a walk that never comes back."""
    return np.asarray(e + rng.uniform(0.05, 0.2) * np.cumsum(rng.standard_normal(e.shape), axis=0))


def switched(n: int, nu: int, rng: Drawn, hold: tuple[int, int] = (1, 8)) -> Array:
    """Levels +-1 that are held for a while."""
    out = np.empty((n, nu))
    for i in range(nu):
        lengths = rng.integers(*hold, size=n)
        out[:, i] = np.repeat(rng.choice([-1.0, 1.0], size=n), lengths)[:n]
    return out


def modes(poles: Array, rng: Drawn, nu: int, ny: int, *, direct: bool = False) -> tuple[Array, Array, Array, Array]:
    """Real poles, and pairs (radius, angle), each reached from every input and seen in every output."""
    blocks = [np.array([[one]]) if np.ndim(one) == 0 else pair(*one) for one in poles]
    a = block_diag(*blocks)
    # each mode contributes about alike at rest
    b = np.vstack([rng.choice([-1.0, 1.0], (len(one), nu)) * rng.uniform(0.4, 1.0, (len(one), nu)) for one in blocks])
    weight = np.concatenate([np.full(len(one), np.sqrt(1.0 - np.abs(np.linalg.eigvals(one)).max())) for one in blocks])
    c = rng.choice([-1.0, 1.0], (ny, len(a))) * rng.uniform(0.4, 1.0, (ny, len(a)))
    return a, weight[:, None] * b, c * weight, rng.uniform(0.3, 1.0, (ny, nu)) * direct


def driven(name: str, process: Process, u: Array, rng: Drawn, order: int | None = None) -> MadeUp:
    """The process after it has settled, cut in halves."""
    clean = (process.c @ states(process.a, process.b @ u.T, None)).T + u @ process.d.T
    e = process.noise(rng.standard_normal(clean.shape), rng)
    y = clean + process.share * clean.std(axis=0) * e / e.std(axis=0)
    return halves(name, y, u, len(process.a) if order is None else order)


def halves(name: str, y: Array, u: Array, order: int) -> MadeUp:
    """Fitted and judged halves, the means of the first out of both."""
    n = len(y) // 2
    y, u = y - y[:n].mean(axis=0), u - u[:n].mean(axis=0)
    return MadeUp(name, iddata(y[:n], u[:n]), iddata(y[n:], u[n:]), order)


# ------------------------------------------------------------------------------------------------- kinds


def linear(
    poles: Callable[[Drawn], list[float | tuple[float, float]]], noise: Callable[[Array, Drawn], Array],
    share: tuple[float, float], *, nu: int = 1, ny: int = 1, direct: bool = False, hold: tuple[int, int] = (1, 8),
) -> Callable[[str, Drawn, int], MadeUp]:  # fmt: skip
    """A kind of linear processes."""

    def make(name: str, rng: Drawn, n: int) -> MadeUp:
        process = Process(*modes(poles(rng), rng, nu, ny, direct=direct), noise, rng.uniform(*share))
        return driven(name, process, switched(2 * n, nu, rng, hold), rng)

    return make


def late(name: str, rng: Drawn, n: int) -> MadeUp:
    """A dead time of some samples."""
    process = Process(*modes([0.9, 0.6], rng, 1, 1), coloured, 0.15)
    u, delay = switched(2 * n, 1, rng), int(rng.integers(3, 7))
    found = driven(name, process, np.vstack([np.zeros((delay, 1)), u[:-delay]]), rng)
    return halves(name, np.vstack([found.own.y, found.held.y]), u, 2 + delay)


def closed(name: str, rng: Drawn, n: int) -> MadeUp:
    """A law that answers the output, noise through the process's own poles."""
    a, b, c, _ = modes([(0.9, 0.3), 0.7], rng, 1, 1)
    k = 0.3 * rng.standard_normal((3, 1))
    gain = 0.3 / max(float(np.abs(c @ np.linalg.solve(np.eye(3) - a, b)).max()), 0.3)
    r, e = switched(2 * n, 1, rng), 0.3 * rng.standard_normal((2 * n, 1))
    x, y, u = np.zeros(3), np.empty((2 * n, 1)), np.empty((2 * n, 1))
    for t in range(2 * n):
        y[t] = c @ x + e[t]
        u[t] = r[t] - gain * (y[t - 1] if t else 0.0)
        x = a @ x + b @ u[t] + k @ e[t]
    return halves(name, y, u, 3)


def bent(name: str, rng: Drawn, n: int) -> MadeUp:
    """An actuator that saturates softly, inputs of any level."""
    u = np.repeat(rng.uniform(-1.0, 1.0, (2 * n, 1)), 6, axis=0)[: 2 * n]
    process = Process(*modes([0.92, (0.8, 0.5)], rng, 1, 1), coloured, 0.1)
    found = driven(name, process, np.tanh(1.5 * u), rng)
    return halves(name, np.vstack([found.own.y, found.held.y]), u, 3)


def slowly_driven(name: str, rng: Drawn, n: int) -> MadeUp:
    """Inputs that wander smoothly: little to tell fast poles by."""
    u = lfilter([1.0], [1.0, -0.95], rng.standard_normal((2 * n, 2)), axis=0)
    process = Process(*modes([0.95, 0.8, 0.5], rng, 2, 1), coloured, 0.1)
    return driven(name, process, np.asarray(u), rng)


def mixing(name: str, rng: Drawn, n: int) -> MadeUp:
    """A tank that integrates, with an outlet's own pole."""
    a, b, c, _ = modes([1.0, 0.7], rng, 1, 1)
    b, c = np.array([[0.05], [0.3]]), np.array([[1.0, 0.5]])
    u = switched(2 * n, 1, rng, (2, 12))
    return driven(name, Process(a, b, c, np.zeros((1, 1)), white, 0.03), u, rng)


def _flexible(rng: Drawn) -> list[float | tuple[float, float]]:
    return [(rng.uniform(0.95, 0.99), angle) for angle in (0.15, 0.5, 1.1, 2.0)]


def _two_poles(rng: Drawn) -> list[float | tuple[float, float]]:
    return [rng.uniform(0.98, 0.99), rng.uniform(0.2, 0.5)]


def _pairs(rng: Drawn) -> list[float | tuple[float, float]]:
    return [rng.uniform(0.8, 0.95), (rng.uniform(0.7, 0.9), rng.uniform(0.3, 1.5)), rng.uniform(0.3, 0.6)]


KINDS: dict[str, tuple[Callable[[str, Drawn, int], MadeUp], float]] = {
    "resonant": (linear(lambda rng: [(0.9, rng.uniform(0.2, 0.9))], white, (0.05, 0.2)), 1.0),
    "stiff": (linear(_two_poles, white, (0.02, 0.1), hold=(1, 20)), 1.0),
    "slow": (linear(lambda rng: [0.97, 0.985], coloured, (0.05, 0.1), hold=(5, 40)), 2.0),
    "direct": (linear(lambda rng: [0.8, (0.85, 0.6)], white, (0.05, 0.1), direct=True), 1.0),
    "late": (late, 1.0),
    "coloured": (linear(_pairs, coloured, (0.2, 0.5)), 1.0),
    "drifting": (linear(lambda rng: [0.9, 0.7], drifting, (0.1, 0.3)), 1.0),
    "drifting, two outputs": (linear(_pairs, drifting, (0.1, 0.3), nu=2, ny=2), 1.0),
    "integrating": (mixing, 1.0),
    "short": (linear(lambda rng: [0.85, 0.5], white, (0.05, 0.1)), 0.15),
    "short, coloured": (linear(_pairs, coloured, (0.1, 0.3)), 0.25),
    "noisy": (linear(lambda rng: [(0.85, 0.4)], white, (0.8, 1.2)), 1.0),
    "flexible": (linear(_flexible, white, (0.02, 0.1)), 1.5),
    "two by two": (linear(_pairs, coloured, (0.05, 0.2), nu=2, ny=2), 1.0),
    "three inputs": (linear(_pairs, white, (0.05, 0.2), nu=3), 1.0),
    "three outputs": (linear(_pairs, white, (0.05, 0.2), ny=3), 1.0),
    "closed": (closed, 1.0),
    "bent": (bent, 1.0),
    "slowly driven": (slowly_driven, 1.0),
}  # fmt: skip
