"""Torques that a person would try: two-level, multi-level, PRBS, multisine, chirp and mixtures of them.

Rules of this file: shapes of about unit peak, (samples,); how strong they are is decided where the device is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.signal import lfilter

from concealed.plant import SAMPLE_S, Array

Rng = np.random.Generator
RESONANCE_HZ = 1.4  # of the ball at the bottom


def _held(rng: Rng, samples: int, levels: Array, shortest: int, longest: int) -> Array:
    out, at = np.empty(samples), 0
    while at < samples:
        hold = int(rng.integers(shortest, longest + 1))
        out[at : at + hold] = rng.choice(levels)
        at += hold
    return out


def two_level(rng: Rng, samples: int) -> Array:
    """+-1, held for random times."""
    return _held(rng, samples, np.array([-1.0, 1.0]), int(rng.integers(1, 4)), int(rng.integers(8, 20)))


def multi_level(rng: Rng, samples: int) -> Array:
    """Levels anywhere between -1 and 1, held for random times."""
    return _held(rng, samples, rng.uniform(-1, 1, size=64), int(rng.integers(1, 4)), int(rng.integers(8, 20)))


def prbs(rng: Rng, samples: int) -> Array:
    """A random binary sequence with one clock."""
    clock = int(rng.integers(3, 9))
    return np.repeat(rng.choice((-1.0, 1.0), size=samples // clock + 1), clock)[:samples]


def multisine(rng: Rng, samples: int) -> Array:
    """Six to fourteen sines between 0.15 and 6 Hz."""
    t, out = np.arange(samples) * SAMPLE_S, np.zeros(samples)
    for frequency in np.exp(rng.uniform(np.log(0.15), np.log(6.0), size=int(rng.integers(6, 15)))):
        strength = rng.uniform(0.4, 1.0) * _gentle(frequency)
        out += strength * np.sin(2 * np.pi * frequency * t + rng.uniform(0, 2 * np.pi))
    return out / np.abs(out).max()


def chirp(rng: Rng, samples: int) -> Array:
    """A sine whose frequency grows from 0.1-0.4 to 3-7 Hz."""
    t, first, last = np.arange(samples) / samples, rng.uniform(0.1, 0.4), rng.uniform(3.0, 7.0)
    phase = 2 * np.pi * first * samples * SAMPLE_S * ((last / first) ** t - 1) / np.log(last / first)
    return np.sin(phase + rng.uniform(0, 2 * np.pi)) * _gentle(first * (last / first) ** t)


def _gentle(frequency: Array | float) -> Array | float:
    """Strength of a sine, 0.1 to 1: little where the ball resonates, or the ball would limit all the rest."""
    return np.minimum(1.0, 0.1 + np.abs((frequency / RESONANCE_HZ) ** 2 - 1.0))


def mixture(rng: Rng, samples: int) -> Array:
    """Two of the others added."""
    first, second = rng.choice(np.array(PURE), size=2, replace=False)
    out = DRIVES[first](rng, samples) + rng.uniform(0.4, 1.0) * DRIVES[second](rng, samples)
    return out / np.abs(out).max()


def reach(unit: Array, device: tuple[float, float, float, float]) -> Array:
    """Largest |theta'|, |psi| of a linear device per N m of the shape (samples,); device: J11, L1, K2, L2."""
    j11, l1, k2, l2 = device
    spin = lfilter([l1 * SAMPLE_S], [1.0, -1.0 - j11 * SAMPLE_S], unit)
    # psi'' = K2 psi - 0.4 psi' + L2 tau, symplectic Euler at the sample time
    damp, spring = 0.4 * SAMPLE_S, -k2 * SAMPLE_S**2
    ball = lfilter([0.0, l2 * SAMPLE_S**2], [1.0, damp + spring - 2.0, 1.0 - damp], unit)
    return np.array((np.abs(spin).max(), np.abs(ball).max()))


PURE = ("two_level", "multi_level", "prbs", "multisine", "chirp")
DRIVES: Mapping[str, Callable[[Rng, int], Array]] = {
    "two_level": two_level,
    "multi_level": multi_level,
    "prbs": prbs,
    "multisine": multisine,
    "chirp": chirp,
    "mixture": mixture,
}
# Kinds in which abs(u) takes many values: two-level ones cannot tell a dead zone from a gain.
GRADED = ("multi_level", "multisine", "chirp", "mixture")
