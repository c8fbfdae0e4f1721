"""Coloured torques that nobody commanded, on hoop and ball: residuals as real devices have them.

Rules of this file: every 2.5 ms a value; exact sampling of the Ornstein-Uhlenbeck process; rms in N m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from concealed.plant import Array
from concealed.sensors import PIECE_S

KINDS = ("ou", "two_ou", "smooth")  # the last two are not what a filter with an Ornstein-Uhlenbeck state assumes
# rms in N m, log-uniform: about 2 mN m on the hoop give residuals like the real recordings'; the ball's force moves psi
# as much. No device is without any: a calm one has a twentieth of it, which a filter takes for noise of its own.
HOOP_NM, BALL_NM = (1e-3, 4e-3), (2e-4, 1e-3)
CALM = 0.05
TIME_S = (0.05, 0.3)


@dataclass(frozen=True)
class Colour:
    """What disturbs a case: one process on theta, one on psi."""

    kind: str
    rms_nm: tuple[float, float]
    time_s: tuple[float, float]


def draw(rng: np.random.Generator, share: float = 0.8) -> Colour:
    """A case's disturbance; one case in `1 - share` is calm."""
    first, second, hoop, ball = (_log(rng, *between) for between in (TIME_S, TIME_S, HOOP_NM, BALL_NM))
    kind = str(rng.choice(KINDS, p=(0.6, 0.2, 0.2)))
    there = 1.0 if rng.uniform() < share else CALM
    return Colour(kind, (there * hoop, there * ball), (first, second))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def path(colour: Colour, rng: np.random.Generator, pieces: int) -> Array:
    """Torques on theta and psi, (pieces, 2)."""
    out = np.empty((pieces, 2))
    for axis, (rms, time_s) in enumerate(zip(colour.rms_nm, colour.time_s, strict=True)):
        out[:, axis] = rms * _unit(colour.kind, time_s, rng, pieces)
    return out


def _unit(kind: str, time_s: float, rng: np.random.Generator, pieces: int) -> Array:
    if kind == "two_ou":
        return np.sqrt(0.5) * (_ou(time_s * 0.4, rng, pieces) + _ou(time_s * 2.5, rng, pieces))
    if kind == "smooth":
        twice = _low_pass(_ou(time_s / 2, rng, pieces), time_s / 2)
        # an OU process behind a low-pass with the same time constant keeps half of its variance
        return np.sqrt(2.0) * twice
    return _ou(time_s, rng, pieces)


def _ou(time_s: float, rng: np.random.Generator, pieces: int) -> Array:
    """x' = -x/T + w with unit variance."""
    decay = np.exp(-PIECE_S / time_s)
    steps = rng.standard_normal(pieces) * np.sqrt(1 - decay**2)
    steps[0] = rng.standard_normal()
    return lfilter([1.0], [1.0, -decay], steps)


def _low_pass(x: Array, time_s: float) -> Array:
    decay = np.exp(-PIECE_S / time_s)
    return lfilter([1 - decay], [1.0, -decay], x)
