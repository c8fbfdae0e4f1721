"""The oracle of what is outside the library: it simulates with the truth and without, and re-fits the base to both.

Free runs over windows of 2 s, as a diagnosis is judged by: the eight entries J, K, L are fitted to the training
recordings, each window's initial state to its window. The oracle has the mechanism with its true parameters, and what
it remembers where each window begins.

Rules of this file: numpy only, nothing of `hoopd`; Gauss-Newton with finite differences, from the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from concealed import control
from concealed.baselines import read
from concealed.forces import Force, Moment, Parameters
from concealed.outside.nearest import MOTION, SENSORS, fine, nearest
from concealed.plant import PIECES, SAMPLE_S, Array, Body, body, entries
from concealed.sensors import Noise
from concealed.simulate import WARM, Columns, Stretch, free_run
from concealed.windows import ROWS, solve

SUBSTEPS = 16
ROUNDS, STATE_ROUNDS = 5, 3  # of Gauss-Newton; base and initial states are nearly linear
STEP = 1e-4  # of the finite differences: of an entry's own size, and rad or rad/s of an initial state
SPREAD = (0.02, 0.3, 0.02)  # rad, rad/s, rad: of the residuals, at first
CHANNELS = ("theta_rate", "dtheta", "psi")
Effects = Mapping[str, Mapping[str, Array]]


@dataclass(frozen=True)
class Windows:
    """W windows of 2 s: what was recorded and what is true of them."""

    u: Array  # with the WARM samples before (WARM + ROWS, W)
    y: Array  # theta, theta', psi (ROWS, 3, W), NaN where missing
    past: Array  # true motion every 2.5 ms up to the first row (WARM PIECES + 1, 4, W)
    memory: Mapping[str, Array]  # (W,)
    began_s: Array  # (W,)
    effects: Effects  # the mechanism, its parameters (W,)


@dataclass(frozen=True)
class Fitted:
    """Shifts of the entries (8,), initial states (4, W)."""

    shifts: Array
    x0: Array


def oracle(files: Mapping[str, bytes], signals: Mapping[str, bytes], answer: Mapping[str, Any]) -> dict[str, Any]:
    """{"fit": {"train", "heldout"}, "nearest"}: `base_refit` and `with_effects` in percent of each channel, and the
    nearest name of the library; or {"error"}."""
    device = body({key: np.array([value]) for key, value in answer["base"].items()})
    told = {name: _windows(read(files[name]), read(signals[name]), answer, name) for name in sorted(files)}
    training = _together([told[name] for name in told if name != "holdout.csv"])
    found: dict[str, dict[str, dict[str, dict[str, float]]]] = {"train": {}, "heldout": {}}
    try:
        for label, known in (("base_refit", False), ("with_effects", True)):
            shifts = _fit(training, device, known, ROUNDS).shifts
            for name, windows in told.items():
                mine = _fit(windows, device, known, STATE_ROUNDS, shifts)
                part = found["heldout" if name == "holdout.csv" else "train"].setdefault(name, {})
                for channel, fit in _percent(windows, _runs(windows, device, mine, known)[:, :, 0]).items():
                    part.setdefault(channel, {})[label] = fit
    except (np.linalg.LinAlgError, FloatingPointError) as error:
        return {"error": f"{type(error).__name__}: {error}"}
    return {"fit": found, "nearest": nearest(files, signals, answer)}


def _windows(table: Mapping[str, Array], truth: Mapping[str, Array], answer: Mapping[str, Any], name: str) -> Windows:
    starts = range(0, len(table["u"]) - ROWS + 1, ROWS)
    motion = fine(np.stack([truth[key] for key in MOTION], axis=1))
    u = np.concatenate((np.full(WARM, table["u"][0]), table["u"]))
    y = np.stack([table[key] for key in ("theta", "dtheta", "psi")], axis=1)
    remembered = [key for key in truth if key not in ("t", *MOTION, "on_theta", "on_psi", "on_phi", *SENSORS)]
    (effect,) = answer["effects"]
    values = effect["by_recording"][name.removesuffix(".csv")]
    return Windows(
        np.stack([u[k : k + WARM + ROWS] for k in starts], axis=-1),
        np.stack([y[k : k + ROWS] for k in starts], axis=-1),
        np.stack([motion[k * PIECES : (k + WARM) * PIECES + 1] for k in starts], axis=-1),
        {key: truth[key][list(starts)] for key in remembered},
        SAMPLE_S * np.array(starts),
        {effect["name"]: {key: np.full(len(starts), value) for key, value in values.items()}},
    )


def _together(parts: Sequence[Windows]) -> Windows:
    """All windows of some recordings."""
    first = parts[0]
    return Windows(
        np.concatenate([part.u for part in parts], axis=-1),
        np.concatenate([part.y for part in parts], axis=-1),
        np.concatenate([part.past for part in parts], axis=-1),
        {key: np.concatenate([part.memory[key] for part in parts]) for key in first.memory},
        np.concatenate([part.began_s for part in parts]),
        {
            name: {key: np.concatenate([part.effects[name][key] for part in parts]) for key in values}
            for name, values in first.effects.items()
        },
    )


def shifted(p: Parameters, s: Moment) -> Force:
    """Torques on theta and psi (N m) that change each entry J, K, L by p: M times the accelerations of the shifts."""
    regressors = (s.dtheta, s.dpsi, np.sin(s.psi), s.torque)
    first, second = (sum(p[f"{k}"] * x for k, x in zip(keys, regressors, strict=True)) for keys in _ENTRIES)
    d = s.device
    # M is the inverse of (i11, i12; i12, i22)
    det = d.i11 * d.i22 - d.i12**2
    return (d.i22 * first - d.i12 * second) / det, (d.i11 * second - d.i12 * first) / det, 0.0


_ENTRIES = (("J11", "J12", "K1", "L1"), ("J21", "J22", "K2", "L2"))
_NAMES = (*_ENTRIES[0], *_ENTRIES[1])


def _fit(windows: Windows, device: Body, known: bool, rounds: int, held: Array | None = None) -> Fitted:
    """Entries and initial states, or with `held` entries the states alone; a step that makes it worse is halved."""
    scale = np.maximum(np.abs([float(entries(device)[name][0]) for name in _NAMES]), 0.1) * STEP
    sigma, there = np.array(SPREAD), np.isfinite(windows.y)
    at = Fitted(np.zeros(8) if held is None else held, windows.past[-1].copy())
    best, best_rss, step = at, np.inf, at
    for _ in range(rounds):
        runs = _runs(windows, device, at, known, scale, entries_too=held is None)
        residual = np.where(there, windows.y - runs[:, :, 0], 0.0)
        rss = float(((residual / sigma[:, None]) ** 2).sum())
        if rss < best_rss:
            best, best_rss = at, rss
            step = _step(residual, runs, there, scale, at)
        else:
            step = Fitted(step.shifts / 2, step.x0 / 2)
        at = Fitted(best.shifts + step.shifts, best.x0 + step.x0)
    return best


def _step(residual: Array, runs: Array, there: Array, scale: Array, at: Fitted) -> Fitted:
    """Gauss-Newton, each channel in units of its own residuals."""
    sigma = np.sqrt((residual**2).sum((0, 2)) / np.maximum(there.sum((0, 2)), 1)) + 1e-9
    weight = (there / sigma[:, None]).transpose(2, 0, 1)
    change = (runs[:, :, 1:] - runs[:, :, :1]).transpose(3, 0, 1, 2) * weight[..., None]
    by_state, by_entry = change[..., :4] / STEP, change[..., 4:] / scale[: change.shape[-1] - 4]
    shifts, x0 = solve((residual / sigma[:, None]).transpose(2, 0, 1), by_state, by_entry)
    return Fitted(shifts if len(shifts) else np.zeros_like(at.shifts), x0.T)


def _runs(
    windows: Windows, device: Body, at: Fitted, known: bool, scale: Array | None = None, entries_too: bool = False
) -> Array:
    """Free runs (ROWS, 3, C, W): at the point itself and, with `scale`, beside it in each direction."""
    moves = np.zeros((1 if scale is None else 13 if entries_too else 5, 12))
    if scale is not None:
        moves[1:, :] = np.diag([*[STEP] * 4, *scale])[: len(moves) - 1]
    count, width = len(moves), windows.u.shape[1]
    x0 = at.x0[:, None, :] + moves[:, :4].T[:, :, None]
    past = np.repeat(windows.past[:, :, None, :], count, axis=2)
    # the past goes with the initial state
    past = past + (x0 - past[-1])[None]
    shifts = {name: np.repeat(at.shifts[i] + moves[:, 4 + i], width) for i, name in enumerate(_NAMES)}

    def wide(x: Array) -> Array:
        return np.tile(x, count)

    effects = {name: {key: wide(x) for key, x in p.items()} for name, p in windows.effects.items()} if known else {}
    feed = np.tile(windows.u, (1, count))
    stretch = Stretch(
        wide(windows.began_s),
        past.reshape(*past.shape[:2], -1),
        {key: wide(x) for key, x in windows.memory.items()} if known else {},
        ((shifted, shifts),),
    )
    clean = free_run(_columns(device, effects, x0.reshape(4, -1), feed), stretch, SUBSTEPS)
    return clean.reshape(*clean.shape[:2], count, width)


def _columns(device: Body, effects: Effects, start: Array, feed: Array) -> Columns:
    """What is driven by `feed` alone, without disturbance and noise."""
    given = {key: np.broadcast_to(value, feed.shape[1:]) for key, value in device.given.items()}
    zero, none = np.zeros((len(feed), 1)), np.zeros((len(feed), 1), dtype=bool)
    still = control.Law(np.zeros(1), np.zeros(1), np.zeros(1), reference=zero)
    noise = Noise(zero, zero, none, none, zero)
    return Columns(body(given), effects, start, feed, np.zeros((len(feed) * PIECES, 2, 1)), noise, still)


def _percent(windows: Windows, clean: Array) -> dict[str, float]:
    """100 (1 - |y - yhat|/|y - mean y|) of each channel over all windows."""
    pairs = {
        "theta_rate": tuple(np.gradient(x[:, 0], SAMPLE_S, axis=0) for x in (windows.y, clean)),
        "dtheta": (windows.y[:, 1], clean[:, 1]),
        "psi": (windows.y[:, 2], clean[:, 2]),
    }
    return {
        name: float(100 * (1 - np.sqrt(np.nansum((y - told) ** 2) / np.nansum((y - np.nanmean(y)) ** 2))))
        for name, (y, told) in pairs.items()
    }
