"""A user's own effects: a Python file that defines EFFECTS or `effects(plant)`.

Rules of this file: whatever is wrong in such a file is one `InputError`; the daemon never comes here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import islice
from math import isfinite
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.files.reading import InputError
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.free_run import readings
from hoopd.plants.plant_with_effects import Composite
from hoopd.plants.user_program import executed, line_of, reason_of, wrong_program

NAME = re.compile(r"[a-z][a-z0-9_]*\.[a-z][a-z0-9_]*")
# Where an effect is tried: some motion of everything, for as long as a delay may be.
TRIED_STEPS, TRIED_SPEED, TRIED_INPUT = 10, 0.3, 0.1
# Far more than anybody writes: what has no end is told, and steps that fine take hours.
MOST_EFFECTS, MOST_SUBSTEPS = 1000, 1000
# Of its largest reading, what halving the step may change a plant that is to be tried on.
RESOLVED = 0.1


def load_effects(path: Path, plant: Plant) -> tuple[Effect, ...]:
    """The effects of a user's file for a plant, tried on it; InputError says which line or which effect is wrong."""
    space = executed(path)
    try:
        made = space["effects"](plant) if callable(space.get("effects")) else space.get("EFFECTS")
        effects = tuple(islice(made, MOST_EFFECTS + 1)) if isinstance(made, Iterable) else None
    except (Exception, SystemExit) as error:
        raise wrong_program(path, error) from None
    if effects is None:
        raise InputError(path, "", "defines neither EFFECTS nor effects(plant)")
    if len(effects) > MOST_EFFECTS:
        raise InputError(path, "EFFECTS", f"more than {MOST_EFFECTS} effects")
    for effect in effects:
        _check(path, plant, effect)
    return effects


def _check(path: Path, plant: Plant, effect: Any) -> None:
    if not isinstance(effect, Effect):
        raise InputError(path, "EFFECTS", f"an Effect is expected, not {type(effect).__name__}")
    if not isinstance(effect.name, str) or not NAME.fullmatch(effect.name):
        raise InputError(path, str(effect.name), "a name is slot.effect, in small letters, digits and _")
    _check_kinds(path, effect)
    names = [one.name for one in effect.parameters]
    if len(set(names)) < len(names):
        raise InputError(path, effect.name, "a parameter stands twice")
    for field, known in _used(plant, effect):
        if field not in known:
            raise InputError(path, effect.name, f"{field!r} is none of {', '.join(known) or 'nothing'}")
    try:
        neutral, sized = _tried(plant, effect)
    except (Exception, SystemExit) as error:
        raise InputError(path, effect.name, f"{line_of(error, path)} {reason_of(error)}".strip()) from None
    substeps = Composite(plant, (effect,)).substeps
    plain, finer = (_tried(plant, None, count)[0] for count in (substeps, 2 * substeps))
    if not (np.isfinite(plain).all() and np.abs(plain - finer).max() <= RESOLVED * np.abs(finer).max()):
        faster = f"{plant.name} itself moves faster than its usual sample time of {plant.time_scale_s:g} s"
        raise InputError(path, effect.name, f"{faster}: declare a shorter time_scale_s")
    if not np.array_equal(neutral, plain):
        raise InputError(path, effect.name, "its neutral values change the model")
    if not np.isfinite(sized).all():
        raise InputError(path, effect.name, "with its parameters at their usual sizes the model is not finite")


def _check_kinds(path: Path, effect: Effect) -> None:
    """InputError for parameters that are none, numbers that are not finite, and words that are no text."""
    found = effect.parameters
    if not isinstance(found, tuple | list) or not all(isinstance(one, EffectParameter) for one in found):
        raise InputError(path, effect.name, "parameters: a tuple of EffectParameter is expected")
    for p in effect.parameters:
        if not isinstance(p.name, str) or not isinstance(p.unit, str):
            raise InputError(path, effect.name, f"name and unit of a parameter are text, not {p.name!r}, {p.unit!r}")
        if not all(isinstance(one, Real) and isfinite(one) for one in (p.neutral, p.low, p.high, *p.grid)):
            raise InputError(path, effect.name, f"{p.name}: neutral, low, high and grid are finite numbers")
    if not isinstance(effect.substeps, int) or not 0 <= effect.substeps <= MOST_SUBSTEPS:
        raise InputError(path, effect.name, f"substeps: a whole number from 0 to {MOST_SUBSTEPS} is expected")
    for field in ("statement", "signature", "sign", "best_experiment", "write_back", "found_by"):
        if not isinstance(getattr(effect, field), str):
            raise InputError(path, effect.name, f"{field}: must be text")


def _used(plant: Plant, effect: Effect) -> Iterable[tuple[str, tuple[str, ...]]]:
    """Names that must be among others: parameters of delays and lags, channels of sensors."""
    own, channels = tuple(one.name for one in effect.parameters), tuple(plant.channels)
    times = (effect.delay, effect.lag, *effect.latency.values(), *effect.sensor_lag.values())
    yield from ((time, own) for time in times if time is not None)
    yield from ((channel, channels) for channel in (*effect.latency, *effect.sensor_lag))


def _tried(plant: Plant, effect: Effect | None, substeps: int | None = None) -> tuple[Any, Any]:
    """What a plant reads in a short run: with the effect neutral, and at its usual sizes."""
    composite = Composite(plant, (effect,) if effect else (), substeps)
    sizes = {effect.key(p.name): p.neutral + p.size for p in effect.parameters} if effect else {}
    return _run(composite, {}), _run(composite, sizes)


def _run(composite: Composite, values: Mapping[str, float]) -> Any:
    plant = composite.plant
    t, inputs = np.arange(TRIED_STEPS + 1) * plant.time_scale_s, max(1, len(plant.inputs))
    u = np.full((TRIED_STEPS, inputs), TRIED_INPUT * plant.usual_input).squeeze(axis=1 if inputs == 1 else ())
    start = [TRIED_SPEED * (i % 2 + 0.5) for i in range(len(plant.states))]
    return np.stack(list(readings(composite, values, start, t, u).values()))
