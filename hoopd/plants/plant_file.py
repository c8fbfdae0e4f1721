"""Plant files: `hoopd.plant/1` in YAML, or a Python file that defines PLANT or `plant()`, as a `Plant`.

A YAML file says what its grammar can say, and nothing in it is executed. A Python file is the user's own program, as a
file of effects is: it runs with the rights of who calls us.

Rules of this file: whatever is wrong in such a file is one `InputError`; the daemon never comes here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from math import inf, isnan
from pathlib import Path
from typing import Any

from hoopd.files.dimensions import CELSIUS, Unit, parse_unit
from hoopd.files.expression_parser import parse_expression
from hoopd.files.expressions import CONSTANTS, FUNCTIONS, MAX_NAME_CHARS, NAME, names_in
from hoopd.files.plant import (
    LONGEST_SAMPLE_S,
    ChannelEntry,
    CoordinateEntry,
    InputEntry,
    ParameterEntry,
    PlantFile,
    StateEntry,
    check_unit,
    quantity,
)
from hoopd.files.reading import InputError, parse_yaml, read_text, to_struct
from hoopd.files.records import between
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Point
from hoopd.plants.plant_equations import Equations
from hoopd.plants.plant_program import program_plant
from hoopd.recording.timeline import CLOSEST_S

# Far more than a rig of a laboratory has; graphs of such a size are made in a second.
MOST = {"coordinates": 8, "states": 20, "inputs": 8, "parameters": 100, "channels": 40, "slots": 40}
# What a point of the plant calls its own; of these the first input may have its own.
FIRST_INPUT = "u"
RESERVED: Mapping[str, str] = {
    **dict.fromkeys(FUNCTIONS, "a function of equations"), **dict.fromkeys(CONSTANTS, "a constant of equations"),
    "t": "the time", FIRST_INPUT: "what laws call the first input of any plant (say F, V or u1)",
    "p": "what laws call all parameters together (say p_in or pressure)",
    "replaced": "a word of the program",
}  # fmt: skip
LENGTH, ANGLE = "m", "rad"
# How fast bodies of laboratory rigs go where a file does not say it, in the coordinate's unit a second.
USUAL_RATE = {LENGTH: 1.0, ANGLE: 10.0}
# No rig is sampled faster, s: rows nearer than that are no two instants.
SHORTEST_SAMPLE_S = (1.0 - 1e-6) * CLOSEST_S
DEVICES = ("encoder", "camera")


def load_plant(path: Path) -> Plant:
    """Load the plant that a file declares.

    Parameters
    ----------
    path : Path
        `hoopd.plant/1` in YAML, in which nothing is executed; or .py, which is code and is run.

    Returns
    -------
    Plant
        The declaration.

    Raises
    ------
    InputError
        Says which key, column or line is wrong.

    Examples
    --------
    >>> from hoopd.plants.plant_file import load_plant
    >>> from hoopd.plants.registry import FOLDER
    >>> pendulum = load_plant(FOLDER / "pendulum.yaml")
    >>> pendulum.states, pendulum.free
    (('alpha', 'dalpha'), ('J', 'c'))
    """
    return program_plant(path) if path.suffix == ".py" else parse_plant(read_text(path), path)


def parse_plant(text: str, path: object) -> Plant:
    """Give the plant of a YAML file's text.

    Parameters
    ----------
    text : str
        `hoopd.plant/1`.
    path : object
        What a message calls it.

    Returns
    -------
    Plant
        The declaration.

    Raises
    ------
    InputError
        Says which key, column or line is wrong.

    Examples
    --------
    >>> from hoopd.plants.plant_file import parse_plant
    >>> text = '''
    ... schema: hoopd.plant/1
    ... name: cart
    ... coordinates: {x: {unit: m}}
    ... inputs: {F: {unit: N, limit: 10}}
    ... parameters: {m: {value: 2, unit: kg, bounds: [0.1, 10]}}
    ... equations: {x: "m*x'' = F"}
    ... channels: {x: {reads: x, sensor: encoder}}
    ... '''
    >>> cart = parse_plant(text, "cart.yaml")
    >>> cart.states, cart.free, cart.limit
    (('x', 'dx'), ('m',), 10.0)
    """
    return _Maker(to_struct(parse_yaml(text, path), PlantFile, path), path).plant()


class _Maker:
    """A checked file on its way to a plant."""

    def __init__(self, file: PlantFile, path: object) -> None:
        self._file, self._path = file, path
        for key, most in MOST.items():
            if len(getattr(file, key)) > most:
                raise InputError(path, key, f"at most {most}, not {len(getattr(file, key))}")
        self._coordinates = _whole(file.coordinates, lambda text: CoordinateEntry(unit=text))
        self._states = _whole(file.states, lambda text: StateEntry(unit=text))
        self._inputs = _whole(file.inputs, lambda text: InputEntry(unit=text))
        self._parameters = {name: self._parameter(name, one) for name, one in file.parameters.items()}
        self._check_names()
        self._check_numbers()
        self._check_temperatures()
        self._equations = Equations(
            path,
            {name: one.unit for name, one in self._coordinates.items()},
            {name: one.unit for name, one in self._states.items()},
            {name: one.unit for name, one in self._inputs.items()},
            {name: (one.value, one.unit) for name, one in self._parameters.items()},
            file.equations,
            self._scales(),
        )

    def _check_temperatures(self) -> None:
        """InputError where temperatures count from two zeros: equations would add them."""
        groups = {"states": self._states, "inputs": self._inputs, "parameters": self._parameters}
        told = [(f"{key}.{name}", one.unit.strip()) for key, group in groups.items() for name, one in group.items()]
        celsius, kelvin = ([key for key, unit in told if unit in units] for units in (CELSIUS, ("K",)))
        if celsius and kelvin:
            reason = f"is in K and {celsius[0]} in degC, 273.15 apart: give all temperatures in one of them"
            raise InputError(self._path, kelvin[0], reason)

    def plant(self) -> Plant:
        """All of it."""
        e, file = self._equations, self._file
        channels, units = self._channels(), dict[str, str]()
        for q, one in self._coordinates.items():
            units |= {q: one.unit, f"d{q}": f"{one.unit}/s"}
        units |= {name: one.unit for name, one in (*self._states.items(), *self._parameters.items())}
        energy = e.energy(file.energy) if file.energy else None
        return Plant(
            name=file.name,
            coordinates=e.coordinates,
            accelerations=e.accelerations,
            first_order=e.first_order,
            rates=e.rates,
            inputs=tuple(Input(name, one.unit, one.limit, e.acting.get(name)) for name, one in self._inputs.items()),
            values=e.values,
            free=tuple(name for name, one in self._parameters.items() if not one.held),
            bounds={n: one.bounds for n, one in self._parameters.items() if one.bounds != (-inf, inf)},
            units=units,
            channels=channels,
            slots=self._slots(channels),
            scales=e.scales,
            usual_force=e.usual_force,
            ratios=e.ratios([name for name, one in self._parameters.items() if one.held]),
            time_scale_s=file.sample_time_s,
            energy=energy,
        )

    # ------------------------------------------------------------------------------------------ checks

    def _parameter(self, name: str, one: ParameterEntry | str) -> ParameterEntry:
        if isinstance(one, ParameterEntry):
            return one
        number, unit = quantity(self._path, f"parameters.{name}", one)
        return ParameterEntry(value=number, unit=unit)

    def _check_names(self) -> None:
        owners: dict[str, str] = dict.fromkeys((f"d{q}" for q in self._coordinates), "the rate of a coordinate")
        for section in ("coordinates", "states", "inputs", "parameters"):
            first = FIRST_INPUT if section == "inputs" and next(iter(self._file.inputs), "") == FIRST_INPUT else ""
            for name in getattr(self._file, section):
                key = f"{section}.{name}"
                if not NAME.fullmatch(name) or len(name) > MAX_NAME_CHARS:
                    reason = f"a name begins with a letter and has at most {MAX_NAME_CHARS} letters, digits and _"
                    raise InputError(self._path, key, reason)
                if name in RESERVED and name != first:
                    raise InputError(self._path, key, f"{name} is {RESERVED[name]}: it needs another name")
                if name in owners:
                    raise InputError(self._path, key, f"{name} is taken: {owners[name]}")
                owners[name] = section
        wanted = {*self._coordinates, *self._states}
        if not wanted:
            raise InputError(self._path, "coordinates", "neither coordinates nor states: nothing moves")
        for name in (*wanted, *self._file.equations):
            if name not in self._file.equations:
                raise InputError(self._path, f"equations.{name}", "is missing")
            if name not in wanted:
                raise InputError(self._path, f"equations.{name}", "is neither a coordinate nor a state")

    def _check_numbers(self) -> None:
        path = self._path
        sections = {"coordinates": self._coordinates, "states": self._states, "inputs": self._inputs}
        for key, section in {**sections, "parameters": self._parameters}.items():
            for name, one in section.items():
                check_unit(path, f"{key}.{name}", one.unit)
        for name, one in self._coordinates.items():
            if one.unit not in USUAL_RATE:
                alike = any(parse_unit(one.unit).same_kind(parse_unit(unit)) for unit in USUAL_RATE)
                more = "--columns converts readings" if alike else "what has no acceleration stands under states"
                raise InputError(path, f"coordinates.{name}", f"must be in m or rad, not {one.unit!r} ({more})")
        for name, one in self._parameters.items():
            low, high = one.bounds
            if isnan(low) or isnan(high) or not low < high or not low <= one.value <= high:
                reason = f"the bounds {low:g} to {high:g} do not hold the value {one.value:g}"
                raise InputError(path, f"parameters.{name}.bounds", reason)
        for name, one in self._inputs.items():
            if one.limit is not None:
                between(path, f"inputs.{name}.limit", one.limit, 0.0, 1e12)
        for key, section in sections.items():
            for name, one in section.items():
                for field in ("usual", "usual_rate"):
                    if getattr(one, field, None) is not None:
                        between(path, f"{key}.{name}.{field}", getattr(one, field), 0.0, 1e12)
        between(path, "sample_time_s", self._file.sample_time_s, SHORTEST_SAMPLE_S, LONGEST_SAMPLE_S)

    # ------------------------------------------------------------------------------------------ parts

    def _channels(self) -> dict[str, Channel]:
        given = _whole(self._file.channels, lambda text: ChannelEntry(reads=text))
        names = (*self._coordinates, *self._states)
        found = given or {name: ChannelEntry(reads=name) for name in names}
        return {name: self._channel(name, one) for name, one in found.items()}

    def _channel(self, name: str, one: ChannelEntry) -> Channel:
        key = f"channels.{name}"
        if not NAME.fullmatch(name):
            raise InputError(self._path, key, "a name begins with a letter and has letters, digits and _")
        state, law, unit = self._equations.reading(f"{key}.reads", one.reads)
        check_unit(self._path, f"{key}.unit", one.unit)
        if one.unit and unit is not None and not unit.same_kind(parse_unit(one.unit)):
            raise InputError(self._path, f"{key}.unit", f"{one.unit!r} is wrong: it reads {unit}")
        shown = one.unit or self._unit_text(state, unit)
        if one.zero == "arbitrary" and state not in self._coordinates:
            raise InputError(
                self._path, f"{key}.zero", f"only what reads a coordinate counts from there, not {one.reads}"
            )
        sensor = one.sensor or self._sensor(one.reads)
        return Channel(state, shown, sensor, None if state else law, arbitrary_zero=one.zero == "arbitrary")

    def _unit_text(self, state: str, unit: Unit | None) -> str:
        q = state.removeprefix("d")
        if state in self._states:
            return str(self._states[state].unit)
        if q in self._coordinates:
            return f"{self._coordinates[q].unit}{'/s' if state != q else ''}"
        return "-" if unit is None or unit.is_plain else str(unit)

    def _sensor(self, reads: str) -> str:
        """An encoder (of a coordinate's own, where there are several), or a sensor called after the state."""
        read = {one.name for one in names_in(parse_expression(reads))}
        q = next((name for name in self._coordinates if name in read), "")
        if not self._coordinates:
            return f"{reads.lower()}_sensor" if reads in self._states else "sensor"
        return "encoder" if len(self._coordinates) == 1 or not q else f"{q.lower()}_encoder"

    def _slots(self, channels: Mapping[str, Channel]) -> dict[str, Slot]:
        found: dict[str, Slot] = {}
        for name, slot in self._given_slots() if self._file.slots else self._usual_slots(channels):
            if name in found:
                raise InputError(self._path, f"slots.{name}", "stands twice: name them under `slots`")
            found[name] = slot
        return found

    def _given_slots(self) -> Iterator[tuple[str, Slot]]:
        drives = [name for name, one in self._file.slots.items() if one.kind == "actuator"]
        for name, one in self._file.slots.items():
            key = f"slots.{name}"
            if name in drives[1:]:
                raise InputError(self._path, key, f"{drives[0]} is the actuator, and there is one: the first input's")
            known, word = (self._states, "state") if one.kind == "store" else (self._coordinates, "coordinate")
            if one.coordinate not in known:
                raise InputError(self._path, f"{key}.coordinate", f"{one.coordinate!r} is no {word}")
            for channel in one.channels:
                if self._file.channels and channel not in self._file.channels:
                    raise InputError(self._path, f"{key}.channels", f"{channel!r} is no channel")
            yield name, self._slot(one.kind, one.coordinate, one.channels, one.device)

    def _usual_slots(self, channels: Mapping[str, Channel]) -> Iterator[tuple[str, Slot]]:
        """The drive of the first input, a body and whoever pushes for each coordinate, a store for each
        first-order state, and the sensors."""
        for name in [*self._inputs][:1]:
            yield "actuator", self._slot("actuator", self._equations.acting.get(name, ""))
        for q in self._coordinates:
            before = "" if len(self._coordinates) == 1 else f"{q.lower()}_"
            yield f"{before}body", self._slot("body", q)
            yield f"{before}external", self._slot("push", q)
        for name in self._states:
            alone = len(self._states) == 1 and not self._coordinates
            yield "store" if alone else f"{name.lower()}_store", Slot("store", name)
        for sensor in dict.fromkeys(one.sensor for one in channels.values()):
            read = tuple(name for name, one in channels.items() if one.sensor == sensor)
            q = next((q for name in read for q in self._coordinates if channels[name].state in (q, f"d{q}")), "")
            device = next((device for device in DEVICES if device in sensor), "")
            yield sensor, self._slot("sensor", q, read, device)

    def _slot(self, kind: str, q: str, channels: tuple[str, ...] = (), device: str = "") -> Slot:
        if not q or kind == "store":  # of first-order states
            return Slot(kind, q, channels, device=device)
        one = self._coordinates[q]
        viscous = self._equations.viscous(q) if kind == "body" else None
        return Slot(
            kind,
            q,
            channels,
            turns=one.unit == ANGLE,
            device=device,
            speed=one.usual_rate or USUAL_RATE[one.unit],
            viscous=None if viscous is None else _parameter_law(viscous),
        )

    def _scales(self) -> dict[str, float]:
        named = {name: one.usual for name, one in (*self._coordinates.items(), *self._states.items())}
        named |= {f"d{q}": one.usual_rate for q, one in self._coordinates.items()}
        named |= {name: one.usual for name, one in self._inputs.items()}
        return {name: size for name, size in named.items() if size is not None}


def _parameter_law(name: str) -> Callable[[Point], Any]:
    return lambda s: s.p[name]


def _whole(entries: Mapping[str, Any], make: Callable[[str], Any]) -> dict[str, Any]:
    """Records, where a text stands for one."""
    return {name: make(one) if isinstance(one, str) else one for name, one in entries.items()}
