"""How fast a system is: both bandwidths, the sampling that fits them, the figures of its step response.

Rules of this file: one input to one output, without the states that the output does not see.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.design.analysis import minimal
from hoopd.design.margins import is_stable
from hoopd.design.response import (
    frequency_grid,
    is_finite_at_dc,
    log_size,
    prepared,
    response,
    roots_of,
    with_turning_points,
)

Array = NDArray[Any]

# A sampled step response is followed this far: an hour at 50 Hz.
MOST_SAMPLES = 180_000
# Beside its largest value a response that ends this near to 0 ends there, but for rounding.
ENDS_AT_ZERO = 1e-9


class Bandwidth(NamedTuple):
    """Both definitions in use; inf: never falls below, nan: there is no such level."""

    absolute_rad_s: float  # above it |P| stays below 1/sqrt 2
    below_dc_rad_s: float  # |P| first falls below |P(0)|/sqrt 2 (3.01 dB)
    dc_gain: float


def bandwidth(system: control.StateSpace) -> Bandwidth:
    """Both bandwidths of one input to one output (python-control has the second, at 3.000 dB instead of 1/sqrt 2)."""
    less = prepared(system)
    grid = with_turning_points(less, frequency_grid(less))
    size = np.log(np.abs(response(less, grid)))
    falls = _falls(less, grid, size, -math.log(2.0) / 2)
    absolute = falls[-1] if falls else (0.0 if size[-1] < -math.log(2.0) / 2 else math.inf)
    if not is_finite_at_dc(less):
        return Bandwidth(absolute, math.nan, math.inf)
    dc = float(less.dcgain())
    first = _falls(less, grid, size, math.log(abs(dc)) - math.log(2.0) / 2) if dc else []
    return Bandwidth(absolute, (first[0] if first else math.inf) if dc else math.nan, dc)


def _falls(system: control.StateSpace, grid: Array, size: Array, level: float) -> list[float]:
    """Frequencies where log|P| falls through a level."""
    found = roots_of(lambda w: log_size(system, w) - level, grid, size - level)
    return [
        w for w in found if log_size(system, w * (1 - 1e-6)) > level > log_size(system, min(w * (1 + 1e-6), grid[-1]))
    ]


class SamplingAdvice(NamedTuple):
    """Sampling frequencies that fit a bandwidth, in Hz."""

    slowest_hz: float
    fastest_hz: float


def sampling_advice(bandwidth_rad_s: float) -> SamplingAdvice:
    """Sample at 10 to 30 times the bandwidth in Hz (Franklin, Powell, Workman: 20 to 40 for smooth control; the thesis
    prints it the other way round, a bandwidth of 10 to 30 times the sampling frequency, which no loop can have)."""
    return SamplingAdvice(10 * bandwidth_rad_s / (2 * math.pi), 30 * bandwidth_rad_s / (2 * math.pi))


def step_info(system: control.StateSpace, points: int = 20_000) -> dict[str, float] | None:
    """Rise (10-90 %), settling (2 %) time in s, overshoot %, peak, final value; None when it does not settle
    (of a sampled system: not within `MOST_SAMPLES`). What is relative to a final value is nan where that is 0 (speeds).

    python-control reads these from points of the time axis, which it guesses too short and coarse for a slow mode
    beside a resonance; here it reaches 10 times the slowest mode in `points` steps, which is the resolution.
    """
    less = minimal(system).system
    poles = less.poles()
    discrete = less.isdtime(strict=True)
    if not poles.size or not is_stable(poles, sampled=discrete):
        return None
    rate = -np.log(np.maximum(np.abs(poles), 1e-9)) / less.dt if discrete else -poles.real
    end = 10.0 / float(rate.min())
    if discrete and end > MOST_SAMPLES * less.dt:
        return None
    time = np.arange(0.0, end, less.dt) if discrete else np.linspace(0.0, end, points)
    _, y = control.step_response(less, time)
    y, final = np.asarray(y), float(less.dcgain())
    if abs(final) <= ENDS_AT_ZERO * np.abs(y).max(initial=0.0):
        final = 0.0
    found = control.step_info(y, T=time, yfinal=final)
    relative = ("RiseTime", "SettlingTime", "Overshoot", "Undershoot") if final == 0.0 else ()
    figures = {str(name): math.nan if name in relative else float(value) for name, value in found.items()}
    return {**figures, "SteadyStateValue": final}  # python-control takes a yfinal of 0 for none
