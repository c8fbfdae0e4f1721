"""The name and the words in which plants were declared before, for files that still use them."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from math import inf

import casadi as ca

from hoopd.core.limits import TORQUE_LIMIT_NM
from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.effects.base import Point


def DeclaredPlant(  # the name under which plants were declared before
    name: str,
    coordinates: tuple[str, ...],
    accelerations: Callable[[Point, ca.SX], ca.SX],
    values: Mapping[str, float],
    free: tuple[str, ...],
    driven: str | None,
    channels: Mapping[str, str],
    slots: Mapping[str, Slot],
    held: Mapping[str, float] | None = None,
    units: Mapping[str, str] | None = None,
    least: Mapping[str, float] | None = None,
    force_unit: str = "N m",
    limit: float = TORQUE_LIMIT_NM,
) -> Plant:
    """A `Plant` in the words of earlier versions."""
    warnings.warn("DeclaredPlant is now Plant, with inputs, channels and bounds", DeprecationWarning, stacklevel=2)
    return Plant(
        name=name,
        coordinates=coordinates,
        accelerations=accelerations,
        values=values,
        free=free,
        inputs=(Input("u", force_unit, limit, driven),),
        channels={channel: Channel(state) for channel, state in channels.items()},
        slots=slots,
        held=held or {},
        units=units or {},
        bounds={parameter: (low, inf) for parameter, low in (least or {}).items()},
    )
