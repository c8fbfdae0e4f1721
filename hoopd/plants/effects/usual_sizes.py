"""Units and usual sizes of forces, rates and times on a plant, by its slots: what effects are scaled with.

Rules of this file: nothing here knows an effect.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import NamedTuple

import casadi as ca
import numpy as np

from hoopd.plants.declaration import Input, Plant, Slot

# What the sizes in the files of the slots are meant for: a drive of this many N m at this many rad/s, sampled each so
# many seconds (the hoop as it was when they were written). On a plant they follow its limit, its slot's usual rate and
# its time scale.
USUAL_LIMIT, USUAL_SPEED, USUAL_S = 0.7, 10.0, 0.02


class Units(NamedTuple):
    """Units of a plant whose coordinates are angles or lengths."""

    force: str
    coordinate: str
    rate: str
    drag: str


ANGLES = Units("N m", "rad", "rad/s", "N m s2")
LENGTHS = Units("N", "m", "m/s", "N s2/m2")


def units(plant: Plant, coordinate: str = "") -> Units:
    """Those of what happens on a coordinate (the first); where nobody said its unit, by the plant's force."""
    return LENGTHS if plant.is_length(coordinate or "".join(plant.coordinates[:1])) else ANGLES


def input_with_article(plant: Plant) -> str:
    """What the plant's first input is: a torque, a flow, an input."""
    word = plant.input_word
    return f"an {word}" if word == "input" else f"a {word}"


def state_unit(plant: Plant, name: str) -> str:
    """Of a coordinate, a rate or a first-order state."""
    if name in plant.first_order:
        return plant.units.get(name, "-")
    if name in plant.coordinates:
        return units(plant, name).coordinate
    return units(plant, name.removeprefix("d")).rate


def channel_unit(plant: Plant, name: str) -> str:
    """Of a channel, or of the rate of one."""
    if state := plant.state_of(name):
        return state_unit(plant, state)
    return plant.channels[name].unit if name in plant.channels else units(plant).rate


def of_kind(plant: Plant, kind: str) -> Iterator[tuple[str, Slot]]:
    """Names and slots of a kind, in the plant's order."""
    return ((name, slot) for name, slot in plant.slots.items() if slot.kind == kind)


def named(plant: Plant, kind: str, effect: str, coordinate: str, device: str = "") -> tuple[str, ...]:
    """`slot.effect` of each slot of a kind on a coordinate: partners in another slot."""
    return tuple(
        f"{name}.{effect}"
        for name, slot in of_kind(plant, kind)
        if slot.coordinate == coordinate and (not device or slot.device == device)
    )


def turns(plant: Plant, coordinate: str) -> bool:
    """Whether the body on a coordinate turns."""
    return any(slot.turns for _, slot in of_kind(plant, "body") if slot.coordinate == coordinate)


def force_scale(plant: Plant) -> float:
    """Forces of this plant over the hoop's."""
    return plant.usual_input / USUAL_LIMIT


def speed_scale(slot: Slot) -> float:
    """Rates of this slot over the hoop's."""
    return slot.speed / USUAL_SPEED


def time_scale(plant: Plant) -> float:
    """Times of this plant over the hoop's."""
    return plant.time_scale_s / USUAL_S


def store_rate(plant: Plant, name: str) -> float:
    """Usual rate of a first-order state: what its usual size, or an input's, changes in it."""
    x, u = ca.SX.sym("x", len(plant.states)), ca.SX.sym("u", max(1, len(plant.inputs)))
    usual = [plant.scales.get(one, 1.0) for one in plant.states]
    driven = [usual_of(plant, one) for one in plant.inputs] or [0.0]
    point = plant.point(x, plant.values, u if len(plant.inputs) > 1 else u[0])
    here = plant.rates(point)[plant.first_order.index(name)]
    slopes = ca.Function("slopes", [x, u], [ca.densify(ca.jacobian(here, ca.vertcat(x, u)))])(usual, driven)
    change = np.abs(slopes.full().ravel()) * np.abs([*usual, *driven])
    return (
        float(np.max(change[np.isfinite(change)], initial=0.0)) or usual[plant.states.index(name)] / plant.time_scale_s
    )


def usual_of(plant: Plant, one: Input) -> float:
    """Usual size of an input: its scale, else its limit, else one."""
    limit = inf if one.limit is None else one.limit
    return plant.scales.get(one.name, limit if limit < inf else 1.0)


def scaled(grid: tuple[float, ...], by: float) -> tuple[float, ...]:
    """A grid in another plant's sizes."""
    return grid if by == 1.0 else tuple(float(f"{one * by:.3g}") for one in grid)
