"""Which curves a plant suggests: where one may act, what it may depend on, and what it may multiply.

Rules of this file: slots, states and channels come from the declared plant, no name of a hoop stands here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import pi
from typing import Any, NamedTuple

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import Point
from hoopd.plants.effects.usual_sizes import turns, units


class CurveVariable(NamedTuple):
    """What a curve depends on."""

    name: str
    unit: str
    of: Callable[[Point], Any]
    period: float | None = None
    own_zero: bool = False  # its zero may differ from recording to recording


class Site(NamedTuple):
    """Where a curve acts."""

    slot: str
    acts: str  # force, torque, reading
    on: Mapping[str, float]  # weights by coordinate, or by channel
    unit: str


class Factor(NamedTuple):
    """What the curve multiplies."""

    name: str
    unit: str
    of: Callable[[Point], Any]


Wanted = tuple[Site, CurveVariable, Factor | None]


def wanted(plant: Plant) -> Iterator[Wanted]:
    """Sites, variables and factors of a plant."""
    kinds: dict[str, Callable[[Plant, str, Slot], Iterator[Wanted]]] = {
        "body": _of_body, "rolling_ball": _of_ball, "actuator": _of_actuator, "push": _of_push, "store": _of_store,
        "sensor": _of_sensor,
    }  # fmt: skip
    for name, slot in plant.slots.items():
        if not slot.coordinate:
            yield from _of_plain_sensor(plant, name, slot) if slot.kind == "sensor" else ()
        elif slot.kind in kinds:
            yield from kinds[slot.kind](plant, name, slot)


def state(plant: Plant, name: str) -> CurveVariable:
    """A state of the plant as a variable: the angle of a turning body comes back after a turn."""
    names = units(plant)
    if name in plant.first_order:
        return CurveVariable(name, plant.units.get(name, "-"), lambda s: getattr(s, name))
    if name not in plant.coordinates:
        return CurveVariable(name, names.rate, lambda s: getattr(s, name))
    turning = turns(plant, name)
    return CurveVariable(name, names.coordinate, lambda s: getattr(s, name), 2 * pi if turning else None, turning)


def wound(plant: Plant, name: str) -> CurveVariable:
    """The angle of a turning body over all its turns."""
    return CurveVariable(name, units(plant).coordinate, lambda s: getattr(s, name))


TIME = CurveVariable("t", "s", lambda s: s.t)
DEMAND = "u"


def _demand(plant: Plant) -> CurveVariable:
    return CurveVariable(DEMAND, plant.force_unit, lambda s: s.u)


def reads(want: Wanted, plant: Plant) -> tuple[str, ...]:
    """Coordinates of a plant that variable and factor are made of."""
    _, variable, factor = want
    names = (variable.name + ("" if factor is None else f" {factor.name}")).replace("-", " ").replace("*", " ").split()
    return tuple(q for q in plant.coordinates if q in names or f"d{q}" in names)


def _as_factor(variable: CurveVariable) -> Factor:
    return Factor(variable.name, variable.unit, variable.of)


def _of_body(plant: Plant, name: str, slot: Slot) -> Iterator[Wanted]:
    q = slot.coordinate
    site = Site(name, "force", {q: 1.0}, plant.disturbance_unit(q))
    rate = state(plant, f"d{q}")
    for one in (rate, state(plant, q), *_others(plant, q)):
        yield site, one, None
    if turns(plant, q):
        yield site, wound(plant, q), None
    # a viscous coefficient that changes
    for one in (state(plant, q), TIME):
        yield site, one, _as_factor(rate)


def _others(plant: Plant, own: str) -> list[CurveVariable]:
    """States of the other coordinates."""
    return [state(plant, name) for name in plant.states if name.removeprefix("d") != own and name != own]


def _of_ball(plant: Plant, name: str, slot: Slot) -> Iterator[Wanted]:
    q, others = slot.coordinate, [c for c in plant.coordinates if c != slot.coordinate]
    along = Site(name, "force", {q: 1.0, **dict.fromkeys(others, -1.0)}, plant.disturbance_unit(q))
    names = [f"d{c}" for c in (*others, q)]
    rolling = CurveVariable("-".join(names), "rad/s", lambda s: _difference([getattr(s, n) for n in names]))
    own = Site(name, "force", {q: 1.0}, plant.disturbance_unit(q))
    if others:
        yield along, rolling, None
    for one in (state(plant, f"d{q}"), state(plant, q)):
        yield own, one, None
    for one in (state(plant, q), TIME):
        yield along, one, _as_factor(rolling)
    if not any(slot.kind == "push" and slot.coordinate == q for slot in plant.slots.values()):
        yield own, TIME, None


def _difference(terms: Sequence[Any]) -> Any:
    return terms[0] - terms[1] if len(terms) > 1 else terms[0]


def _of_actuator(plant: Plant, name: str, slot: Slot) -> Iterator[Wanted]:
    site, demand, q = Site(name, "torque", {slot.coordinate: 1.0}, plant.force_unit), _demand(plant), slot.coordinate
    yield site, demand, None
    # a gain that changes with the rate, the angle, the time, and with whether the drive pushes or brakes
    for one in (state(plant, f"d{q}"), state(plant, q), TIME, _power(plant, q)):
        yield site, one, _as_factor(demand)


def _power(plant: Plant, q: str) -> CurveVariable:
    """What the demand gives to the motion: negative while it brakes, as after every reversal."""
    unit = "W" if plant.force_unit in ("N", "N m") else f"{plant.force_unit} {units(plant, q).rate}"
    return CurveVariable(f"{DEMAND}*d{q}", unit, lambda s: s.u * getattr(s, f"d{q}"))


def _of_push(plant: Plant, name: str, slot: Slot) -> Iterator[Wanted]:
    yield Site(name, "force", {slot.coordinate: 1.0}, plant.disturbance_unit(slot.coordinate)), TIME, None


def _of_store(plant: Plant, name: str, slot: Slot) -> Iterator[Wanted]:
    """What is missing in the rate of a first-order state: over itself, the others, the input and the time."""
    site = Site(name, "force", {slot.coordinate: 1.0}, plant.disturbance_unit(slot.coordinate))
    others = [state(plant, one) for one in plant.states if one != slot.coordinate]
    for one in (state(plant, slot.coordinate), *others, *([_demand(plant)] if plant.inputs else ()), TIME):
        yield site, one, None


def _of_sensor(plant: Plant, name: str, slot: Slot) -> Iterator[Wanted]:
    q = slot.coordinate
    for channel in slot.channels:
        if channel not in plant.channels:
            continue
        site = Site(name, "reading", {channel: 1.0}, state(plant, plant.state_of(channel)).unit)
        for one in (state(plant, q), state(plant, f"d{q}"), TIME):
            yield site, one, None
        if plant.state_of(channel) == q:
            # late by a time that changes with the rate or the position
            yield site, state(plant, q), _as_factor(state(plant, f"d{q}"))


def _of_plain_sensor(plant: Plant, name: str, slot: Slot) -> Iterator[Wanted]:
    """A sensor of a first-order state: its scale and its zero over time."""
    for channel in slot.channels:
        if not (read := plant.state_of(channel)):
            continue
        site = Site(name, "reading", {channel: 1.0}, state(plant, read).unit)
        for one in (state(plant, read), TIME):
            yield site, one, None
