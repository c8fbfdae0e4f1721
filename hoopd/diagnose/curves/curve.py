"""Curves: unknown forces, torque maps and sensor maps that depend on one variable, as effects made on the fly.

A curve adds g(s) sum_i c_i hat_i(x(s)) at a slot: x is the variable it depends on, g is 1 or, for a coefficient that
follows x (friction that changes with the angle, a gain that changes with the speed), the rate or the torque it
multiplies. Every c_i is an amplitude, so that screen, fit, free run and held-out test take a curve like any effect.

Rules of this file: slots, states and channels come from the declared plant, no name of a hoop stands here; knots come
from the fit's smoothed reference.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.hats import curve_expression, spread_knots, turn_knots
from hoopd.diagnose.engine.fitting import Fit
from hoopd.diagnose.engine.track import Track
from hoopd.physics.declared import DeclaredPlant, Slot
from hoopd.physics.effects.base import Effect, EffectParameter, Point
from hoopd.physics.effects.slots import turns, units

Array = NDArray[np.float64]

# Knots of a coarse and a fine curve: a smooth law needs few columns, a local one (a detent) needs narrow hats.
COARSE, FINE = 6, 16
TURN_COARSE, TURN_FINE = 8, 20
# Of a curve over time, one knot in so many seconds: slower than any disturbance's correlation time.
SECONDS_A_KNOT = 3.0
# Fewer knots than this are a line, which the base's parameters are already.
FEWEST = 3
# Maps of the torque: after dead zone and limits, with ripple and gain (`effects.base`).
TORQUE_ORDER = 3


class Variable(NamedTuple):
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


@dataclass(frozen=True)
class Curve:
    """One curve; amplitudes are the values at its knots, or with a `basis` (m, k) those of its columns."""

    site: Site
    variable: Variable
    knots: Array
    factor: Factor | None = None
    per_recording: bool = False
    basis: Array | None = None
    coordinates: tuple[str, ...] = ()  # of the plant that it was made for

    @property
    def slot(self) -> str:
        """Where it sits."""
        return self.site.slot

    @property
    def depends_on(self) -> tuple[str, ...]:
        """The variable, and what it multiplies."""
        return (self.variable.name,) if self.factor is None else (self.factor.name, self.variable.name)

    @property
    def unit(self) -> str:
        """Of the values at the knots."""
        return self.site.unit if self.factor is None else f"{self.site.unit} / ({self.factor.unit})"

    @cached_property
    def name(self) -> str:
        """Of its effect; equal for equal curves only."""
        parts = [self.knots.tobytes(), b"" if self.basis is None else self.basis.tobytes()]
        parts += [repr((self.site, self.variable[:2], self.variable.period, self.per_recording)).encode()]
        mark = hashlib.sha256(b"|".join(parts)).hexdigest()[:8]
        return f"{self.slot}.curve_{'_'.join(self.depends_on)}_{mark}"

    @cached_property
    def effect(self) -> Effect:
        """The curve as an effect."""
        acts: dict[str, dict[str, Any]] = {
            "force": {"force": lambda s, e: self._spread(self._value(s, e))},
            "torque": {"torque": lambda s, e: s.u + self._value(s, e), "order": TORQUE_ORDER},
            "reading": {"sensor": lambda s, e: self._spread(self._value(s, e))},
        }
        count = len(self.knots) if self.basis is None else self.basis.shape[1]
        return Effect(
            self.name,
            tuple(self._parameter(i) for i in range(count)),
            **acts[self.site.acts],
            depends_on=self.depends_on,
            statement=f"a force or error that follows {' and '.join(self.depends_on)}, by no law of the library",
        )

    def _parameter(self, index: int) -> EffectParameter:
        unit, size = (self.unit, 0.01) if self.basis is None else ("-", 1.0)
        return EffectParameter(
            f"c{index}", unit, 0.0, -1e4 * size, 1e4 * size, grid=(size,), per_recording=self.per_recording
        )

    def _value(self, s: Point, e: Any) -> Any:
        amplitudes = ca.vertcat(*(getattr(e, f"c{i}") for i in range(len(e.__dict__))))
        values = amplitudes if self.basis is None else ca.mtimes(ca.DM(self.basis), amplitudes)
        found = curve_expression(self.variable.of(s), self.knots, values, self.variable.period)
        return found if self.factor is None else found * self.factor.of(s)

    def _spread(self, value: Any) -> dict[str, Any]:
        return {name: weight * value for name, weight in self.site.on.items()}

    def with_basis(self, basis: Array) -> Curve:
        """The same with the columns of a basis (m, k) for amplitudes."""
        return replace(self, basis=basis)

    def fits(self, plant: DeclaredPlant) -> bool:
        """Whether a plant has its slot, and everything that moves where it was made."""
        return self.slot in plant.slots and all(q in plant.coordinates for q in self.coordinates)


def curves(fit: Fit, plant: DeclaredPlant | None = None) -> list[Curve]:
    """All that the slots of a plant suggest (default: the one in which most moves), knots from the fit's reference."""
    plant = plant or max((track.stretch.plant for track in fit.tracks), key=lambda one: len(one.coordinates))
    tracks = [track for track in fit.tracks if track.stretch.plant.coordinates == plant.coordinates]
    several = len({track.stretch.recording for track in tracks}) > 1
    found = []
    for site, variable, factor in wanted(plant):
        x = np.concatenate([np.ravel(variable.of(at_nodes(track, fit))) for track in tracks])
        for knots in _knot_sets(variable, x):
            own = (False, True) if several and variable.own_zero else (several and variable.name == "t",)
            found += [
                Curve(site, variable, knots, factor, per_recording, coordinates=plant.coordinates)
                for per_recording in own
            ]
    return found


def at_nodes(track: Track, fit: Fit) -> Point:
    """Everything a variable may read, arrays (n,) at the nodes, as the filter predicts them."""
    u = track.torques(track.local(fit.values)).mean(axis=0)
    return track.stretch.plant.point(track.predicted.T, track.local(fit.values), np.append(u, u[-1]), track.stretch.t)


def _knot_sets(variable: Variable, x: Array) -> list[Array]:
    if variable.name == "t":
        found = [np.linspace(x.min(), x.max(), max(4, 1 + round(float(np.ptp(x)) / SECONDS_A_KNOT)))]
    elif variable.period is not None:
        found = [turn_knots(count, variable.period) for count in (TURN_COARSE, TURN_FINE)]
    else:
        found = [spread_knots(x, count) for count in (COARSE, FINE)]
    return [knots for i, knots in enumerate(found) if len(knots) >= FEWEST and (i == 0 or len(knots) > len(found[0]))]


# ---------------------------------------------------------------------------------------------- which curves there are

Wanted = tuple[Site, Variable, Factor | None]


def wanted(plant: DeclaredPlant) -> Iterator[Wanted]:
    """Sites, variables and factors of a plant."""
    kinds: dict[str, Callable[[DeclaredPlant, str, Slot], Iterator[Wanted]]] = {
        "body": _of_body, "rolling_ball": _of_ball, "actuator": _of_actuator, "push": _of_push, "sensor": _of_sensor
    }  # fmt: skip
    for name, slot in plant.slots.items():
        if slot.kind in kinds:
            yield from kinds[slot.kind](plant, name, slot)


def state(plant: DeclaredPlant, name: str) -> Variable:
    """A state of the plant as a variable: the angle of a turning body comes back after a turn."""
    names = units(plant)
    if name not in plant.coordinates:
        return Variable(name, names.rate, lambda s: getattr(s, name))
    turning = turns(plant, name)
    return Variable(name, names.coordinate, lambda s: getattr(s, name), 2 * pi if turning else None, turning)


def wound(plant: DeclaredPlant, name: str) -> Variable:
    """The angle of a turning body over all its turns."""
    return Variable(name, units(plant).coordinate, lambda s: getattr(s, name))


TIME = Variable("t", "s", lambda s: s.t)
DEMAND = "u"


def _demand(plant: DeclaredPlant) -> Variable:
    return Variable(DEMAND, plant.force_unit, lambda s: s.u)


def _as_factor(variable: Variable) -> Factor:
    return Factor(variable.name, variable.unit, variable.of)


def _of_body(plant: DeclaredPlant, name: str, slot: Slot) -> Iterator[Wanted]:
    q = slot.coordinate
    site = Site(name, "force", {q: 1.0}, plant.force_unit)
    rate = state(plant, f"d{q}")
    for one in (rate, state(plant, q), *_others(plant, q)):
        yield site, one, None
    if turns(plant, q):
        yield site, wound(plant, q), None
    # a viscous coefficient that changes
    for one in (state(plant, q), TIME):
        yield site, one, _as_factor(rate)


def _others(plant: DeclaredPlant, own: str) -> list[Variable]:
    """States of the other coordinates."""
    return [state(plant, name) for name in plant.states if name.removeprefix("d") != own and name != own]


def _of_ball(plant: DeclaredPlant, name: str, slot: Slot) -> Iterator[Wanted]:
    q, others = slot.coordinate, [c for c in plant.coordinates if c != slot.coordinate]
    along = Site(name, "force", {q: 1.0, **dict.fromkeys(others, -1.0)}, plant.force_unit)
    names = [f"d{c}" for c in (*others, q)]
    rolling = Variable("-".join(names), "rad/s", lambda s: _difference([getattr(s, n) for n in names]))
    own = Site(name, "force", {q: 1.0}, plant.force_unit)
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


def _of_actuator(plant: DeclaredPlant, name: str, slot: Slot) -> Iterator[Wanted]:
    site, demand, q = Site(name, "torque", {slot.coordinate: 1.0}, plant.force_unit), _demand(plant), slot.coordinate
    yield site, demand, None
    # a gain that changes with the rate, the angle, the time
    for one in (state(plant, f"d{q}"), state(plant, q), TIME):
        yield site, one, _as_factor(demand)


def _of_push(plant: DeclaredPlant, name: str, slot: Slot) -> Iterator[Wanted]:
    yield Site(name, "force", {slot.coordinate: 1.0}, plant.force_unit), TIME, None


def _of_sensor(plant: DeclaredPlant, name: str, slot: Slot) -> Iterator[Wanted]:
    q = slot.coordinate
    for channel in slot.channels:
        if channel not in plant.channels:
            continue
        site = Site(name, "reading", {channel: 1.0}, state(plant, plant.channels[channel]).unit)
        for one in (state(plant, q), state(plant, f"d{q}"), TIME):
            yield site, one, None
        if plant.channels[channel] == q:
            # late by a time that changes with the rate or the position
            yield site, state(plant, q), _as_factor(state(plant, f"d{q}"))
