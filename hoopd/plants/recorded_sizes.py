"""Usual sizes that a plant's declaration leaves out, from what was recorded of it.

Ranges of effects, first guesses of disturbances and windows follow usual sizes (`scales`). A level of 0.2 m and a
pressure of 3 MPa are equally usual: what nobody declared is as large as it was in the recordings, in whatever unit. A
state that no sensor reads stays at 1.

Rules of this file: a declaration and recordings in, a declaration out; what is declared is never changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.usual_sizes import units
from hoopd.plants.scales import MOST_RAD
from hoopd.recording.recording import Recording, Signal

Array = NDArray[np.float64]

# Of the readings, the rarest are no usual size: a hundredth at either end.
RARE = 0.01
# Moves of less than this share of the way are noise where a mean rate is counted; the peak of a sine over that mean.
NO_MOVE, PEAK_OVER_MEAN = 0.2, np.pi / 2.0
# Speeds of slots that nobody declared: of a slot, and of a coordinate in m of a plant file.
UNSAID_SPEEDS = (Slot("body").speed, 1.0)


def undeclared_sizes(plant: Plant) -> tuple[str, ...]:
    """Inputs, coordinates and first-order states whose usual size nobody said."""
    inputs = [one.name for one in plant.inputs if one.limit is None or not one.limit < inf]
    return tuple(n for n in (*inputs, *plant.coordinates, *plant.first_order) if n not in plant.scales)


def with_recorded_sizes(plant: Plant, recordings: Sequence[Recording]) -> Plant:
    """The plant, with usual sizes of everything that was recorded, and about which values that is."""
    plant = replace(plant, middles=_middles(plant, recordings))
    found: dict[str, float] = {}
    for name in undeclared_sizes(plant):
        signals = [*_signals(plant, name, recordings)]
        if name not in plant.coordinates:
            found |= _known(name, signals, lambda one: float(np.quantile(np.abs(one.values), 1.0 - RARE)))
            continue
        most = MOST_RAD if units(plant, name).coordinate == "rad" else inf
        found |= _known(name, signals, lambda one, most=most: min(_half_way(one), most))  # type: ignore[misc]
        if f"d{name}" not in plant.scales:
            found |= _known(f"d{name}", signals, _rate)
    slots = {name: _with_speed(one, found) for name, one in plant.slots.items()}
    if not found:
        return plant
    return replace(plant, scales={**found, **plant.scales}, recorded=frozenset(found), slots=slots)


def _middles(plant: Plant, recordings: Sequence[Recording]) -> dict[str, float]:
    """Medians of places, stores and inputs; a rate is about zero."""
    found = {}
    for name in (*(one.name for one in plant.inputs), *plant.coordinates, *plant.first_order):
        values = [one.values for one in _signals(plant, name, recordings)]
        if values:
            found[name] = float(np.median(np.concatenate(values)))
    return found


def _signals(plant: Plant, name: str, recordings: Sequence[Recording]) -> Iterator[Signal]:
    """What was recorded of an input or a state, without what is missing."""
    channels = [channel for channel in plant.channels if plant.state_of(channel) == name]
    names = channels or [one.name for one in plant.inputs if one.name == name]
    for one in recordings:
        for signal in (one.signals[n] for n in names if n in one.signals):
            seen = np.isfinite(signal.values) & np.isfinite(signal.t)
            if np.any(seen):
                yield Signal(signal.values[seen], signal.t[seen], signal.unit, signal.hold)


def _known(name: str, signals: Sequence[Signal], size_of: Callable[[Signal], float]) -> dict[str, float]:
    """The largest of all recordings; nothing where nothing moves."""
    size = max(map(size_of, signals), default=0.0)
    return {name: size} if 0.0 < size < inf else {}


def _half_way(one: Signal) -> float:
    low, high = np.quantile(one.values, (RARE, 1.0 - RARE))
    return float(high - low) / 2.0


def _rate(one: Signal) -> float:
    """Mean rate of all moves from turn to turn, as large as a sine's with this mean."""
    least, way, turn = NO_MOVE * 2.0 * _half_way(one), 0.0, float(one.values[0])
    farthest = turn
    for value in one.values:
        outward = (farthest - turn) * (value - farthest) >= 0.0
        if outward and abs(value - turn) > least:
            farthest = float(value)
        elif abs(farthest - turn) > 0.0 and abs(value - farthest) > least:
            way, turn, farthest = way + abs(farthest - turn), farthest, float(value)
    seconds = float(one.t[-1] - one.t[0])
    return PEAK_OVER_MEAN * (way + abs(farthest - turn)) / seconds if seconds > 0.0 else 0.0


def _with_speed(slot: Slot, found: dict[str, float]) -> Slot:
    speed = found.get(f"d{slot.coordinate}")
    return slot if speed is None or slot.speed not in UNSAID_SPEEDS else slot._replace(speed=speed)
