"""Plants that are programs: a Python file that defines PLANT or `plant()`, as a `Plant` that was tried.

Such a file is the user's own: it runs with the rights of who calls us.

Rules of this file: whatever is wrong in such a file is one `InputError`; the daemon never comes here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import isfinite, isnan
from pathlib import Path
from typing import Any

import casadi as ca

from hoopd.files.plant import LONGEST_SAMPLE_S
from hoopd.files.reading import InputError
from hoopd.files.records import between
from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import Effect
from hoopd.plants.user_program import executed, wrong_program


def program_plant(path: Path) -> Plant:
    """The plant that a program declares; InputError says what is wrong with it."""
    space = executed(path)
    made = _tried(path, lambda: space["plant"]() if callable(space.get("plant")) else space.get("PLANT"))
    if not isinstance(made, Plant):
        reason = (
            "defines neither PLANT nor plant()" if made is None else f"a Plant is expected, not {type(made).__name__}"
        )
        raise InputError(path, "PLANT", reason)
    _tried(path, lambda: _check_values(path, made))
    _check_equations(path, made)
    return made


def _tried(path: Path, work: Callable[[], Any]) -> Any:
    try:
        return work()
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        raise wrong_program(path, error) from None


def _check_values(path: Path, plant: Plant) -> None:
    """InputError for a number, a name or a slot that is none."""
    for key, number in _numbers(plant):
        if isinstance(number, str) or not _is_finite(number):
            raise InputError(path, key, f"must be a finite number, not {number!r}"[:200])
    for key, text in _texts(plant):
        if not isinstance(text, str):
            raise InputError(path, key, f"must be text, not {text!r}"[:200])
    for name, slot in plant.slots.items():
        if not isinstance(slot, Slot):
            raise InputError(path, f"slots.{name}", f"a Slot is expected, not {type(slot).__name__}")
    for name, (low, high) in plant.bounds.items():
        if isnan(low) or isnan(high) or not low <= plant.values[name] <= high:
            raise InputError(path, f"bounds.{name}", f"{low} to {high} do not hold the value {plant.values[name]}")
    between(path, "time_scale_s", plant.time_scale_s, 0.0, LONGEST_SAMPLE_S)


def _is_finite(number: Any) -> bool:
    try:
        return isfinite(float(number))
    except (TypeError, ValueError, OverflowError):
        return False


def _numbers(plant: Plant) -> Iterator[tuple[str, Any]]:
    for field in ("values", "held", "scales"):
        yield from ((f"{field}.{name}", number) for name, number in getattr(plant, field).items())
    yield from (("usual_force", plant.usual_force), ("time_scale_s", plant.time_scale_s))
    yield from ((f"inputs.{one.name}.limit", one.limit) for one in plant.inputs if one.limit is not None)
    yield from ((f"slots.{name}.speed", one.speed) for name, one in plant.slots.items() if isinstance(one, Slot))


def _texts(plant: Plant) -> Iterator[tuple[str, Any]]:
    yield "name", plant.name
    for field in ("coordinates", "first_order", "free", "values", "units", "held", "channels", "slots", "scales"):
        yield from ((field, name) for name in getattr(plant, field))
    yield from ((f"units.{name}", unit) for name, unit in plant.units.items())
    for one in plant.inputs:
        yield from (("inputs", one.name), (f"inputs.{one.name}.unit", one.unit))
    for name, channel in plant.channels.items():
        yield from ((f"channels.{name}.unit", channel.unit), (f"channels.{name}.sensor", channel.sensor))


def _check_equations(path: Path, plant: Plant) -> None:
    """InputError where a program's functions raise, or give another number of values than is wanted of them."""
    x, u = ca.SX.sym("x", len(plant.states)), ca.SX.sym("u", max(1, len(plant.inputs)))
    p = {name: ca.SX.sym(name) for name in plant.values}
    s = plant.point(x, p, u if len(plant.inputs) > 1 else u[0])
    seen = plant.reading_point(x, p, ca.SX.sym("t"))
    force = ca.SX.sym("force", len(plant.coordinates))
    parts: dict[str, tuple[int, Callable[[], Any]]] = {
        "accelerations": (len(plant.coordinates), lambda: plant.accelerations(s, force)),
        "rates": (len(plant.first_order), lambda: plant.rates(s)),
    }
    for name, one in plant.channels.items():
        if (reading := one.reading) is not None:
            parts[f"channels.{name}"] = 1, lambda reading=reading: reading(seen)  # type: ignore[misc]
    if (energy := plant.energy) is not None:
        parts["energy"] = 1, lambda: energy(seen)
    for name, (wanted, value) in parts.items():
        if wanted and (found := _tried(path, lambda value=value: ca.SX(value()).numel())) != wanted:  # type: ignore[misc]
            raise InputError(path, name, f"gives {found} values, {plant.name} has {wanted}")
    for effect in _tried(path, lambda: () if plant.own_effects is None else tuple(plant.own_effects(plant))):
        if not isinstance(effect, Effect):
            raise InputError(path, "own_effects", f"an Effect is expected, not {type(effect).__name__}")
