"""Simulation error over windows of 2 s of the entries model, and what a candidate would take off it.

Rules of this file: numpy only; Gauss-Newton with finite differences, each window's initial state eliminated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from concealed.library import FORCES, SENSORS, Sample, forces_of
from concealed.plant import DEVICE, SAMPLE_S, Array

ROWS = 100  # a window of 2 s
ROUNDS = 4  # of Gauss-Newton; the base is nearly linear
START = (-0.4819, 0.0677, -5.12, 586.4, -0.0033, -0.3351, -73.63, 210.1)  # J11 J12 K1 L1 J21 J22 K2 L2
WEIGHT = DEVICE["mb"] * DEVICE["g"] * (DEVICE["Ro"] - DEVICE["Rb"])
STEP = 1e-5


@dataclass(frozen=True)
class Fit:
    """A fitted base: entries (8,), initial states (4, W), data and where it is missing."""

    p: Array
    x0: Array
    u: Array  # (ROWS, W)
    y: Array  # (ROWS, 3, W), 0 where missing
    there: Array  # (ROWS, 3, W) 1 or 0
    sigma: Array  # (3,) rms of the residuals by channel
    count: int


@dataclass(frozen=True)
class Score:
    """Sum of squares in units of the base's residuals, and how many columns it took."""

    rss: float
    columns: int


def fit_base(tables: Sequence[Mapping[str, Array]]) -> Fit:
    """The entries and initial states that fit the windows best."""
    u, y = (
        np.concatenate([_cut(table, names) for table in tables], axis=-1)
        for names in (("u",), ("theta", "dtheta", "psi"))
    )
    there = np.isfinite(y).astype(float)
    y, x0 = np.nan_to_num(y), _first(y)
    p, sigma = np.array(START), np.array([0.02, 0.3, 0.02])
    for _ in range(ROUNDS):
        fit = Fit(p, x0, u[:, 0], y, there, sigma, int(there.sum()))
        residual, by_state, by_entry, _ = _linear(fit, ())
        step, states = solve(residual, by_state, by_entry)
        p, x0 = p + step, x0 + states.T
        sigma = np.sqrt(((residual * sigma) ** 2).sum((0, 1)) / there.sum((0, 2)))
    return Fit(p, x0, u[:, 0], y, there, sigma, int(there.sum()))


@dataclass(frozen=True)
class Columns:
    """Residual (n,), base columns (n, 8) and candidates' columns, initial states projected out."""

    residual: Array
    base: Array
    candidates: Mapping[str, Array]


def candidates(fit: Fit) -> Columns:
    """Everything that a selection needs, linearised once at the fitted base."""
    residual, by_state, by_entry, columns = _linear(fit, (*FORCES, *SENSORS))
    r, base = _without_states(residual, by_state, by_entry)
    return Columns(r, base, {name: _without_states(residual, by_state, one)[1] for name, one in columns.items()})


def score_candidates(given: Columns, chosen: Sequence[str]) -> dict[str, Score]:
    """Score of the base with the chosen (""), and with each further candidate, re-fitted linearly."""
    fixed = np.hstack([given.base, *(given.candidates[name] for name in chosen)])
    found = {"": Score(_left(given.residual, fixed), fixed.shape[1])}
    for name, extra in given.candidates.items():
        if name not in chosen:
            both = np.hstack((fixed, extra))
            found[name] = Score(_left(given.residual, both), both.shape[1])
    return found


def _cut(table: Mapping[str, Array], names: Sequence[str]) -> Array:
    """(ROWS, len(names), windows)."""
    data = np.stack([table[name] for name in names], axis=1)
    count = len(data) // ROWS
    return data[: count * ROWS].reshape(count, ROWS, len(names)).transpose(1, 2, 0)


def _first(y: Array) -> Array:
    """Rough initial states (4, W) from a line through the first rows."""
    rows = np.arange(6) * SAMPLE_S
    psi = np.array([_line(rows, window) for window in y[:6, 2].T]).T
    return np.stack((y[0, 0], y[0, 1], psi[1], psi[0]))


def _line(t: Array, x: Array) -> Array:
    there = np.isfinite(x)
    return np.polyfit(t[there], x[there], 1)


def _rate(x: Array, s: Sample, p: Array, name: str, column: int, size: Array) -> Array:
    """dx/dt (4, ...); `size` of one column of a force candidate."""
    terms = (x[1], x[3], np.sin(x[2]), s.u)
    first = sum(c * term for c, term in zip(p[:4], terms, strict=True))
    second = sum(c * term for c, term in zip(p[4:], terms, strict=True))
    if name:
        on_theta, on_psi = forces_of(name, s._replace(theta=x[0], dtheta=x[1], psi=x[2], dpsi=x[3]))[column]
        first = first + size * (p[3] * on_theta + p[7] * on_psi)
        second = second + size * (p[7] * on_theta - p[6] / WEIGHT * on_psi)
    return np.stack((x[1], first, x[3], second))


def _simulate(fit: Fit, p: Array, x: Array, name: str = "", column: int = 0, size: float = 0.0) -> Array:
    """States (ROWS, 4, ...) from x (4, ..., W) by one Runge-Kutta step a sample; p (8, ...)."""
    out = []
    h, du = SAMPLE_S, np.diff(fit.u, axis=0, prepend=fit.u[:1])
    for k in range(ROWS):
        out.append(x)
        s = Sample(x[0], x[1], x[2], x[3], np.broadcast_to(fit.u[k], x[0].shape), np.broadcast_to(du[k], x[0].shape))
        k1 = _rate(x, s, p, name, column, size)
        k2 = _rate(x + h / 2 * k1, s, p, name, column, size)
        k3 = _rate(x + h / 2 * k2, s, p, name, column, size)
        k4 = _rate(x + h * k3, s, p, name, column, size)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.stack(out)


def _linear(fit: Fit, names: Sequence[str]) -> tuple[Array, Array, Array, dict[str, Array]]:
    """Residual (ROWS W rows as (W, ROWS, 3)), and columns (W, ROWS, 3, C) by state, entry and candidate, whitened."""
    shifts = np.zeros((13, 12))
    shifts[1:, :] = np.diag([*(STEP * np.maximum(np.abs(fit.p), 0.1)), *[STEP] * 4])
    p = (fit.p + shifts[:, :8]).T[:, :, None]
    x = fit.x0[:, None, :] + shifts[:, 8:].T[:, :, None]
    runs = _simulate(fit, p, x)  # (ROWS, 4, 13, W)
    base = runs[:, :, 0]
    change = (runs[:, :3, 1:] - base[:, :3, None]) / shifts[1:].sum(1)[None, None, :, None]
    weight = (fit.there / fit.sigma[:, None]).transpose(2, 0, 1)
    columns = change.transpose(3, 0, 1, 2) * weight[..., None]
    residual = (fit.y - base[:, :3]).transpose(2, 0, 1) * weight
    return (
        residual,
        columns[..., 8:],
        columns[..., :8],
        {name: _candidate(fit, name, base) * weight[..., None] for name in names},
    )


def _candidate(fit: Fit, name: str, base: Array) -> Array:
    """Change of the outputs by a candidate of unit size, (W, ROWS, 3, columns)."""
    s = Sample(base[:, 0], base[:, 1], base[:, 2], base[:, 3], fit.u, np.diff(fit.u, axis=0, prepend=fit.u[:1]))
    if name in SENSORS:
        columns = SENSORS[name](s, np.gradient(base[:, 1], SAMPLE_S, axis=0))
        out = np.zeros((*base[:, :3].shape, len(columns)))
        for i, (column, axis) in enumerate(columns):
            out[:, axis, :, i] = column
        return out.transpose(2, 0, 1, 3)
    count = len(forces_of(name, s))
    size = 1e-6
    runs = [_simulate(fit, fit.p, fit.x0, name, i, size)[:, :3] for i in range(count)]
    return ((np.stack(runs, -1) - base[:, :3, :, None]) / size).transpose(2, 0, 1, 3)


def _without_states(residual: Array, by_state: Array, columns: Array) -> tuple[Array, Array]:
    """Residual (n,) and columns (n, C) with each window's initial state projected out."""
    windows = len(residual)
    q = np.linalg.qr(by_state.reshape(windows, -1, 4))[0]
    flat = np.concatenate((residual.reshape(windows, -1, 1), columns.reshape(windows, ROWS * 3, -1)), axis=-1)
    left = (flat - q @ (q.transpose(0, 2, 1) @ flat)).reshape(-1, flat.shape[-1])
    return left[:, 0], left[:, 1:]


def _left(r: Array, columns: Array) -> float:
    """Sum of squares that the columns cannot explain."""
    scale = np.sqrt((columns**2).sum(0)) + 1e-300
    q = np.linalg.qr(columns / scale)[0]
    return float(((r - q @ (q.T @ r)) ** 2).sum())


def solve(residual: Array, by_state: Array, by_entry: Array) -> tuple[Array, Array]:
    """Gauss-Newton step of the entries (8,) and of the initial states (W, 4)."""
    r, columns = _without_states(residual, by_state, by_entry)
    step = np.linalg.lstsq(columns, r, rcond=None)[0]
    windows = len(residual)
    rest = residual.reshape(windows, -1) - by_entry.reshape(windows, ROWS * 3, len(step)) @ step
    flat = by_state.reshape(windows, -1, 4)
    states = np.stack([np.linalg.lstsq(a, b, rcond=None)[0] for a, b in zip(flat, rest, strict=True)])
    return step, states
