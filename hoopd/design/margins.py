"""How far a loop is from instability, and how fast a system is: margins, peaks, bandwidths, step response.

Rules of this file: a loop L is one input to one output under negative feedback, 1 + L; crossings and peaks are
bracketed on a grid that is dense at every pole and zero and then refined by a root finder, so no result is a point of
a grid. Before anything else the states that do not count are dropped by name (`analysis.minimal`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import control
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance
from scipy.optimize import brentq, minimize_scalar

from hoopd.design.analysis import minimal, zeros

Array = NDArray[Any]
Function = Callable[[float], float]

# The grid reaches this far beyond the slowest and the fastest pole or zero.
DECADES = 1e3
# A pole or zero this small beside the largest stands at the origin, but for rounding.
AT_ORIGIN = 1e-7
# Of a purely real response the imaginary part is rounding: below this part of |L| its sign means nothing.
REAL = 1e-11
# Turns of a delay's phase that the grid follows; a loop is long small by then.
TURNS = 100


class Crossing(NamedTuple):
    """A frequency where |L| = 1 or where L is real and negative."""

    w_rad_s: float
    value: complex


class Margins(NamedTuple):
    """Distances from instability; inf (gain_down: 0) where nothing is crossed, nan where there is no margin."""

    phase_rad: float  # nearest of all gain crossovers to -180 degrees, with its sign
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


class Bandwidth(NamedTuple):
    """Both definitions in use; inf: never falls below, nan: there is no such level."""

    absolute_rad_s: float  # above it |P| stays below 1/sqrt 2
    below_dc_rad_s: float  # |P| first falls below |P(0)|/sqrt 2 (3.01 dB)
    dc_gain: float


# ---------------------------------------------------------------------------------------------- response


def response(system: control.StateSpace, w_rad_s: Any, delay_s: float = 0.0) -> Any:
    """P(jw) e^(-jw delay), or P(e^jwh) e^(-jw delay) of a sampled system; shape of `w_rad_s`."""
    w = np.asarray(w_rad_s, float)
    s = 1j * w
    point = np.exp(s * system.dt) if system.isdtime(strict=True) else s
    return _evaluated(system, point) * np.exp(-s * delay_s)


def _evaluated(system: control.StateSpace, point: Array) -> Any:
    """C (sI - A)^-1 B + D at all points in one call, 20 times faster than python-control's loop over points."""
    try:
        x = np.linalg.solve(point[..., None, None] * np.eye(system.nstates) - system.A, system.B)
    except np.linalg.LinAlgError:  # a pole is among the points: python-control gives inf there
        return np.asarray(system(point, squeeze=True, warn_infinite=False))
    return (system.C @ x)[..., 0, 0] + system.D[0, 0]


def prepared(system: control.StateSpace) -> control.StateSpace:
    """The system without what cancels by name, its states scaled by powers of two (no rounding) until A is balanced:
    python-control's companion forms of a Pade delay span 26 decades, and their response comes out as nan."""
    less = minimal(system).system
    if less.nstates < 2:
        return less
    _, (scale, _) = matrix_balance(less.A, permute=False, separate=True)
    a, b, c = less.A * scale / scale[:, None], less.B / scale[:, None], less.C * scale
    return control.ss(a, b, c, less.D, less.dt)


def frequency_grid(system: control.StateSpace, delay_s: float = 0.0, points: int = 600) -> Array:
    """Frequencies (rad/s) that miss no resonance: dense about every pole and zero, as wide as it is damped."""
    features = _features(system)
    sizes = np.abs(features)
    sizes = sizes[sizes > sizes.max(initial=0.0) * AT_ORIGIN]
    low, high = (sizes.min() / DECADES, sizes.max() * DECADES) if sizes.size else (1e-3, 1e3)
    nyquist = math.pi / system.dt if system.isdtime(strict=True) else math.inf
    parts = [np.geomspace(min(low, nyquist * 1e-6), min(high, nyquist), points)]
    for feature in features[np.abs(features.imag) > 0.0]:
        # even steps of phase: a resonance is drawn as the circle that it is
        width = max(abs(feature.real), 1e-7 * abs(feature.imag)) * np.tan(np.linspace(0.01, 1.56, points // 24))
        parts += [abs(feature.imag) - width, abs(feature.imag) + width]
    if delay_s > 0.0:
        parts.append(np.linspace(low, min(high, TURNS * 2 * math.pi / delay_s), 20 * TURNS))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid > 0.0) & (grid <= min(high, nyquist))]


def _features(system: control.StateSpace) -> Array:
    """Poles and zeros as frequencies of continuous time, ln(z)/h of a sampled system."""
    all_of_them = np.concatenate([system.poles(), zeros(system)]).astype(complex)
    if not system.isdtime(strict=True):
        return all_of_them
    logarithms: Array = np.log(all_of_them[np.abs(all_of_them) > 1e-9]) / system.dt
    return logarithms


# ---------------------------------------------------------------------------------------------- margins


def margins(loop: control.StateSpace, delay_s: float = 0.0) -> Margins:
    """Margins of 1 + L, `delay_s` being a pure delay in the loop that L does not hold (its phase is exact).

    python-control's `margin` reads the 0/0 of an unseen integrator (the hoop angle) at w = 0 as a gain margin of
    0.126 there, and knows neither delay margin nor delays; here the integrator is dropped first.
    """
    system = prepared(loop)
    grid = _with_turning_points(system, frequency_grid(system, delay_s))
    values = response(system, grid, delay_s)
    if not np.isfinite(values).all():
        raise ValueError("the loop's response cannot be computed: its state space is too badly scaled")
    gains = [_crossing(system, w, delay_s) for w in _roots(lambda w: _size(system, w), grid, np.log(np.abs(values)))]
    real = _real_crossings(system, delay_s, grid, values)
    stable = _stays_stable(system, gains, delay_s)
    away = [(_wrapped(float(np.angle(c.value)) + math.pi), c.w_rad_s) for c in gains]
    phase, phase_at = min(away, key=lambda one: abs(one[0]), default=(math.inf, math.nan))
    delay, delay_at = _delay_margin(gains) if stable else (math.nan, math.nan)
    factors = [(1.0 / abs(c.value), c.w_rad_s) for c in real if c.value != 0]
    up, up_at = min((f for f in factors if f[0] > 1.0), default=(math.inf, math.nan))
    down, down_at = max((f for f in factors if f[0] < 1.0), default=(0.0, math.nan))
    whole = np.concatenate([[0.0], grid]) if is_finite_at_dc(system) else grid
    ms, ms_at = _peak(whole, lambda w: 1.0 / abs(1.0 + response(system, w, delay_s)))
    if not system.isdtime(strict=True) and delay_s == 0.0:  # S(inf) = 1/(1 + D) may be the largest
        ms, ms_at = max((ms, ms_at), (1.0 / max(abs(1.0 + float(system.D[0, 0])), 1e-300), math.inf))
    mt, mt_at = _peak(whole, lambda w: abs(1.0 - 1.0 / (1.0 + response(system, w, delay_s))))
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
    found = [_crossing(system, w, delay_s) for w in _roots(lambda w: response(system, w, delay_s).imag, grid, imag)]
    ends = [0.0] if is_finite_at_dc(system) else []
    ends += [math.pi / system.dt] if system.isdtime(strict=True) and delay_s == 0.0 else []
    found += [_crossing(system, w, delay_s) for w in ends if w not in [one.w_rad_s for one in found]]
    return sorted(c for c in found if c.value.real < 0.0 and abs(c.value.imag) <= 1e-6 * abs(c.value))


def is_finite_at_dc(system: control.StateSpace) -> bool:
    """No pole at s = 0 (z = 1)."""
    centre = 1.0 if system.isdtime(strict=True) else 0.0
    poles = system.poles()
    return not poles.size or bool(np.abs(poles - centre).min() > 1e-12 * max(1.0, np.abs(poles).max()))


def _crossing(system: control.StateSpace, w: float, delay_s: float) -> Crossing:
    return Crossing(float(w), complex(response(system, w, delay_s)))


def _size(system: control.StateSpace, w: float) -> float:
    return math.log(abs(response(system, w)))


def _wrapped(angle: float) -> float:
    """Into (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)


# ---------------------------------------------------------------------------------------------- roots and peaks


def _roots(function: Function, grid: Array, values: Array) -> list[float]:
    """Roots between points of different sign, to rounding (brentq); `values` are those on the grid, 0 = not decided."""
    decided = np.flatnonzero(np.isfinite(values) & (values != 0.0))
    changes = np.flatnonzero(np.diff(np.sign(values[decided])))
    pairs = zip(grid[decided[changes]], grid[decided[changes + 1]], strict=True)
    return [float(brentq(function, low, high, xtol=1e-300, rtol=1e-14)) for low, high in pairs]


def _with_turning_points(system: control.StateSpace, grid: Array) -> Array:
    """The grid and the exact tops and bottoms of |L|: a top that just reaches 1 is not missed."""
    size = np.log(np.maximum(np.abs(response(system, grid)), 1e-300))
    slope = np.sign(np.diff(size))
    turns = np.flatnonzero(slope[:-1] * slope[1:] < 0) + 1
    found = [_turn(partial(_signed_size, system, -slope[i - 1]), grid[i - 1], grid[i + 1]) for i in turns]
    return np.unique(np.concatenate([grid, found]))


def _signed_size(system: control.StateSpace, sign: float, w: float) -> float:
    return sign * _size(system, w)


def _turn(function: Function, low: float, high: float) -> float:
    found = minimize_scalar(function, bounds=(low, high), method="bounded", options={"xatol": 1e-10 * high})
    return float(found.x)


def _peak(grid: Array, function: Callable[[Any], Any]) -> tuple[float, float]:
    """Largest value and its frequency; the three highest tops of the grid are refined."""
    values = function(grid)
    inner = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])) + 1
    tops = inner[np.argsort(values[inner])[-3:]]
    places = [float(grid[np.argmax(values)])]
    places += [_turn(lambda w: -float(function(w)), grid[i - 1], grid[i + 1]) for i in tops]
    best = max(places, key=lambda w: float(function(w)))
    return float(function(best)), best


# ---------------------------------------------------------------------------------------------- speed


def bandwidth(system: control.StateSpace) -> Bandwidth:
    """Both bandwidths of one input to one output (python-control has the second, at 3.000 dB instead of 1/sqrt 2)."""
    less = prepared(system)
    grid = _with_turning_points(less, frequency_grid(less))
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
    found = _roots(lambda w: _size(system, w) - level, grid, size - level)
    return [w for w in found if _size(system, w * (1 - 1e-6)) > level > _size(system, min(w * (1 + 1e-6), grid[-1]))]


class SamplingAdvice(NamedTuple):
    """Sampling frequencies that fit a bandwidth, in Hz."""

    slowest_hz: float
    fastest_hz: float


def sampling_advice(bandwidth_rad_s: float) -> SamplingAdvice:
    """Sample at 10 to 30 times the bandwidth in Hz (Franklin, Powell, Workman: 20 to 40 for smooth control; the thesis
    prints it the other way round, a bandwidth of 10 to 30 times the sampling frequency, which no loop can have)."""
    return SamplingAdvice(10 * bandwidth_rad_s / (2 * math.pi), 30 * bandwidth_rad_s / (2 * math.pi))


def step_info(system: control.StateSpace, points: int = 20_000) -> dict[str, float] | None:
    """Rise (10-90 %), settling (2 %) time in s, overshoot %, peak, final value; None when it does not settle.

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
    time = np.arange(0.0, end, less.dt) if discrete else np.linspace(0.0, end, points)
    _, y = control.step_response(less, time)
    found = control.step_info(np.asarray(y), T=time, yfinal=float(less.dcgain()))
    return {str(name): float(value) for name, value in found.items()}
