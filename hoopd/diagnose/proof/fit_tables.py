"""How well each hypothesis repeats a recording: NRMSE of free runs over windows, channel by channel.

Rules of this file: one measure for every hypothesis; what was set aside does not count; a channel that never moves has
no figure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.proof.simulation import Simulated, fitted_starts, windows_of
from hoopd.diagnose.proof.window_lengths import window_of
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]
T = TypeVar("T")

# What starts are weighted by: this share of a channel's spread, and of a rate's for an angle that turns on and on.
SPREAD_SHARE, RATE_S = 0.02, 0.3
# A stretch of fewer usual samples, and less than half a window, is not simulated.
SHORTEST_STEPS = 50
# Of its largest number: what scatters less does not move, and is rounded.
NOT_MOVING = 1e-9


@dataclass(frozen=True)
class Played:
    """A fit with its free runs over windows."""

    fit: HypothesisFit
    runs: list[Simulated]

    @property
    def window_s(self) -> float:
        """About as long as each window is."""
        return window_of([track.stretch.plant for track in self.fit.tracks])

    def by_recording(self) -> dict[str, list[Simulated]]:
        """The runs of each recording."""
        found: dict[str, list[Simulated]] = {}
        for run in self.runs:
            found.setdefault(run.windows.stretch.recording, []).append(run)
        return found


def played(fits: Mapping[str, HypothesisFit]) -> dict[str, Played]:
    """Every fit simulated; one that stands under several names once."""
    once = {id(one): one for one in fits.values()}
    found = {key: Played(one, run_windows(one)) for key, one in once.items()}
    return {name: found[id(one)] for name, one in fits.items()}


def with_and_without(fits: Mapping[str, T], name: str) -> tuple[T, T]:
    """Of what is told by name of all that is kept (`named`) and without each of it: with a name, and without it; one
    that is not kept stands beside what is (`with NAME`)."""
    return fits.get(f"with {name}", fits["named"]), fits[f"without {name}"]


def run_windows(found: HypothesisFit) -> list[Simulated]:
    """Every stretch of a fit, simulated from fitted starts."""
    out = []
    for track in found.tracks:
        plant = track.stretch.plant
        shortest = min(window_of([plant]) / 2.0, SHORTEST_STEPS * plant.time_scale_s)
        if (track.stretch.t[-1] - track.stretch.t[0]) < shortest:
            continue
        windows = windows_of(track.stretch)
        sigma = start_weights(track.stretch)
        out.append(fitted_starts(windows, found.effects, track.local(found.values), track.z, sigma))
    return out


def start_weights(stretch: Stretch) -> Array:
    """(nc,) what an error of each channel is measured in when a start is fitted."""
    plant, out = stretch.plant, []
    for column, state in enumerate(plant.states_read):
        y = stretch.y[:, column]
        seen = np.isfinite(y)
        spread = float(np.std(y[seen])) if seen.any() else 1.0
        if state in plant.coordinates and seen.sum() > 2:
            rate = np.diff(y[seen]) / np.diff(stretch.t[seen])
            spread = min(spread, RATE_S * motion_scale(plant) * float(np.std(rate)))
        judged = state.removeprefix("d") in plant.coordinates and state not in plant.coordinates
        # a measured rate beside its angle is data to be judged and gets no vote
        out.append(np.inf if judged and state.removeprefix("d") in plant.states_read else SPREAD_SHARE * spread)
    weights: Array = np.maximum(np.array(out), 1e-300)
    return weights


def nrmse(runs: Sequence[Simulated]) -> dict[str, float]:
    """Percent by channel over all windows; `<angle>_rate` for an angle that has a measured rate beside it."""
    found = {}
    for name, parts in series(runs).items():
        y, yhat = (np.concatenate([part[i] for part in parts]) for i in (1, 2))
        found[name] = percent(y, yhat)
    return found


def series(runs: Sequence[Simulated]) -> dict[str, list[tuple[Array, Array, Array]]]:
    """(t, measured, simulated) by channel, a part each window, only what counts."""
    out: dict[str, list[tuple[Array, Array, Array]]] = {}
    for run in runs:
        states = run.windows.stretch.plant.states_read
        for column, (channel, state) in enumerate(zip(run.windows.stretch.plant.channels, states, strict=True)):
            turning = f"d{state}" in states
            for b in range(run.y.shape[2]):
                n, first = run.windows.count[b], run.windows.first[b]
                t = run.windows.stretch.t[first : first + n]
                y, yhat = run.windows.y[:n, column, b], run.y[:n, column, b]
                seen = np.isfinite(y)
                part = (t[seen], y[seen], yhat[seen])
                if turning:
                    out.setdefault(f"{channel}_rate", []).append(_rate(*part))
                else:
                    out.setdefault(channel, []).append(part)
    return out


def _rate(t: Array, y: Array, yhat: Array) -> tuple[Array, Array, Array]:
    """Central differences of both over the same samples."""
    if len(t) < 3:
        return t[:0], y[:0], yhat[:0]
    span = t[2:] - t[:-2]
    return t[1:-1], (y[2:] - y[:-2]) / span, (yhat[2:] - yhat[:-2]) / span


def percent(y: Array, yhat: Array) -> float:
    """100 (1 - |y - yhat| / |y - mean y|); NaN for a channel that never moves."""
    spread = spread_of(y)
    return 100.0 * (1.0 - float(np.linalg.norm(y - yhat)) / spread) if spread > 0.0 else float("nan")


def spread_of(y: Array) -> float:
    """|y - mean y| of readings (n,); 0 of too few, and of what never moves, in any unit."""
    spread = float(np.linalg.norm(y - y.mean())) if len(y) > 2 else 0.0
    return spread if spread > NOT_MOVING * float(np.abs(y).max(initial=0.0)) else 0.0


def noise_floor(runs: Sequence[Simulated], noise: Mapping[str, Noise]) -> dict[str, float]:
    """Percent that the readings' own noise leaves."""
    found = {}
    for name, parts in series(runs).items():
        plant = runs[0].windows.stretch.plant
        channel = name if name in plant.channels else name.removesuffix("_rate")
        column = list(plant.channels).index(channel)
        sigma = noise[runs[0].windows.stretch.recording].reading[column]
        y, t = np.concatenate([p[1] for p in parts]), np.concatenate([p[0] for p in parts])
        if len(y) < 3:
            continue
        if name != channel:  # (e_k+1 - e_k-1) / 2h
            sigma = sigma * np.sqrt(2.0) / (2.0 * float(np.median(np.diff(t))))
        spread = spread_of(y)
        found[name] = 100.0 * (1.0 - sigma * np.sqrt(len(y)) / spread) if spread > 0.0 else float("nan")
    return found


def channel_source(stretches: Sequence[Stretch]) -> dict[str, str]:
    """What stands for a measured rate that is no measurement of it."""
    out = {}
    for one in stretches:
        states = dict(zip(one.plant.channels, one.plant.states_read, strict=True))
        for column, (channel, state) in enumerate(states.items()):
            angle = next((c for c, s in states.items() if f"d{s}" == state), None)
            if angle is not None and not np.isfinite(one.y[:, column]).any():
                out[channel] = f"the derivative of {angle}: the measured column is no rate of it"
    return out
