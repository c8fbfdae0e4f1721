"""Usual times and sizes of a plant over those for which the constants of the search are written: the hoop's.

A constant that is a time (a window, the memory of a disturbance, a margin) is written in seconds of a plant that moves
by 1 rad at 10 rad/s, in 0.1 s, and is sampled each 0.02 s. On another plant it is so many times longer, and a size so
many times larger: what is found does not depend on what a second or a metre is called.

Rules of this file: numbers of a declaration in, numbers out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.usual_sizes import USUAL_SPEED, speed_scale, time_scale, usual_of

Array = NDArray[np.float64]

# The motion for which sizes and times are written, rad.
USUAL_POSITION = 1.0
# An angle that goes on and on is usual at a radian, whatever is said to be usual of it.
MOST_RAD = 1.0
# A parameter that is declared as next to nothing, in its own unit; one that is a force, as a share of the usual input.
LEAST_SIZE = 0.3


def rate_scale(plant: Plant, coordinate: str) -> float:
    """Rates of a coordinate over USUAL_SPEED: as its body's slot says, else as its scales do."""
    slots = [slot for slot in plant.slots.values() if slot.coordinate == coordinate]
    if slots:
        return max(speed_scale(slot) for slot in slots)
    return plant.scales.get(f"d{coordinate}", USUAL_SPEED) / USUAL_SPEED


def motion_scale(plant: Plant) -> float:
    """Times of the motion over those that the constants are written for.

    The usual way of the fastest coordinate over its usual rate; where nobody said a usual way, as slow as the sampling.
    Of an angle that turns by many radians the way is a radian.
    """
    ways = {q: plant.scales[q] for q in plant.coordinates if plant.scales.get(q)}
    ways |= {q: min(way, MOST_RAD) for q, way in ways.items() if not plant.is_length(q)}
    return min((way / USUAL_POSITION / rate_scale(plant, q) for q, way in ways.items()), default=time_scale(plant))


def state_scales(plant: Plant) -> Array:
    """(nx,) usual sizes of the states; 1 for an angle, and for a rate of 10 rad/s."""
    slower, found = motion_scale(plant), []
    for q in plant.coordinates:
        rate = rate_scale(plant, q)
        found += [plant.scales.get(q, rate * slower), rate]
    return np.array([*found, *(plant.scales.get(name, 1.0) for name in plant.first_order)])


def usual_sizes(plant: Plant) -> dict[str, float]:
    """Of states and inputs, by name."""
    states = dict(zip(plant.states, state_scales(plant).tolist(), strict=True))
    return states | {one.name: usual_of(plant, one) for one in plant.inputs}


def parameter_size(plant: Plant, name: str) -> float:
    """Usual size of a parameter: as it is declared; of one that is declared as nothing, a share of the forces'."""
    declared = abs(plant.values.get(name, 0.0))
    if plant.least_size is not None:
        return max(declared, plant.least_size)
    if declared > 0.0:
        return declared
    is_force = bool(plant.inputs) and plant.units.get(name) == plant.force_unit
    return LEAST_SIZE * plant.usual_input if is_force else LEAST_SIZE
