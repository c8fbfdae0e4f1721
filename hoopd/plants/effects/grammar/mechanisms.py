"""Which mechanisms a plant suggests: by its slots, along the signal path, each with a name of its own.

A name says everything: `mechanism_named` makes the effect of a name anew, so that model files need no more than names
and numbers.

Rules of this file: sites and axes come from the plant; no law, no search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import log

import casadi as ca

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.axes import (
    CLOCK,
    FORCE as FORCE_KIND,
    POSITION,
    RATE,
    Axis,
    demand,
    drawn,
    driving,
    losses,
    motions,
    position,
    power,
    rate,
    relative,
    size,
    squared,
    state,
)
from hoopd.plants.effects.grammar.mechanism import (
    FORCE,
    READING,
    TORQUE,
    ActingPlace,
    Mechanism,
    shortest_time_s,
)
from hoopd.plants.effects.grammar.memories import MEMORIES, ONE_WAY
from hoopd.plants.effects.grammar.memory_law import MemoryLaw
from hoopd.plants.effects.grammar.shapes import BEAT, BENTS, HUM, LENS, STEPS, WAVE, ShapeLaw, shapes_of
from hoopd.plants.effects.grammar.textbook import textbook_names
from hoopd.plants.effects.usual_sizes import input_with_article, units

# A library has some forty names; more mechanisms than these cost evidence.
NAMED = 40.0
# Shapes that are never negative: a friction with such a factor takes energy away.
TAKING = ("square", "magnitude", "well")
# Shapes that a level of dry friction may have.
LEVELS = (*TAKING, "above", "below", "settling", "fading")
# Shapes that a loss of a store may have over the time.
LOSSES = ("linear", "above", "settling", "fading")
# The device of a sensor that looks at nothing.
ENCODER = "encoder"


def mechanisms(plant: Plant) -> dict[str, Mechanism]:
    """All that the slots of a plant suggest, by name, each with what it costs: the more there are, the more.

    Parameters
    ----------
    plant : Plant
        A declaration.

    Returns
    -------
    dict of str to Mechanism
        In the order of the plant's slots.

    Examples
    --------
    >>> from hoopd.plants.effects.grammar.mechanisms import mechanisms
    >>> from hoopd.plants.registry import plant_named
    >>> mechanisms(plant_named("pendulum"))["body.dahl_of_alpha"].formula
    "-A z, z' = (alpha' - |alpha'| z)/xs"
    """
    found: dict[str, Mechanism] = {}
    textbooks = textbook_names(plant)
    for name, slot in plant.slots.items():
        for one in _of_slot(plant, name, slot):
            found.setdefault(one.name, replace(one, textbook=one.name in textbooks, shortest_s=shortest_time_s(plant)))
    return found


def mechanism_named(plant: Plant, name: str) -> Effect | None:
    """The effect of a name of the grammar; None where the plant has none of this name."""
    found = mechanisms(plant).get(name)
    if found is None and plant.ratios:
        # a file of before anybody looked for ratios
        found = mechanisms(replace(plant, ratios={})).get(name)
    return None if found is None else found.effect


def code_nats(count: int) -> float:
    """What it costs to say which of so many mechanisms it is, beyond what a name or a textbook's law costs."""
    return max(0.0, log(max(count, 1) / NAMED))


def _of_slot(plant: Plant, name: str, slot: Slot) -> Iterator[Mechanism]:
    if slot.kind == "body" and slot.coordinate:
        yield from _of_body(plant, _forced(plant, name, slot.coordinate), slot.coordinate)
        yield from _coupled(plant, name, slot.coordinate)
    elif slot.kind == "store":
        yield from _of_store(plant, name, slot.coordinate)
    elif slot.kind == "rolling_ball":
        yield from _of_rolling(plant, name, slot.coordinate)
    elif slot.kind == "actuator" and plant.inputs:
        yield from _of_actuator(plant, name, plant.moved_by(slot))
    elif slot.kind == "sensor":
        yield from _of_sensor(plant, name, slot)


def _forced(plant: Plant, name: str, q: str) -> ActingPlace:
    """A force on one coordinate."""
    return ActingPlace(name, FORCE, {q: 1.0}, plant.disturbance_unit(q))


def _of_body(plant: Plant, site: ActingPlace, q: str) -> Iterator[Mechanism]:
    own = rate(plant, q)
    for axis in (*motions(plant, q), *_own_axes(plant, site.slot)):
        yield from _followed(site, axis, own)
        # friction whose coefficient follows it
        for shape in _coefficients(axis):
            yield Mechanism(site, axis, shape, factor=own, dissipates=shape.name in TAKING)
    yield from _dry(plant, site, q, (*motions(plant, q), *_own_axes(plant, site.slot)), own)
    yield from _one_way(site, position(plant, q), own)
    yield from (Mechanism(site, own, memory=memory, dissipates=True) for memory in _memories("swing", "loose"))
    yield from (Mechanism(site, CLOCK, shape) for shape in shapes_of(CLOCK))
    yield from (
        Mechanism(site, CLOCK, shape, factor=own)
        for shape in shapes_of(CLOCK)
        if shape.name not in ("settling", "fading")
    )
    yield from (Mechanism(site, CLOCK, shape, factor=own) for shape in STEPS)
    for memory in _memories("wear"):
        yield Mechanism(site, position(plant, q), memory=memory, factor=own)
    if plant.inputs:
        for axis in losses(plant, q):
            yield from (Mechanism(site, axis, memory=memory, factor=own) for memory in _memories("heat"))


def _dry(plant: Plant, site: ActingPlace, q: str, axes: Sequence[Axis], own: Axis) -> Iterator[Mechanism]:
    """Dry friction whose level follows something else than the rate that it opposes."""
    for axis in (*axes, CLOCK):
        if axis.name != own.name:
            names = LEVELS if axis.kind != FORCE_KIND else (*LEVELS, "linear")
            for shape in shapes_of(axis):
                if shape.name in names or (axis is CLOCK and shape.name == "linear"):
                    yield Mechanism(site, axis, shape, dissipates=True, dry=own)
    yield from (Mechanism(site, CLOCK, shape, dissipates=True, dry=own) for shape in STEPS)
    memories = _memories("wear", "fading", "reversal", "age")
    place = position(plant, q)
    yield from (Mechanism(site, place, memory=m, dissipates=True, dry=own) for m in memories if POSITION in m.kinds)
    if plant.inputs:
        for axis in losses(plant, q):
            yield from (Mechanism(site, axis, memory=m, dissipates=True, dry=own) for m in _memories("heat"))


def _one_way(site: ActingPlace, place: Axis, own: Axis) -> Iterator[Mechanism]:
    """Dry friction at one place, against motion of one sign alone."""
    for shape in shapes_of(place):
        if shape.name == "well":
            yield from (Mechanism(site, place, shape, dissipates=True, dry=own, way=way) for way in (1, -1))


def _followed(site: ActingPlace, axis: Axis, own: Axis) -> Iterator[Mechanism]:
    """Forces that follow one axis."""
    for shape in shapes_of(axis):
        mine = axis.coordinates == own.coordinates and axis.kind == RATE
        known = mine and shape.name in ("linear", "quadratic")
        if not known:
            yield Mechanism(site, axis, shape, dissipates=mine and shape.odd)
    for memory in MEMORIES:
        if axis.kind in memory.kinds and memory.name in ("dahl", "play", "lag", "resonance"):
            yield Mechanism(site, axis, memory=memory, dissipates=memory.dissipates)


def _of_rolling(plant: Plant, name: str, q: str) -> Iterator[Mechanism]:
    """Forces on the ball alone, and those between it and what it rolls in."""
    yield from _of_body(plant, _forced(plant, name, q), q)
    others = [one for one in plant.coordinates if one != q]
    pair = ActingPlace(name, FORCE, {q: 1.0, **dict.fromkeys(others, -1.0)}, plant.disturbance_unit(q))
    for other in others:
        yield from _between(plant, pair, q, other)


def _coupled(plant: Plant, name: str, q: str) -> Iterator[Mechanism]:
    """Forces between this body and those after it, of a plant whose bodies are joined and do not roll in each other."""
    if any(slot.kind == "rolling_ball" for slot in plant.slots.values()):
        return
    for other in plant.coordinates[plant.coordinates.index(q) + 1 :]:
        r = plant.ratio(q, other)
        axes = [_paired(axis) for axis in relative(plant, q, other)]
        if axes and _is_joined(plant, q, other):
            kind = "force" if plant.is_length(q) else "torque"
            words = f"a {kind} between {q} and {other}"
            pair = ActingPlace(name, FORCE, {q: 1.0, other: -r}, plant.disturbance_unit(q), words)
            place, speed = axes
            if r == 1.0:
                # what twists a shaft does not come back after a turn
                place = replace(place, words=f"the difference of {q} and {other}", turning=False)
                speed = replace(speed, words=f"the difference of the speeds of {q} and {other}")
            yield from (Mechanism(pair, place, shape) for shape in shapes_of(place))
            for shape in shapes_of(speed):
                yield Mechanism(pair, speed, shape, dissipates=shape.odd)
            for memory in _memories("dahl", "play"):
                yield Mechanism(pair, place, memory=memory, dissipates=memory.dissipates)


def _is_joined(plant: Plant, q: str, other: str) -> bool:
    """Whether each of two bodies is moved by where, or how fast, the other one is, by whatever numbers."""
    x, given = ca.SX.sym("x", len(plant.states)), [0.0] * len(plant.inputs)
    u, any_values = given if len(given) > 1 else sum(given), {name: ca.SX.sym(name) for name in plant.values}
    found = plant.accelerations(plant.point(x, any_values, u, 0.0), ca.SX.zeros(len(plant.coordinates)))
    by_state = ca.DM.ones(ca.jacobian(ca.densify(found), x).sparsity()).full() != 0.0
    row = {one: plant.coordinates.index(one) for one in (q, other)}
    return all(by_state[row[one], 2 * row[its] : 2 * row[its] + 2].any() for one, its in ((q, other), (other, q)))


def _between(plant: Plant, site: ActingPlace, q: str, other: str) -> Iterator[Mechanism]:
    place, speed = relative(plant, q, other)
    mine, its = _paired(place), _paired(speed)
    for shape in shapes_of(mine):
        yield Mechanism(site, mine, shape)
    for shape in shapes_of(its):
        if shape.name != "linear":
            yield Mechanism(site, its, shape, dissipates=shape.odd)
    own = (position(plant, q), position(plant, other), place, rate(plant, q), rate(plant, other), CLOCK)
    for axis in _own_axes(plant, site.slot):
        if axis.kind == POSITION:
            yield from (Mechanism(site, _paired(axis), shape) for shape in shapes_of(axis))
    for axis in (*own, *_own_axes(plant, site.slot)):
        for shape in _coefficients(axis):
            yield Mechanism(site, _paired(axis), shape, factor=speed, dissipates=shape.name in TAKING)
        # a place that rubs
        wells = (shape for shape in shapes_of(axis) if shape.name == "well" and axis.kind == POSITION)
        yield from (Mechanism(site, _paired(axis), shape, dissipates=True, dry=speed) for shape in wells)
    yield from (Mechanism(site, _paired(CLOCK), shape, factor=speed) for shape in STEPS)
    yield from (Mechanism(site, mine, memory=memory, factor=speed) for memory in _memories("wear"))
    for memory in _memories("dahl", "play"):
        yield Mechanism(site, mine, memory=memory, dissipates=memory.dissipates)


def _paired(axis: Axis) -> Axis:
    """The same variable, in the name of what acts on both of two bodies."""
    return replace(axis, name=f"{axis.name}_pair")


def _own_axes(plant: Plant, slot: str) -> Sequence[Axis]:
    return () if plant.own_axes is None else tuple(plant.own_axes(plant, slot))


def _coefficients(axis: Axis) -> list[ShapeLaw]:
    """Shapes that a friction's coefficient may have."""
    names = (*TAKING, "threshold", "above", "below", "linear", *(() if axis.scale_share else ("wave",)))
    return [one for one in shapes_of(axis) if one.name in names]


def _of_actuator(plant: Plant, name: str, q: str) -> Iterator[Mechanism]:
    """Of an input that is a force on a coordinate, or that goes where the equations have it; `q`: what it moves."""
    first = demand(plant)
    words = f"{input_with_article(plant)} of the drive"
    site = ActingPlace(name, TORQUE, {plant.driven or plant.inputs[0].name: 1.0}, first.unit, words)
    for shape in shapes_of(first):
        if shape.name not in ("linear", "threshold", "saturation"):
            yield Mechanism(site, first, shape)
    for memory in MEMORIES:
        if first.kind in memory.kinds and (memory.name in ("lag", "resonance", "hesitation") or memory in ONE_WAY):
            yield Mechanism(site, first, memory=memory)
    factors = [rate(plant, q), position(plant, q), power(plant, q)] if q else []
    stores = [] if plant.driven else [state(plant, one) for one in plant.first_order]
    for axis in (*factors, *stores, CLOCK):
        for shape in shapes_of(axis):
            # a ripple is in the library
            if not (axis.kind == POSITION and shape.name == "wave"):
                yield Mechanism(site, axis, shape, factor=first)
    yield from (Mechanism(site, CLOCK, shape, factor=first) for shape in STEPS)
    if q:
        drives = driving(plant, q)
        for memory in _memories("wear", "reversal"):
            axis = position(plant, q) if POSITION in memory.kinds else drives
            yield Mechanism(site, axis, memory=memory, factor=first)
    for axis in losses(plant, q):
        yield from (Mechanism(site, axis, memory=memory, factor=first) for memory in _memories("heat"))
    if q:
        yield from (Mechanism(site, drawn(plant, q), memory=memory, factor=first) for memory in _memories("lag"))
    yield from (Mechanism(site, size(plant), memory=memory, factor=first) for memory in _memories("lag"))


def _of_store(plant: Plant, name: str, own: str) -> Iterator[Mechanism]:
    """What is missing in the rate of a first-order state."""
    site = ActingPlace(name, FORCE, {own: 1.0}, plant.disturbance_unit(own), f"a flow into {own}")
    others = [state(plant, one) for one in plant.first_order if one != own]
    moving = [axis for q in plant.coordinates for axis in (position(plant, q), rate(plant, q))]
    for axis in (state(plant, own), *others, *moving, *([demand(plant)] if plant.inputs else ()), CLOCK):
        for shape in shapes_of(axis):
            # its own loss is in the library
            if not (axis.name == own and shape.name == "linear"):
                yield Mechanism(site, axis, HUM if axis is CLOCK and shape is WAVE else shape)
    yield from _of_loss(plant, site, state(plant, own))


def _of_loss(plant: Plant, site: ActingPlace, own: Axis) -> Iterator[Mechanism]:
    """A loss whose coefficient changes: with the time, and with the heat that it makes itself (a winding, a fluid)."""
    for shape in shapes_of(CLOCK):
        if shape.name in LOSSES:
            yield Mechanism(site, CLOCK, shape, factor=own)
    yield from (Mechanism(site, CLOCK, shape, factor=own) for shape in STEPS)
    yield from (Mechanism(site, squared(own), memory=memory, factor=own) for memory in _memories("heat"))


def _of_sensor(plant: Plant, name: str, slot: Slot) -> Iterator[Mechanism]:
    for channel in slot.channels:
        read = plant.state_of(channel)
        if not read:
            continue
        q = read.removeprefix("d") if read.removeprefix("d") in plant.coordinates else ""
        own = [position(plant, q), rate(plant, q)] if q else [state(plant, read)]
        site = ActingPlace(name, READING, {channel: 1.0}, plant.channels[channel].unit or units(plant, q).coordinate)
        for axis in (*own, CLOCK):
            for shape in shapes_of(axis):
                if not (axis.kind == POSITION and axis.turning and shape.name == "wave"):
                    yield Mechanism(site, axis, shape)
            for memory in MEMORIES:
                if axis.kind in memory.kinds and memory.name in ("dahl", "play") and read == q:
                    yield Mechanism(site, axis, memory=memory)
        yield from (Mechanism(site, CLOCK, shape) for shape in STEPS)
        if read == q:
            yield from _of_reading(plant, site, q)


def _of_reading(plant: Plant, site: ActingPlace, q: str) -> Iterator[Mechanism]:
    """Of a place that is read: an image that is bent about a centre of its own, an age that is not constant, and what
    the first input twists before the sensor."""
    place, speed = position(plant, q), rate(plant, q)
    yield Mechanism(site, place, BENTS[place.turning])
    if place.unit == "rad" and plant.slots[site.slot].device != ENCODER:  # what counts lines has no image
        yield Mechanism(site, place, LENS)
    # an image that is read line by line is the older the farther down: of a circle by a square, or a wave of the angle
    lines = ("wave",) if place.turning else ("linear", "magnitude", "square")
    for axis, names in ((place, lines), (CLOCK, ("linear", "wave"))):
        yield from (Mechanism(site, axis, shape, factor=speed) for shape in shapes_of(axis) if shape.name in names)
    yield Mechanism(site, CLOCK, BEAT, factor=speed)
    if plant.inputs and plant.inputs[0].coordinate == q:
        yield from (Mechanism(site, demand(plant), memory=memory) for memory in _memories("twist"))


def _memories(*names: str) -> Sequence[MemoryLaw]:
    return [one for one in MEMORIES if one.name in names]
