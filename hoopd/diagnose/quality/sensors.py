"""The channels of a plant as sensors to be judged: what they read, how they err, and whether that moves at all.

Rules of this file: read off the plant's declaration; no data.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from hoopd.plants.declaration import Plant
from hoopd.plants.relative_degree import relative_degrees

CAMERA, ENCODER = "camera", "encoder"


class Sensor(NamedTuple):
    """One channel."""

    name: str
    coordinate: str  # which it reads, or whose rate; empty: something else
    is_rate: bool  # of a coordinate
    slot: str
    device: str
    turns: bool  # the angle comes back after a turn
    moves: bool  # the coordinate moves in the recording
    resolution: float | None  # step of a counting sensor, where it is known
    integrals: int  # how often an input is integrated to get what it reads

    @property
    def is_camera(self) -> bool:
        """Frames may be late, lost or of something else."""
        return self.device == CAMERA

    @property
    def is_place(self) -> bool:
        """It reads a coordinate itself."""
        return bool(self.coordinate) and not self.is_rate


def sensors_of(plant: Plant, moving: Plant) -> dict[str, Sensor]:
    """Every channel of a plant, of which `moving` moves."""
    return {name: _sensor(plant, moving, name, degree or 1) for name, degree in relative_degrees(plant).items()}


def _sensor(plant: Plant, moving: Plant, name: str, integrals: int) -> Sensor:
    channel = plant.channels[name]
    rate = channel.state.removeprefix("d") in plant.coordinates and channel.state not in plant.coordinates
    coordinate = channel.state.removeprefix("d") if rate else channel.state
    coordinate = coordinate if coordinate in plant.coordinates else ""
    slot = plant.slots.get(channel.sensor)
    device, turns = (slot.device, slot.turns) if slot is not None else ("", False)
    moves = not coordinate or coordinate in moving.coordinates
    return Sensor(name, coordinate, rate, channel.sensor, device, turns, moves, channel.resolution, integrals)


def rates_of(sensors: Mapping[str, Sensor]) -> dict[str, str]:
    """Channels of a rate, with the channel that reads its coordinate."""
    places = {one.coordinate: name for name, one in sensors.items() if one.is_place}
    return {name: places[one.coordinate] for name, one in sensors.items() if one.is_rate and one.coordinate in places}


def turning_cameras(sensors: Mapping[str, Sensor]) -> list[str]:
    """Channels in which a camera sees an angle that comes back after a turn."""
    return [name for name, one in sensors.items() if one.is_camera and one.turns]
