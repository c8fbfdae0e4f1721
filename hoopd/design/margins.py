"""How far a loop is from instability: gain, phase and delay margin, peaks of sensitivity, stability.

Rules of this file: a loop L is one input to one output under negative feedback, 1 + L; no result is a point of a
grid. Before anything else the states that do not count are dropped by name (`analysis.minimal`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import control
import numpy as np
from numpy.typing import NDArray

from hoopd.design.response import (
    frequency_grid,
    is_finite_at_dc,
    log_size,
    peak_of,
    prepared,
    response,
    roots_of,
    with_turning_points,
)

Array = NDArray[Any]

# Of a purely real response the imaginary part is rounding: below this part of |L| its sign means nothing.
REAL = 1e-11


class Crossing(NamedTuple):
    """A frequency where |L| = 1 or where L is real and negative."""

    w_rad_s: float
    value: complex


class Margins(NamedTuple):
    """Distances from instability; inf (gain_down: 0) where nothing is crossed, nan where there is no margin."""

    phase_rad: float  # nearest gain crossover to -180 degrees; below 0 only of an unstable loop
    delay_s: float  # more delay that the loop bears
    gain_up: float  # factor on the gain
    gain_down: float
    peak_sensitivity: float  # Ms = max |1/(1 + L)|; 1/Ms is the distance of the Nyquist curve from -1
    phase_rad_s: float  # where each of them is
    delay_rad_s: float
    gain_up_rad_s: float
    gain_down_rad_s: float
    peak_sensitivity_rad_s: float
    peak_complementary: float  # Mt = max |L/(1 + L)|
    peak_complementary_rad_s: float
    stable: bool  # the closed loop; without it the distances are only distances
    gain_crossovers: tuple[Crossing, ...]
    phase_crossovers: tuple[Crossing, ...]


def margins(loop: control.StateSpace, delay_s: float = 0.0) -> Margins:
    """Margins of 1 + L, `delay_s` being a pure delay in the loop that L does not hold (its phase is exact).

    In python-control's `margin` an unseen integrator (the hoop angle) is 0/0 at w = 0: nan with warnings, or, where
    rounding leaves anything of it, a gain margin that is not there (0.126 was seen); it knows neither delay margins
    nor delays. Here the integrator is dropped first.
    """
    system = prepared(loop)
    grid = with_turning_points(system, frequency_grid(system, delay_s))
    values = response(system, grid, delay_s)
    if not np.isfinite(values).all():
        raise ValueError("the loop's response cannot be computed: its state space is too badly scaled")
    gains = [
        _crossing(system, w, delay_s) for w in roots_of(lambda w: log_size(system, w), grid, np.log(np.abs(values)))
    ]
    real = _real_crossings(system, delay_s, grid, values)
    stable = _stays_stable(system, gains, delay_s)
    away = [(_wrapped(float(np.angle(c.value)) + math.pi), c.w_rad_s) for c in gains]
    phase, phase_at = min(away, key=lambda one: abs(one[0]), default=(math.inf, math.nan))
    phase = abs(phase) if stable else phase  # lost or gained, either would end a stable loop
    delay, delay_at = _delay_margin(gains) if stable else (math.nan, math.nan)
    factors = [(1.0 / abs(c.value), c.w_rad_s) for c in real if c.value != 0]
    up, up_at = min((f for f in factors if f[0] > 1.0), default=(math.inf, math.nan))
    down, down_at = max((f for f in factors if f[0] < 1.0), default=(0.0, math.nan))
    whole = np.concatenate([[0.0], grid]) if is_finite_at_dc(system) else grid
    ms, ms_at = peak_of(whole, lambda w: 1.0 / abs(1.0 + response(system, w, delay_s)))
    if not system.isdtime(strict=True) and delay_s == 0.0:  # S(inf) = 1/(1 + D) may be the largest
        ms, ms_at = max((ms, ms_at), (1.0 / max(abs(1.0 + float(system.D[0, 0])), 1e-300), math.inf))
    mt, mt_at = peak_of(whole, lambda w: abs(1.0 - 1.0 / (1.0 + response(system, w, delay_s))))
    at = (phase_at, delay_at, up_at, down_at, ms_at)
    return Margins(phase, delay, up, down, ms, *at, mt, mt_at, stable, tuple(gains), tuple(real))


def closed_loop_poles(loop: control.StateSpace) -> Array:
    """Poles of 1 + L = 0, the dropped states' own left out: the hoop angle's at 0 (z = 1) says nothing about a loop
    that does not see it. ValueError when L(inf) = -1."""
    system = prepared(loop)
    through = 1.0 + float(system.D[0, 0])
    if through == 0.0:
        raise ValueError("the loop is not well-posed: L is -1 at once")
    # x' = A x + B u, u = -(C x + D u)
    return np.linalg.eigvals(system.A - system.B @ system.C / through)


def is_stable(poles: Array, *, sampled: bool) -> bool:
    """All inside the unit circle, or left of the axis."""
    return bool((np.abs(poles) < 1.0).all() if sampled else (np.asarray(poles).real < 0.0).all())


def _stays_stable(system: control.StateSpace, gains: list[Crossing], delay_s: float) -> bool:
    """The closed loop without the pure delay is stable, and the delay is within what it bears."""
    if not is_stable(closed_loop_poles(system), sampled=system.isdtime(strict=True)):
        return False
    bare = [Crossing(c.w_rad_s, c.value * np.exp(1j * c.w_rad_s * delay_s)) for c in gains]
    return delay_s == 0.0 or delay_s < _delay_margin(bare)[0]


def _delay_margin(gains: list[Crossing]) -> tuple[float, float]:
    """Least of (phase that may be lost until -180 degrees)/w over the gain crossovers, and where."""
    lags = [(((np.angle(c.value) + math.pi) % (2 * math.pi)) / c.w_rad_s, c.w_rad_s) for c in gains]
    delay, at = min(lags, default=(math.inf, math.nan))
    return float(delay), float(at)


def _real_crossings(system: control.StateSpace, delay_s: float, grid: Array, values: Array) -> list[Crossing]:
    """Where L is real and negative, the ends of the frequency axis included (a curve may begin left of -1)."""
    imag = np.where(np.abs(values.imag) > REAL * np.abs(values), values.imag, 0.0)
    found = [_crossing(system, w, delay_s) for w in roots_of(lambda w: response(system, w, delay_s).imag, grid, imag)]
    ends = [0.0] if is_finite_at_dc(system) else []
    ends += [math.pi / system.dt] if system.isdtime(strict=True) and delay_s == 0.0 else []
    found += [_crossing(system, w, delay_s) for w in ends if w not in [one.w_rad_s for one in found]]
    return sorted(c for c in found if c.value.real < 0.0 and abs(c.value.imag) <= 1e-6 * abs(c.value))


def _crossing(system: control.StateSpace, w: float, delay_s: float) -> Crossing:
    return Crossing(float(w), complex(response(system, w, delay_s)))


def _wrapped(angle: float) -> float:
    """Into (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
