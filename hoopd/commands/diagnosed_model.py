"""The model of a diagnosis: the judged one with re-estimated parameters, and the effects that were named.

Rules of this file: from an outcome to a `ModelFile`; nothing is judged here. A number that a file cannot hold (an
infinite neutral value) is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeVar

import msgspec
import numpy as np

from hoopd.diagnose.findings import base_of, is_in_vocabulary, parameters_of
from hoopd.diagnose.record import Base, EffectFinding, Quantity
from hoopd.diagnose.record_file import to_digits
from hoopd.diagnose.run import Outcome
from hoopd.diagnose.search.effect_changes import at_nodes
from hoopd.files.model import EffectEntry, ModelFile, Parameter, PlantModelFile
from hoopd.plants.effects.base import Effect, ranges_of
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.stretch_scatter import interval

Model = TypeVar("Model", bound=ModelFile | PlantModelFile)
# A region of validity is where the recordings were, without their rarest places.
LEAST, MOST = 0.005, 0.995
# What is told with one of these is in no model.
DOUBTED = ("weak", "not_confirmed")
# Phases of two recordings that differ by less than this (rad) are one: the encoder's zero stayed where it was.
SAME_PHASE = 0.3


def found_model(outcome: Outcome, base: Model, name: str) -> Model:
    """The base with re-estimated parameters, and its effects and the named ones, where the library knows them."""
    final = outcome.written.fit
    quantities = base_of(base.name, outcome.named, final).parameters
    parameters = {key: _parameter(one) for key, one in quantities.items() if "." not in key}
    old = {entry.name: entry for entry in base.effects}
    entries = {**old, **{effect.name: entry_of(effect, final, old.get(effect.name)) for effect in _known(final)}}
    accepted = {one.effect.name for one in outcome.named.accepted}
    for one in outcome.diagnosis.effects:  # faults of a sensor are in no fit
        if one.status in DOUBTED or one.name in accepted:
            continue
        if (
            one.slot in final.tracks[0].stretch.plant.slots
            and one.name not in entries
            and is_in_vocabulary(one.name, final)
        ):
            entries[one.name] = EffectEntry(name=one.name, parameters=_parameters(one.parameters))
    return msgspec.structs.replace(
        base, name=name, parameters={**base.parameters, **parameters}, effects=list(entries.values())
    )


def left_out(outcome: Outcome) -> list[str]:
    """Why named effects are not in the model: a user's own, and what is denied, hardly borne out, or does harm."""
    return [
        f"{one.name} is not in the model: {_why_left_out(one)}"
        for one in outcome.diagnosis.effects
        if one.in_model is False and not one.is_unknown
    ]


def _why_left_out(one: EffectFinding) -> str:
    if one.status == "not_confirmed":
        return "held-out data do not confirm it"
    return one.reason or "its evidence is weak"


def doubts(outcome: Outcome) -> list[str]:
    """What of the model no one would expect of a device: to be said, and agreed to, before it is written."""
    return [*flipped(base_of("", outcome.named, outcome.written.fit)), *outside(outcome)]


def flipped(base: Base) -> list[str]:
    """Parameters that have another sign than in the judged model."""
    return [
        f"{name} has the other sign: {one.value:g} {one.unit}, {one.nominal:g} before{_either(one)}"
        for name, one in base.parameters.items()
        if one.value is not None and one.nominal is not None and one.value * one.nominal < 0.0
    ]


def _either(one: Quantity) -> str:
    low, high = one.ci95 or (None, None)
    return " (its interval holds both)" if low is not None and high is not None and low < 0.0 < high else ""


def outside(outcome: Outcome) -> list[str]:
    """Parameters of the plant and of effects beyond the bounds that they are declared with."""
    final, found = outcome.written.fit, list[str]()
    bounds = {n: ends for track in final.tracks for n, ends in track.stretch.plant.bounds.items()}
    bounds |= ranges_of(_known(final))
    for name, (low, high) in bounds.items():
        value = final.values.get(name)
        if value is not None and not low <= value <= high:
            found.append(f"{name} is {value:g}, beyond the {low:g} to {high:g} that it can be")
    return found


def _known(final: HypothesisFit) -> Iterable[Effect]:
    return (effect for effect in final.effects if is_in_vocabulary(effect.name, final))


def entry_of(effect: Effect, final: HypothesisFit, old: EffectEntry | None = None) -> EffectEntry:
    """One effect as fitted; `old`: the entry that it had, whose region is kept."""
    found = parameters_of(effect, final)
    for one in effect.parameters:
        if one.per_recording and one.role == "phase":
            found[one.name] = msgspec.structs.replace(found[one.name], **_phase(effect.key(one.name), final))
    valid = dict(old.valid) if old is not None and old.valid else region(effect, final)
    return EffectEntry(name=effect.name, parameters=_parameters(found), valid=valid)


def _phase(key: str, final: HypothesisFit) -> dict[str, object]:
    """Value and interval of a phase: of all recordings where they agree, else of the last one."""
    own = {name: value for name, value in final.values.items() if name.startswith(f"{key}@")}
    if not own:
        return {}
    last = next(reversed(own.values()))
    off = np.angle(np.exp(1j * (np.array([*own.values()]) - last)))
    if np.ptp(off) > SAME_PHASE:
        return {"value": last, "ci95": None}
    ends = [ends for ends in (interval(final, name) for name in own) if ends is not None]
    half = float(np.sqrt(np.mean([((high - low) / 2.0) ** 2 for low, high in ends] or [0.0]) / len(own)))
    value = float(last + off.mean())
    return {"value": value, "ci95": (value - half, value + half) if half else None}


def region(effect: Effect, final: HypothesisFit) -> dict[str, tuple[float, float]]:
    """By what an effect depends on: where the recordings were; an angle that made a whole turn was everywhere."""
    found, turning = {}, _turning(final)
    for name in effect.depends_on:
        parts = [
            np.ravel(getattr(here, name))
            for here in (at_nodes(track, final) for track in final.tracks)
            if name == "u" or (name in turning and name in here)
        ]
        if not parts:
            continue
        low, high = (float(q) for q in np.quantile(np.concatenate(parts), (LEAST, MOST)))
        if low < high and not (turning.get(name) and high - low > 2.0 * np.pi):
            found[name] = (low, high)
    return found


def _turning(final: HypothesisFit) -> dict[str, bool]:
    """Every state, and what is held, of the plants: whether it comes back after a turn."""
    found = dict[str, bool]()
    for plant in (track.stretch.plant for track in final.tracks):
        angles = {slot.coordinate for slot in plant.slots.values() if slot.turns}
        found |= {name: name in angles or found.get(name, False) for name in (*plant.states, *plant.held)}
    return found


def _parameters(quantities: Mapping[str, Quantity]) -> dict[str, Parameter]:
    """Without those of single recordings, and without what is no number."""
    return {
        name: _parameter(one)
        for name, one in quantities.items()
        if "@" not in name and one.value is not None and np.isfinite(one.value)
    }


def _parameter(one: Quantity) -> Parameter:
    assert one.value is not None
    low, high = one.ci95 or (None, None)
    interval = None if low is None or high is None else (to_digits(low), to_digits(high))
    nominal = one.nominal if one.nominal is not None and np.isfinite(one.nominal) else None
    return Parameter(value=to_digits(one.value), unit=one.unit, ci95=interval, nominal=nominal)
