"""Short pushes in a recording that no model explains: a bump, a hand, a catch of the wheel.

Each is a force of constant size on one coordinate between two times, found by the adjoint of what a fit leaves; the
largest is taken from the rest before the next is looked for.

Rules of this file: mean shifts only; stretches of more noise than usual are found elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.engine.filtering import whitened
from hoopd.diagnose.engine.fitting import Fit
from hoopd.diagnose.search.adjoint import Adjoint
from hoopd.diagnose.search.pushes import best_windows, lengths
from hoopd.diagnose.search.scanned import Place
from hoopd.diagnose.search.screen import Screen
from hoopd.diagnose.search.surprise import surprise

Array = NDArray[np.float64]

# What lasts longer is physics or a setting, not an event.
SHORTEST_S, LONGEST_S = 0.04, 1.0
# Nats above what the best of all places has by chance: one false event in e^12 = 160,000 recordings.
EVENT_NATS = 12.0
# A recording with more is not disturbed but described badly.
MOST_EVENTS = 12


@dataclass(frozen=True)
class Event:
    """A push on a coordinate from t0 to t1, seconds of its recording; size in the coordinate's force unit."""

    recording: str
    t0: float
    t1: float
    coordinate: str
    size: float
    gain: float  # nats


def events(fit: Fit) -> list[Event]:
    """Pushes beyond chance, largest first; those of one recording do not stand for one another."""
    screen, found = Screen(fit, ()), []
    rest = screen.residual
    for _ in range(MOST_EVENTS):
        best = max(_candidates(screen, rest), key=lambda pair: pair[0].gain, default=None)
        if best is None:
            break
        found.append(best[0])
        rest = rest - best[1]
    return sorted(found, key=lambda one: -one.gain)


def _candidates(screen: Screen, rest: Array) -> Iterator[tuple[Event, Array]]:
    """Of every coordinate the best, where it is beyond chance, with its part of the rows."""
    adjoint = Adjoint(screen, rest)
    every = (coordinate for track in screen.fit.tracks for coordinate in track.composite.plant.coordinates)
    for coordinate in dict.fromkeys(every):
        answers = adjoint.to_push(coordinate)
        found, candidates = best_windows(answers, lengths(SHORTEST_S, LONGEST_S), 1)
        for place in found:
            event, part = _scored(screen, rest, coordinate, place)
            # where the rest is rougher than the model's noise, a push must stand out of that
            if surprise(event.gain / place.spread, 1, candidates) > EVENT_NATS:
                yield event, part


def _scored(screen: Screen, rest: Array, coordinate: str, place: Place) -> tuple[Event, Array]:
    z = _pushed(screen, coordinate, place)
    size = float(z @ rest) / max(float(z @ z), 1e-300)
    gain = float(z @ rest) * size / 2
    t0, t1 = place.shape["t0"], place.shape["t1"]
    return Event(str(place.recording), t0, t1, coordinate, size, gain), size * z


def _pushed(screen: Screen, coordinate: str, place: Place) -> Array:
    """(rows,) what a unit push changes, whitened and projected."""
    out = []
    for track, columns, gains in zip(screen.fit.tracks, screen.fit.columns, screen.fit.gains, strict=True):
        model, coordinates = columns.model, track.composite.plant.coordinates
        f, eps = np.zeros((*model.w.shape[:2], 1)), np.zeros((*model.c.shape[:2], 1))
        if track.stretch.recording == place.recording and coordinate in coordinates:
            middle = track.stretch.t[:-1] + track.stretch.h / 2
            inside = (middle > place.shape["t0"]) & (middle < place.shape["t1"])
            f[:, :, 0] = np.where(inside[:, None], model.w[:, :, coordinates.index(coordinate)], 0.0)
        out.append(whitened(model, gains, f, eps).ravel())
    return screen.projected(-np.concatenate(out)[:, None])[:, 0]
