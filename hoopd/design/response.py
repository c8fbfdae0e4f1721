"""A system's response over frequency, and what is found on it exactly: crossings, tops and bottoms.

Rules of this file: a grid only brackets; it is dense at every pole and zero, and a root finder goes from there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import control
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import matrix_balance
from scipy.optimize import brentq, minimize_scalar

from hoopd.design.analysis import minimal
from hoopd.ident.transfer_functions import zeros

Array = NDArray[Any]
Function = Callable[[float], float]
Lti: TypeAlias = control.StateSpace | control.TransferFunction

# The grid reaches this far beyond the slowest and the fastest pole or zero.
DECADES = 1e3
# A pole or zero this small beside the largest stands at the origin, but for rounding.
AT_ORIGIN = 1e-7
# Beside the largest singular value, and for each state: below this a matrix has no inverse, but for its rounding and
# that of the exponential of a stiff plant that was sampled.
SINGULAR = 10.0 * float(np.finfo(float).eps)
# Stands for 0 where a logarithm is taken.
TINY = 1e-300
# Turns of a delay's phase that the grid follows; a loop is long small by then.
TURNS = 100


def response(system: Lti, w_rad_s: Any, delay_s: float = 0.0) -> Any:
    """P(jw) e^(-jw delay), or P(e^jwh) e^(-jw delay) of a sampled system; shape of `w_rad_s`."""
    w = np.asarray(w_rad_s, float)
    s = 1j * w
    point = np.exp(s * system.dt) if system.isdtime(strict=True) else s
    return _evaluated(system, point) * np.exp(-s * delay_s)


def _evaluated(system: Lti, point: Array) -> Any:
    """C (sI - A)^-1 B + D at all points in one call, some 7 times faster than python-control's loop over points."""
    if not isinstance(system, control.StateSpace):
        return np.asarray(system(point, squeeze=True, warn_infinite=False))
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


def is_finite_at_dc(system: control.StateSpace) -> bool:
    """No pole at s = 0 (z = 1), of a system whose states are balanced (`prepared`).

    Of a double pole rounding makes two that are the root of it away: A (A - I) is asked whether it has an inverse.
    """
    if not system.nstates:
        return True
    centre = 1.0 if system.isdtime(strict=True) else 0.0
    poles = system.poles()
    if np.abs(poles - centre).min() <= 1e-12 * max(1.0, np.abs(poles).max()):
        return False
    sizes = np.linalg.svd(system.A - centre * np.eye(system.nstates), compute_uv=False)
    return bool(sizes[-1] > SINGULAR * system.nstates * sizes[0])


def log_size(system: control.StateSpace, w: float) -> float:
    """ln |P|; at an undamped pole, where it cannot be computed, that of something very large."""
    size = abs(response(system, w))
    return math.log(max(size, TINY)) if math.isfinite(size) else -math.log(TINY)


def roots_of(function: Function, grid: Array, values: Array) -> list[float]:
    """Roots between points of different sign, to rounding (brentq); `values` are those on the grid, 0 = not decided."""
    decided = np.flatnonzero(np.isfinite(values) & (values != 0.0))
    changes = np.flatnonzero(np.diff(np.sign(values[decided])))
    pairs = zip(grid[decided[changes]], grid[decided[changes + 1]], strict=True)
    return [float(brentq(_finite(function), low, high, xtol=TINY, rtol=1e-14)) for low, high in pairs]


def _finite(function: Function) -> Function:
    """The function with a large value at an undamped pole."""

    def value(w: float) -> float:
        found = float(function(w))
        return found if math.isfinite(found) else 1.0 / TINY

    return value


def with_turning_points(system: control.StateSpace, grid: Array) -> Array:
    """The grid and the exact tops and bottoms of |L|: a top that just reaches 1 is not missed."""
    size = np.log(np.maximum(np.abs(response(system, grid)), TINY))
    slope = np.sign(np.diff(size))
    turns = np.flatnonzero(slope[:-1] * slope[1:] < 0) + 1
    found = [_turn(partial(_signed_log_size, system, -slope[i - 1]), grid[i - 1], grid[i + 1]) for i in turns]
    return np.unique(np.concatenate([grid, found]))


def _signed_log_size(system: control.StateSpace, sign: float, w: float) -> float:
    return sign * log_size(system, w)


def _turn(function: Function, low: float, high: float) -> float:
    found = minimize_scalar(function, bounds=(low, high), method="bounded", options={"xatol": 1e-10 * high})
    return float(found.x)


def peak_of(grid: Array, function: Callable[[Any], Any]) -> tuple[float, float]:
    """Largest value and its frequency; the three highest tops of the grid are refined."""
    values = function(grid)
    inner = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])) + 1
    tops = inner[np.argsort(values[inner])[-3:]]
    places = [float(grid[np.argmax(values)])]
    places += [_turn(lambda w: -float(function(w)), grid[i - 1], grid[i + 1]) for i in tops]
    best = max(places, key=lambda w: float(function(w)))
    return float(function(best)), best
