"""What a plant is: states and their equations, inputs, channels that are read, slots for effects, parameters.

The state is (q1, q1', q2, q2', ..., first-order states); the rate of a coordinate `theta` is called `dtheta`. The hoop
with its ball is one such plant; another one is declared in a few lines (docs/reference/effects.md).

Rules of this file: declarations only; nothing here knows a particular plant or effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import inf, nan
from typing import Any, NamedTuple

import casadi as ca

from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.fingerprint import DESCRIBES

# What a drive gives, by its unit.
GIVEN = {
    "N m": "torque", "N": "force", "V": "voltage", "A": "current", "m3/s": "flow", "l/s": "flow", "kg/s": "flow",
    "W": "power",
}  # fmt: skip


class Input(NamedTuple):
    """What drives the plant, held between two samples.

    Attributes
    ----------
    name : str
        Its name; equations of effects read it so.
    unit : str
        Its unit.
    limit : float, optional
        The drive gives no more, of either sign; None where none is known.
    coordinate : str, optional
        It is a generalised force on this coordinate; None where equations read it by its name.

    Examples
    --------
    >>> from hoopd.plants.declaration import Input
    >>> Input("F", "N", limit=10.0, coordinate="x").limit
    10.0
    """

    name: str
    unit: str = "N m"
    limit: float | None = None  # the drive gives no more, of either sign; None: none is known
    coordinate: str | None = None  # the input is a generalised force on it; None: equations read it by its name


class Channel(NamedTuple):
    """What is measured: a state, or an expression of the point.

    Attributes
    ----------
    state : str
        The state that it reads.
    unit : str
        Its unit.
    sensor : str
        The slot in which effects of the sensor sit.
    reading : callable, optional
        The expression of a point, in place of a state.
    resolution : float, optional
        Step of a counting sensor; None as its data show.
    arbitrary_zero : bool
        It counts from where it was switched on: zero is another place in each recording.

    Examples
    --------
    >>> import casadi as ca
    >>> from hoopd.plants.declaration import Channel
    >>> height = Channel(unit="m", reading=lambda s: s.p["l"] * (1.0 - ca.cos(s.alpha)))
    >>> height.unit, height.state
    ('m', '')
    """

    state: str = ""
    unit: str = ""
    sensor: str = ""  # the slot
    reading: Callable[[Point], Any] | None = None
    resolution: float | None = None  # step of a counting sensor; None: as its data show
    arbitrary_zero: bool = False  # counted from where it was switched on: zero is another place in each recording


class Slot(NamedTuple):
    """Where an effect may sit.

    Attributes
    ----------
    kind : str
        `actuator`, `body`, `store`, `sensor`, `push`, or a kind that a plant's own effects know.
    coordinate : str
        Of the body; of a store its first-order state.
    channels : tuple of str
        Of the sensor.
    turns : bool
        The body (or the sensor's wheel) turns: an angle comes back after a turn.
    device : str
        Of a sensor: encoder, camera, or anything else.
    speed : float
        Usual rate of the coordinate in rad/s or m/s: the sizes that a search tries follow it.
    viscous : callable, optional
        The base's viscous coefficient of the body, where it has one.
    data : object
        What a plant's own effects have to know of its own kind of slot.
    free_gain : bool
        The drive's gain is one of the plant's own parameters, so that nobody searches it beside them.

    Examples
    --------
    >>> from hoopd.plants.declaration import Slot
    >>> Slot("body", coordinate="x", speed=0.3).turns
    False
    """

    kind: str
    coordinate: str = ""
    channels: tuple[str, ...] = ()
    turns: bool = False  # the body (or the sensor's wheel) turns: an angle comes back after a turn
    device: str = ""  # of a sensor: encoder, camera, or anything else
    speed: float = 10.0  # usual rate of the coordinate, rad/s or m/s: the sizes that a search tries follow it
    viscous: Callable[[Point], Any] | None = None  # the base's viscous coefficient of the body, where it has one
    data: Any = None  # what a plant's own effects have to know of its own kind of slot
    free_gain: bool = False  # the drive's gain is one of the plant's own parameters


@dataclass(frozen=True)
class Judges:
    """What a plant knows of the quality of its recordings, beside what its sensors' devices say."""

    moving: Callable[[Any], Plant] | None = None  # the plant with what moves in a recording; None: all of it does
    doubts: Callable[[Any], list[str]] | None = None  # sentences; None: those that hold for every recording
    repeated: Callable[[Any], Any] | None = None  # rows in which counting sensors repeat the row before
    least_s: tuple[float, float] | None = None  # seconds of data to fit, and to prove with; None: from its sampling
    stops: bool = False  # the drive may switch itself off: where it does not answer, nothing counts
    words: Mapping[str, str] = field(default_factory=dict)  # coordinates as a person calls them


class MotionMode(NamedTuple):
    """A mode of motion that the plant's equations describe; more than one, with resets, is reserved.

    Attributes
    ----------
    name : str
        As a person calls the motion.
    guard : callable, optional
        Of a point without inputs: how far inside the mode it is, in shares of what holds it at rest (1 there); the
        mode ends where it falls to zero. None: it never ends.
    reset : callable, optional
        Reserved.
    """

    name: str
    guard: Callable[[Point], Any] | None = None
    reset: Callable[[Point], Any] | None = None


def _no_accelerations(s: Point, force: ca.SX) -> ca.SX:
    """Of a plant without coordinates."""
    return ca.SX(0, 1)


def _no_rates(s: Point) -> ca.SX:
    """Of a plant without first-order states."""
    return ca.SX(0, 1)


@dataclass(frozen=True)
class Plant:
    """Everything that simulation, fits, diagnosis, design and reports have to know of a plant.

    Forces of inputs with a coordinate are among the generalised forces that `accelerations` gets; it must not add them
    again. Names of states, inputs and held quantities are attributes of the point, parameters are in `s.p`.

    Attributes
    ----------
    name : str
        Its name.
    coordinates : tuple of str
        Second order; the rate of `x` is called `dx`.
    accelerations : callable
        q'' (n,) of a point and the generalised forces (n,).
    first_order : tuple of str
        First-order states.
    rates : callable
        x' (m,) of the first-order states, of a point.
    inputs : tuple of Input
        None, one or several.
    values : mapping of str to float
        Parameters in SI units.
    free : tuple of str
        Those that are fitted.
    bounds : mapping of str to (float, float)
        Outside there is no such plant.
    beliefs : mapping of str to float
        The share of its value to which a parameter is believed: of one that is fitted, the prior; intervals of what is
        fitted beside one that is not include it.
    units : mapping of str to str
        Of parameters and first-order states.
    held : mapping of str to float
        Names that effects may use and that do not move.
    remembered : mapping of str to str
        First-order states that hold what was before, each with the state as which it begins where nobody says it: a
        body that moves along. Of those with an empty text nothing is remembered then.
    led : tuple of str
        First-order states that an estimator leads along its own other states, and does not correct: of a body that hits
        its stops a deviation grows without an end, though it stays between them.
    channels : mapping of str to Channel
        What is measured.
    slots : mapping of str to Slot
        Where effects may sit.
    scales : mapping of str to float
        Usual sizes of states and inputs; empty: from the data.
    recorded : frozenset of str
        Those of `scales` that nobody said, and that follow the recordings.
    middles : mapping of str to float
        Medians of states and inputs in its recordings; what is not named is about zero.
    ratios : mapping of (str, str) to float
        (q, other) -> r where what joins two bodies goes by q - r other; not those of 1.
    usual_force : float
        Size of the forces on the first coordinate, for a plant without inputs.
    time_scale_s : float
        Usual time in s between two samples: integration steps and searched delays follow it.
    least_size : float, optional
        Least usual size of a parameter, in its unit; None: as it is declared.
    energy : callable, optional
        In J, of a point, where the plant has one.
    own_effects : callable, optional
        Effects of its own kinds of slot.
    own_axes : callable, optional
        Of the plant and a slot: variables that mechanisms there may depend on, beside those of every plant.
    judges : Judges
        What it knows of the quality of its recordings.
    plays : str
        The command that plays a signal on the device; empty: there is none.
    modes : tuple of MotionMode
        One for now.

    Examples
    --------
    >>> from hoopd.plants.declaration import Channel, Input, Plant
    >>> cart = Plant(
    ...     "cart", ("x",), lambda s, force: force / s.p["m"], inputs=(Input("F", "N", 10.0, "x"),),
    ...     values={"m": 2.0}, free=("m",), channels={"x": Channel("x", "m")},
    ... )
    >>> cart.states, cart.driven, cart.limit
    (('x', 'dx'), 'x', 10.0)
    """

    name: str
    coordinates: tuple[str, ...] = ()
    # q'' (n,) at a point under generalised forces (n,); forces of the inputs are among them
    accelerations: Callable[[Point, ca.SX], ca.SX] = _no_accelerations
    first_order: tuple[str, ...] = ()
    # x' (m,) of the first-order states at a point
    rates: Callable[[Point], ca.SX] = _no_rates
    inputs: tuple[Input, ...] = ()
    values: Mapping[str, float] = field(default_factory=dict)  # parameters, SI units
    free: tuple[str, ...] = ()  # those that are fitted
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # outside there is no such plant
    beliefs: Mapping[str, float] = field(default_factory=dict)  # to which share a parameter is known beforehand
    units: Mapping[str, str] = field(default_factory=dict)  # of parameters and first-order states
    held: Mapping[str, float] = field(default_factory=dict)  # names that effects may use and that do not move
    remembered: Mapping[str, str] = field(default_factory=dict)  # states, and as which other one each begins
    led: tuple[str, ...] = ()  # states that an estimator does not correct
    channels: Mapping[str, Channel] = field(default_factory=dict)
    slots: Mapping[str, Slot] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)  # usual sizes of states and inputs; else `recorded_sizes`
    recorded: frozenset[str] = frozenset()  # those of `scales` that nobody said
    # about which values of states and inputs its recordings are; it computes the same with others
    middles: Mapping[str, float] = field(default_factory=dict, metadata=DESCRIBES)
    # (q, other) -> r: what joins two bodies goes by q - r other, as its equations have it (a gear, a belt)
    ratios: Mapping[tuple[str, str], float] = field(default_factory=dict, metadata=DESCRIBES)
    usual_force: float = 1.0  # size of the forces on the first coordinate, for a plant without inputs
    time_scale_s: float = 0.02  # usual time between two samples: integration steps and searched delays follow it
    least_size: float | None = None  # of a parameter, in its unit; None: as it is declared
    energy: Callable[[Point], Any] | None = None  # J, where the plant has one
    own_effects: Callable[[Plant], Iterable[Effect]] | None = None  # of its own kinds of slot
    own_axes: Callable[[Plant, str], Iterable[Any]] | None = None  # further variables of a slot's mechanisms
    judges: Judges = field(default_factory=Judges)
    plays: str = ""  # the command that plays a signal on the device; empty: there is none
    modes: tuple[MotionMode, ...] = ()

    def __post_init__(self) -> None:
        _check(self)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the state in its order."""
        return (*(name for q in self.coordinates for name in (q, f"d{q}")), *self.first_order)

    @property
    def disturbed(self) -> tuple[str, ...]:
        """What a disturbance acts on: a force on every coordinate, a rate of every first-order state."""
        return (*self.coordinates, *self.first_order)

    def is_length(self, coordinate: str) -> bool:
        """Whether a coordinate is one, and no angle; where nobody said its unit, by the plant's force."""
        known = self.units.get(coordinate)
        return known == "m" or (known is None and self.force_unit != "N m")

    def disturbance_unit(self, name: str) -> str:
        """Of what acts on one of `disturbed`: whatever the inputs give, a force moves a length, a torque an angle."""
        if name in self.coordinates:
            return "N" if self.is_length(name) else "N m"
        return f"{self.units.get(name, '-')}/s"

    @property
    def driven(self) -> str | None:
        """The coordinate on which the first input acts."""
        return self.inputs[0].coordinate if self.inputs else None

    def moved_by(self, drive: Slot) -> str:
        """The coordinate that the first input moves: on which it acts, that of its slot, or the only one; empty where
        nobody knows."""
        return self.driven or drive.coordinate or (self.coordinates[0] if len(self.coordinates) == 1 else "")

    def ratio(self, q: str, other: str) -> float:
        """r of the difference q - r other by which two bodies are joined; 1 where nobody said another."""
        if (other, q) in self.ratios:
            return 1.0 / self.ratios[other, q]
        return self.ratios.get((q, other), 1.0)

    @property
    def limit(self) -> float:
        """Limit of the first input; infinite where none is known."""
        return inf if not self.inputs or self.inputs[0].limit is None else self.inputs[0].limit

    @property
    def usual_input(self) -> float:
        """Usual size of the first input: its scale, else its limit, else one; without one, of the plant's forces."""
        if not self.inputs:
            return self.usual_force
        return self.scales.get(self.inputs[0].name, self.limit if self.limit < inf else 1.0)

    @property
    def force_unit(self) -> str:
        """Unit of the first input; without one, that of a force on the first coordinate."""
        if self.inputs:
            return self.inputs[0].unit
        return "N" if self.units.get("".join(self.coordinates[:1])) == "m" else "N m"

    @property
    def input_word(self) -> str:
        """What the first input is, by its unit: torque, force, flow ...; input where the unit does not tell."""
        return GIVEN.get(self.force_unit, "input")

    def state_of(self, channel: str) -> str:
        """The state that a channel reads; empty where it reads an expression, or is none of this plant."""
        return self.channels[channel].state if channel in self.channels else ""

    @property
    def states_read(self) -> tuple[str, ...]:
        """`state_of` every channel."""
        return tuple(one.state for one in self.channels.values())

    @property
    def arbitrary_zeros(self) -> tuple[str, ...]:
        """Coordinates whose zero is another place in each recording: one number for all that follows them."""
        counted = {one.state for one in self.channels.values() if one.arbitrary_zero}
        return tuple(q for q in self.coordinates if q in counted)

    def point(self, x: Any, p: Mapping[str, Any], u: Any = 0.0, t: Any = 0.0) -> Point:
        """Named view of a state; `u`: the input, or a sequence of them where there are several."""
        names = {**self.held, **{name: x[i] for i, name in enumerate(self.states)}}
        if len(self.inputs) == 1:
            names[self.inputs[0].name] = u
        elif self.inputs:
            every = {one.name: u if isinstance(u, float | int) else u[i] for i, one in enumerate(self.inputs)}
            names, u = {**names, **every}, every[self.inputs[0].name]
        return Point(names, p, u, t, self.inputs[0].name if self.inputs else "")

    def reading_point(self, x: Any, p: Mapping[str, Any], t: Any) -> Point:
        """What a channel may read: states, held names, parameters and the time; the inputs are not among them."""
        return Point({**self.held, **{name: x[i] for i, name in enumerate(self.states)}}, p, nan, t)


def _check(plant: Plant) -> None:
    """ValueError for a declaration that contradicts itself."""
    names = [*plant.states, *(one.name for one in plant.inputs)]
    if double := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"{plant.name}: {', '.join(double)} stands twice among states and inputs")
    if plant.coordinates and plant.accelerations is _no_accelerations:
        raise ValueError(f"{plant.name}: coordinates need accelerations")
    if plant.first_order and plant.rates is _no_rates:
        raise ValueError(f"{plant.name}: first-order states need rates")
    for one in plant.inputs:
        if one.coordinate is not None and one.coordinate not in plant.coordinates:
            raise ValueError(f"{plant.name}: input {one.name} acts on {one.coordinate!r}, which is no coordinate")
    for name, channel in plant.channels.items():
        if channel.reading is None and channel.state not in plant.states:
            raise ValueError(f"{plant.name}: channel {name} reads {channel.state!r}, which is no state")
    for name in (*plant.free, *plant.bounds):
        if name not in plant.values:
            raise ValueError(f"{plant.name}: {name} is no parameter")
    drives = [name for name, slot in plant.slots.items() if getattr(slot, "kind", "") == "actuator"]
    if len(drives) > 1:
        raise ValueError(f"{plant.name}: slots {' and '.join(drives)} are actuators; there is one, of the first input")
    if len(plant.modes) > 1:
        raise ValueError(f"{plant.name}: more than one mode is not supported yet")
