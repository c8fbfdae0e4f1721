"""On what a mechanism may depend: positions, rates, differences of bodies in contact, inputs, power and time.

Rules of this file: axes come from the declared plant; no name of a hoop stands here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from hoopd.files.dimensions import product_text
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Point
from hoopd.plants.effects.usual_sizes import turns, units

# Kinds of axes: what a shape needs to know of its variable.
POSITION, RATE, INPUT, POWER, TIME = "position", "rate", "input", "power", "time"
STATE, LOSS, FORCE = "state", "loss", "force"


@dataclass(frozen=True)
class Axis:
    """A variable of the plant.

    Attributes
    ----------
    name : str
        As it stands in the name of a mechanism: letters, digits and _.
    text : str
        As it stands in a formula.
    unit : str
        Its unit.
    kind : str
        One of the kinds of this file.
    of : callable
        Its value at a point; plain arithmetic, so that a point may hold symbols or arrays.
    words : str
        As a sentence calls it.
    turning : bool
        An angle that comes back after a turn.
    coordinates : tuple of str
        Coordinates that it is made of.
    rate : callable, optional
        The rate of the way that a memory goes by: of a position its own, of an input that of what it drives.
    way : callable, optional
        That way, where it is not the variable itself.
    way_of : str
        Its unit.
    scale_share : float
        Of an angle whose scale is another than the model's: by which share it may be off.
    """

    name: str
    text: str
    unit: str
    kind: str
    of: Callable[[Point], Any]
    words: str
    turning: bool = False
    coordinates: tuple[str, ...] = ()
    rate: Callable[[Point], Any] | None = None
    way: Callable[[Point], Any] | None = None
    way_of: str = ""
    scale_share: float = 0.0

    @property
    def way_unit(self) -> str:
        """Of the way that a memory goes by."""
        return self.unit if self.way is None else self.way_of


def position(plant: Plant, q: str) -> Axis:
    """A coordinate."""
    unit, words = units(plant, q).coordinate, plant.judges.words.get(q, q)
    turning = turns(plant, q)
    name = f"the angle of {words}" if unit == "rad" else f"the position of {words}"
    return Axis(q, q, unit, POSITION, lambda s: getattr(s, q), name if words != q else q, turning, (q,),
                lambda s: getattr(s, f"d{q}"))  # fmt: skip


def rate(plant: Plant, q: str) -> Axis:
    """The rate of a coordinate."""
    words = plant.judges.words.get(q, q)
    return Axis(f"d{q}", f"{q}'", units(plant, q).rate, RATE, lambda s: getattr(s, f"d{q}"), f"the speed of {words}",
                coordinates=(q,))  # fmt: skip


def relative(plant: Plant, q: str, other: str) -> Iterator[Axis]:
    """Position and rate of one body against another that it touches, or is joined with through a gear."""
    r = plant.ratio(q, other)
    if r == 1.0 and units(plant, q).coordinate != units(plant, other).coordinate:
        return
    one, two, sign = position(plant, q), rate(plant, q), "-" if r > 0.0 else "+"
    less, its = ("less", other) if r == 1.0 else ("less_geared", f"{abs(r):.4g} {other}")
    mine, place = (plant.judges.words.get(name, name) for name in (q, other))
    words = f"the place of {mine} on {place}", f"the speed of {mine} against {place}"
    if r != 1.0:
        words = f"{q} {sign} {its}", f"the speed of {q} {sign} {its}"
    # what twists a belt does not come back after a turn
    turning = r == 1.0 and (turns(plant, q) or turns(plant, other))

    def way(s: Point) -> Any:
        return getattr(s, q) - r * getattr(s, other)

    def speed(s: Point) -> Any:
        return getattr(s, f"d{q}") - r * getattr(s, f"d{other}")

    yield Axis(f"{q}_{less}_{other}", f"({q} {sign} {its})", one.unit, POSITION, way, words[0], turning, (q, other),
               rate=speed)  # fmt: skip
    yield Axis(f"d{q}_{less}_d{other}", f"({q}' {sign} {its}')", two.unit, RATE, speed, words[1],
               coordinates=(q, other))  # fmt: skip


def state(plant: Plant, name: str) -> Axis:
    """A first-order state."""
    return Axis(name, name, plant.units.get(name, "-"), STATE, lambda s: getattr(s, name), name, coordinates=())


def demand(plant: Plant) -> Axis:
    """The first input, as demanded."""
    name = plant.inputs[0].name
    return Axis(name, name, plant.inputs[0].unit, INPUT, lambda s: s.demand, "the demand")


def size(plant: Plant) -> Axis:
    """The size of the first input: what a current draws from its supply, whichever way it goes."""
    first = demand(plant)
    return replace(first, name=f"size_{first.name}", text=f"|{first.text}|", kind=POWER,
                   of=lambda s: abs(s.demand), words="the size of the demand")  # fmt: skip


def driving(plant: Plant, q: str) -> Axis:
    """The first input, with the way of what it drives."""
    speed, place = rate(plant, q).of, position(plant, q).of
    return replace(demand(plant), coordinates=(q,), rate=speed, way=place, way_of=units(plant, q).coordinate)


def power(plant: Plant, q: str) -> Axis:
    """What the first input gives to the motion."""
    name = plant.inputs[0].name
    unit = "W" if plant.force_unit in ("N", "N m") else f"{plant.force_unit} {units(plant, q).rate}"
    return Axis(f"{name}_d{q}", f"{name} {q}'", unit, POWER, lambda s: s.u * getattr(s, f"d{q}"),
                "the power of the drive", coordinates=(q,))  # fmt: skip


def drawn(plant: Plant, q: str) -> Axis:
    """What the drive takes from its supply, and does not give back."""
    found = power(plant, q)
    return replace(found, name=f"drawn_{found.name}", text=f"max({found.text}, 0)",
                   of=lambda s: _positive(found.of(s)), words="the power that the drive draws")  # fmt: skip


def _positive(value: Any) -> Any:
    return (abs(value) + value) / 2.0


def losses(plant: Plant, q: str) -> Iterator[Axis]:
    """What warms a drive or a bearing: the square of the input, and the size of the power."""
    first, name = demand(plant), plant.inputs[0].name
    unit = product_text((first.unit, 2))
    yield Axis(f"{name}_squared", f"{name}^2", unit, LOSS, lambda s: s.demand**2, "the square of the demand")
    if q:
        speed = rate(plant, q)
        yield Axis(f"d{q}_squared", f"{q}'^2", product_text((speed.unit, 2)), LOSS, lambda s: getattr(s, f"d{q}") ** 2,
                   f"the square of {speed.words}", coordinates=(q,))  # fmt: skip


def squared(of: Axis) -> Axis:
    """The square of a variable: what it makes warm."""
    return Axis(f"{of.name}_squared", f"{of.name}^2", product_text((of.unit, 2)), LOSS, lambda s: of.of(s) ** 2,
                f"the square of {of.words}")  # fmt: skip


CLOCK = Axis("t", "t", "s", TIME, lambda s: s.t, "the time since the recording began")


def motions(plant: Plant, own: str) -> list[Axis]:
    """Of a coordinate and its neighbours: own rate and position first."""
    found = [rate(plant, own), position(plant, own)]
    for other in (q for q in plant.coordinates if q != own):
        found += [rate(plant, other), position(plant, other), *reversed([*relative(plant, own, other)])]
    return found
