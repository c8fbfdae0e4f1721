"""Mechanisms: a site, a variable, a shape or a memory, and what the whole multiplies, as effects like all others.

    force, torque or reading += A shape(v) [factor]           `hoop.threshold_of_dtheta`, `actuator.square_of_t_on_u`
    force, torque or reading += A memory(v) [factor]          `ball.dahl_of_psi`, `actuator.heat_of_u_squared_on_u`

A name says everything: `mechanism_named` makes the effect of a name anew, so that model files need no more than names
and numbers. What takes energy from a motion has an amplitude that is not negative.

Rules of this file: laws come from `shapes` and `memories`, sites and axes from the plant; no search.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, log
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import DryFriction, Effect, EffectParameter, Point, phase
from hoopd.plants.effects.grammar.axes import (
    CLOCK,
    POSITION,
    RATE,
    Axis,
    demand,
    driving,
    losses,
    motions,
    position,
    power,
    rate,
    relative,
    state,
)
from hoopd.plants.effects.grammar.axes import FORCE as FORCE_KIND
from hoopd.plants.effects.grammar.memories import DAMPING, MEMORIES, MemoryLaw
from hoopd.plants.effects.grammar.shapes import ShapeLaw, shapes_of
from hoopd.plants.effects.usual_sizes import units

Array = NDArray[np.float64]

# Ways of acting.
FORCE, TORQUE, READING = "force", "torque", "reading"
# Of the demanded torque: after dead zone and limits, with ripple and gain.
TORQUE_ORDER = 3
# A memory follows its variable within a substep: so many are at least taken in a usual sample time.
MEMORY_SUBSTEPS = 5
# Usual size of a memory where a recording begins: known to be none.
NOTHING = 1e-6
# A library has some forty names; more mechanisms than these cost evidence, and so does each constant of theirs.
NAMED, NATS_A_CONSTANT = 40.0, 1.5

# Shapes that are never negative: a friction with such a factor takes energy away.
TAKING = ("square", "magnitude", "well")
# Shapes that a level of dry friction may have.
LEVELS = (*TAKING, "above", "below", "settling", "fading")


@dataclass(frozen=True)
class ActingPlace:
    """Where a mechanism acts: its slot, the way, and with which weight on which coordinate or channel."""

    slot: str
    acts: str
    on: Mapping[str, float]
    unit: str
    words: str = "a force"


@dataclass(frozen=True)
class Mechanism:
    """One law of the grammar.

    Attributes
    ----------
    site : ActingPlace
        Where it acts.
    axis : Axis
        The variable.
    shape : ShapeLaw, optional
        How it follows the variable; None where a memory does.
    memory : MemoryLaw, optional
        What it remembers of the variable.
    factor : Axis, optional
        What the whole multiplies.
    dissipates : bool
        It takes energy away: -A with A >= 0.
    dry : Axis, optional
        The rate that it opposes as dry friction, whose level it is; it sticks exactly.
    """

    site: ActingPlace
    axis: Axis
    shape: ShapeLaw | None = None
    memory: MemoryLaw | None = None
    factor: Axis | None = None
    dissipates: bool = False
    dry: Axis | None = None

    @property
    def _law(self) -> ShapeLaw | MemoryLaw:
        found = self.shape or self.memory
        assert found is not None
        return found

    @cached_property
    def name(self) -> str:
        """`slot.law_of_variable`, with `_on_factor` where it multiplies something."""
        more = f"_on_{self.factor.name}" if self.factor else f"_on_sign_{self.dry.name}" if self.dry else ""
        channel = f"_in_{next(iter(self.site.on))}" if self.site.acts == READING and len(self.site.on) == 1 else ""
        return f"{self.site.slot}.{self._law.name}_of_{self.axis.name}{more}{channel}".lower()

    @property
    def constants(self) -> tuple[str, ...]:
        """Names of those that are not proportional."""
        if self.shape is not None:
            return self.shape.constants
        assert self.memory is not None
        return (self.memory.constant, "zeta") if self.memory.states == 2 else (self.memory.constant,)

    @property
    def formula(self) -> str:
        """With its amplitude, as a page shows it."""
        text = self._law.text.format(v=self.axis.text)
        law, _, where = text.partition(", ")
        times = f" {self.factor.text}" if self.factor else f" sign({self.dry.text})" if self.dry else ""
        sign = "-A" if self.dissipates else "A"
        body = f"{sign}{times} {law}" if law else f"{sign}{times}"
        return f"{body}, {where}" if where else body

    @property
    def unit(self) -> str:
        """Of the amplitude."""
        power = self.shape.power if self.shape is not None else int(bool(self.memory and self.memory.scaled))
        below = [_to_the(power, self.axis.unit)] if power else []
        below += [self.factor.unit] if self.factor else []
        return self.site.unit if not below else f"{self.site.unit}/({' '.join(below)})"

    def grid(self, v: Array, t: Array) -> list[dict[str, float]]:
        """Constants that a search tries, from samples v (n,) at t (n,)."""
        if self.shape is not None:
            return [dict(one) for one in self.shape.grid(self.axis, v)]
        assert self.memory is not None
        more = {"zeta": DAMPING} if self.memory.states == 2 else {}
        return [{self.memory.constant: float(one), **more} for one in self.memory.grid(v, t)]

    def along(self, v: Array, way: Array, t: Array, constants: Mapping[str, float]) -> Array:
        """What is multiplied with amplitude and factor at samples, (n,); of a wave at phase zero."""
        if self.shape is not None:
            found = np.asarray(self.shape.of(np, v, constants))
        else:
            assert self.memory is not None
            found = self.memory.along(v, way, t, constants)
        return found if self.dry is None else np.maximum(found, 0.0)

    @property
    def sign(self) -> float:
        """Of the amplitude in the law."""
        return -1.0 if self.dissipates else 1.0

    # ------------------------------------------------------------------------------------------ the effect

    @cached_property
    def effect(self) -> Effect:
        """As an effect."""
        acts: dict[str, dict[str, Any]] = {
            FORCE: {"force": lambda s, e: self._spread(self._value(s, e))},
            TORQUE: {"torque": lambda s, e: s.u + self._value(s, e), "order": TORQUE_ORDER},
            READING: {"sensor": lambda s, e: self._spread(self._value(s, e))},
        }
        if self.dry is not None:
            acts[FORCE] = {"friction": DryFriction(self._level, lambda s: dict(self.site.on))}
        follows = [one.name for one in (self.axis, self.factor, self.dry) if one is not None]
        return Effect(
            self.name,
            tuple(self._parameters()),
            **acts[self.site.acts],
            plant=self._with_memory if self.memory is not None else None,
            substeps=MEMORY_SUBSTEPS if self.memory is not None else 0,
            depends_on=tuple(follows),
            needs=tuple(dict.fromkeys(q for one in (self.axis, self.factor, self.dry) if one for q in one.coordinates)),
            statement=self.sentence,
            sign="A >= 0: it takes energy away" if self.dissipates else "either sign",
            write_back="feed forward the formula where its variable is known; the estimator knows it",
            formula=self.formula,
            cost_nats=NATS_A_CONSTANT * len(self.constants),
        )

    @property
    def sentence(self) -> str:
        """In plain words."""
        if self.dry is not None:
            return f"dry friction whose level {self._law.words} {self.axis.words}"
        kind = {FORCE: self.site.words, TORQUE: "a torque of the drive", READING: "an error of the reading"}[
            self.site.acts
        ]
        times = f" in proportion to {self.factor.words}, with a factor" if self.factor is not None else ""
        return f"{kind}{times} that {self._law.words} {self.axis.words}"

    def _parameters(self) -> Iterator[EffectParameter]:
        low = 0.0 if self.dissipates or (self.shape is not None and self.shape.phased) else -inf
        yield EffectParameter("A", self.unit, 0.0, low, inf, grid=(1.0,))
        for name in self.constants:
            place = self.shape is not None and name == "v0" and self.shape.name in ("above", "below", "well", "detent")
            whole = name == "n" and self.axis.turning
            unit = self._unit_of(name)
            yield EffectParameter(name, unit, 1.0, -inf if place else 1e-9, inf, "shape", (1.0,), discrete=whole)
        if self.shape is not None and self.shape.phased:
            yield phase(per_recording=self.axis.turning)

    def _unit_of(self, name: str) -> str:
        if self.memory is not None:
            return "-" if name == "zeta" else self.memory.unit(self.axis)
        if name == "n":
            return "-" if self.axis.turning else f"rad/({self.axis.unit})"
        return self.axis.unit

    def _spread(self, value: Any) -> dict[str, Any]:
        return {name: weight * value for name, weight in self.site.on.items()}

    def _law_at(self, s: Point, e: Any) -> Any:
        v = self.axis.of(s)
        if self.shape is not None:
            return self.shape.of(ca, v, e.__dict__)
        assert self.memory is not None
        # where the plant is without the memory it is at rest
        states = [getattr(s, name) if name in s else 0.0 for name in self._states]
        return self.memory.value(ca, states, v)

    def _level(self, s: Point, e: Any) -> Any:
        return e.A * ca.fmax(self._law_at(s, e), 0.0)

    def _value(self, s: Point, e: Any) -> Any:
        found = self.sign * e.A * self._law_at(s, e)
        return found if self.factor is None else found * self.factor.of(s)

    @property
    def _states(self) -> tuple[str, ...]:
        assert self.memory is not None
        stem = self.name.replace(".", "_")
        return tuple(f"{stem}_z{i}" for i in range(self.memory.states))

    def _with_memory(self, plant: Plant) -> Plant:
        """The plant with the memory's states as its last ones."""
        memory, names = self.memory, self._states
        assert memory is not None
        constants, shortest = self.constants, plant.time_scale_s / MEMORY_SUBSTEPS

        def rates(s: Point) -> Any:
            own = {name: s.p[f"{self.name}.{name}"] for name in constants}
            v, dv = self.axis.of(s), self.axis.rate(s) if self.axis.rate is not None else 0.0
            found = memory.rates(ca, [getattr(s, name) for name in names], v, dv, own, shortest)
            return ca.vertcat(plant.rates(s), *found)

        # every recording begins with nothing remembered, whatever the readings say
        scales = {**plant.scales, **dict.fromkeys(names, NOTHING)}
        return replace(plant, first_order=(*plant.first_order, *names), rates=rates, scales=scales)


# ---------------------------------------------------------------------------------------------- which there are


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
    for name, slot in plant.slots.items():
        for one in _of_slot(plant, name, slot):
            found.setdefault(one.name, one)
    return found


def mechanism_named(plant: Plant, name: str) -> Effect | None:
    """The effect of a name of the grammar; None where the plant has none of this name."""
    found = mechanisms(plant).get(name)
    return None if found is None else found.effect


def _to_the(power: float, unit: str) -> str:
    if power == 0.5:
        return f"sqrt({unit})"
    return unit if power == 1 else f"{unit}^{power:g}"


def code_nats(count: int) -> float:
    """What it costs to say which of so many mechanisms it is, beyond what a library's name costs."""
    return max(0.0, log(max(count, 1) / NAMED))


def _of_slot(plant: Plant, name: str, slot: Slot) -> Iterator[Mechanism]:
    if slot.kind == "body" and slot.coordinate:
        yield from _of_body(plant, ActingPlace(name, FORCE, {slot.coordinate: 1.0}, plant.force_unit), slot.coordinate)
    elif slot.kind == "store":
        yield from _of_store(plant, name, slot.coordinate)
    elif slot.kind == "rolling_ball":
        yield from _of_rolling(plant, name, slot.coordinate)
    elif slot.kind == "actuator" and plant.inputs:
        yield from _of_actuator(plant, name, slot.coordinate)
    elif slot.kind == "sensor":
        yield from _of_sensor(plant, name, slot)


def _of_body(plant: Plant, site: ActingPlace, q: str) -> Iterator[Mechanism]:
    own = rate(plant, q)
    for axis in (*motions(plant, q), *_own_axes(plant, site.slot)):
        yield from _followed(site, axis, own)
        # friction whose coefficient follows it
        for shape in _coefficients(axis):
            yield Mechanism(site, axis, shape, factor=own, dissipates=shape.name in TAKING)
    yield from _dry(plant, site, q, (*motions(plant, q), *_own_axes(plant, site.slot)), own)
    yield from (Mechanism(site, CLOCK, shape) for shape in shapes_of(CLOCK))
    yield from (
        Mechanism(site, CLOCK, shape, factor=own)
        for shape in shapes_of(CLOCK)
        if shape.name not in ("settling", "fading")
    )
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
    memories = _memories("wear", "fading", "reversal")
    place = position(plant, q)
    yield from (Mechanism(site, place, memory=m, dissipates=True, dry=own) for m in memories if POSITION in m.kinds)
    if plant.inputs:
        for axis in losses(plant, q):
            yield from (Mechanism(site, axis, memory=m, dissipates=True, dry=own) for m in _memories("heat"))


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
    yield from _of_body(plant, ActingPlace(name, FORCE, {q: 1.0}, plant.force_unit), q)
    others = [one for one in plant.coordinates if one != q]
    pair = ActingPlace(name, FORCE, {q: 1.0, **dict.fromkeys(others, -1.0)}, plant.force_unit)
    for other in others:
        yield from _between(plant, pair, q, other)


def _between(plant: Plant, site: ActingPlace, q: str, other: str) -> Iterator[Mechanism]:
    place, speed = relative(plant, q, other)
    mine, its = _paired(place), _paired(speed)
    for shape in shapes_of(mine):
        yield Mechanism(site, mine, shape)
    for shape in shapes_of(its):
        if shape.name != "linear":
            yield Mechanism(site, its, shape, dissipates=shape.odd)
    own = (position(plant, q), position(plant, other), place, rate(plant, q), rate(plant, other), CLOCK)
    for axis in (*own, *_own_axes(plant, site.slot)):
        for shape in _coefficients(axis):
            yield Mechanism(site, _paired(axis), shape, factor=speed, dissipates=shape.name in TAKING)
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
    names = (*TAKING, "threshold", "above", "below", "wave", "linear")
    return [one for one in shapes_of(axis) if one.name in names]


def _of_actuator(plant: Plant, name: str, q: str) -> Iterator[Mechanism]:
    first = demand(plant)
    site = ActingPlace(name, TORQUE, {q: 1.0}, first.unit)
    if not q:
        return
    for shape in shapes_of(first):
        if shape.name not in ("linear", "threshold", "saturation"):
            yield Mechanism(site, first, shape)
    for memory in MEMORIES:
        if first.kind in memory.kinds and memory.name in ("lag", "resonance"):
            yield Mechanism(site, first, memory=memory)
    factors = [rate(plant, q), position(plant, q), power(plant, q), CLOCK]
    for axis in factors:
        for shape in shapes_of(axis):
            # a ripple is in the library
            if not (axis.kind == POSITION and shape.name == "wave"):
                yield Mechanism(site, axis, shape, factor=first)
    drives = driving(plant, q)
    for memory in _memories("wear", "reversal"):
        axis = position(plant, q) if POSITION in memory.kinds else drives
        yield Mechanism(site, axis, memory=memory, factor=first)
    for axis in losses(plant, q):
        yield from (Mechanism(site, axis, memory=memory, factor=first) for memory in _memories("heat"))


def _of_store(plant: Plant, name: str, own: str) -> Iterator[Mechanism]:
    """What is missing in the rate of a first-order state."""
    site = ActingPlace(name, FORCE, {own: 1.0}, plant.disturbance_unit(own), f"a flow into {own}")
    others = [state(plant, one) for one in plant.first_order if one != own]
    moving = [axis for q in plant.coordinates for axis in (position(plant, q), rate(plant, q))]
    for axis in (state(plant, own), *others, *moving, *([demand(plant)] if plant.inputs else ()), CLOCK):
        for shape in shapes_of(axis):
            # its own loss is in the library
            if not (axis.name == own and shape.name == "linear"):
                yield Mechanism(site, axis, shape)


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


def _memories(*names: str) -> Sequence[MemoryLaw]:
    return [one for one in MEMORIES if one.name in names]
