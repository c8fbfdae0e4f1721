"""What is missing at the slot of an effect, sample by sample, and what the effect itself would put there.

A force: the model without this effect, everything else as fitted, is smoothed along the recording; the disturbance that
its filter needs is the missing force, and nothing of the effect went into it. A sensor: measured less what the model
reads without the effect. The law beside it is the effect's own change of the one-step map, as the force that makes the
same change, or its own change of the reading: evaluated by the physics itself, whatever kind of effect it is.

Rules of this file: numbers from fits, nothing fitted anew; no name of an effect or of a slot stands here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.effect_changes import at_nodes
from hoopd.diagnose.search.screen import Column, change_of
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.usual_sizes import channel_unit, state_unit, store_rate, turns, units
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.reference_track import Track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Variable:
    """What a missing force may follow: values (n,) at its instants, in one turn if it is an angle that turned round."""

    name: str
    unit: str
    value: Array
    turning: bool = False


@dataclass(frozen=True)
class MissingForceSamples:
    """Missing force or reading's error of one effect in one recording, (n,) each; NaN between two stretches."""

    recording: str
    unit: str
    t_s: Array
    value: Array
    law: Array
    variables: tuple[Variable, ...]
    reading: bool = False  # an error of a sensor


def missing_of(
    effect: Effect, final: HypothesisFit, noise: Mapping[str, Noise], recording: str
) -> MissingForceSamples | None:
    """Of one effect of a fit in one recording; noise: of a fit without it; None when its slot is not there."""
    own = [track for track in final.tracks if track.stretch.recording == recording]
    own = [track for track in own if effect.slot in track.stretch.plant.slots]
    if not own:
        return None
    without = _without(effect, final, own, noise)
    of = _reading if effect.sensor or effect.latency or effect.sensor_lag else _force
    parts = [of(effect, final, without, old, new) for old, new in zip(own, without.tracks, strict=True)]
    return _joined(parts)


def missing_where_it_acts(
    effect: Effect, final: HypothesisFit, noise: Mapping[str, Noise]
) -> MissingForceSamples | None:
    """As `missing_of`, of the recording in which the effect makes most; of what is the same in all of them, of that
    which has most readings.

    What has a time or a phase of its own in each recording may act in one of them alone.
    """
    names = [recording_with_most(final, effect.slot)]
    if any(one.per_recording for one in effect.parameters):
        names = [*dict.fromkeys([*names, *final.recordings])]
    found = [missing_of(effect, final, noise, name) for name in names if name is not None]
    return max((one for one in found if one is not None), key=lambda one: float(np.nansum(one.law**2)), default=None)


def recording_with_most(found: HypothesisFit, slot: str) -> str | None:
    """Where a slot has most readings."""
    samples: dict[str, int] = {}
    for track in found.tracks:
        if slot in track.stretch.plant.slots:
            samples[track.stretch.recording] = samples.get(track.stretch.recording, 0) + track.stretch.samples
    return max(samples, key=lambda name: samples[name], default=None)


def _without(
    effect: Effect, final: HypothesisFit, tracks: Sequence[Track], noise: Mapping[str, Noise]
) -> HypothesisFit:
    """The fit's numbers with one effect left out, its trajectories smoothed anew."""
    rest = tuple(one for one in final.effects if one.name != effect.name)
    new = [Track(track.stretch, rest).like(track) for track in tracks]
    for track in new:
        track.smooth(final.values, noise[track.stretch.recording])
    return HypothesisFit(rest, final.values, (), new, dict(noise))


def _own_values(effect: Effect, final: HypothesisFit, track: Track) -> Column:
    """The effect as fitted, what belongs to the recording included."""
    local = track.local(final.values)
    return Column(tuple((p.name, local.get(effect.key(p.name), p.neutral)) for p in effect.parameters))


def _force(effect: Effect, final: HypothesisFit, without: HypothesisFit, old: Track, new: Track) -> MissingForceSamples:
    plant = new.stretch.plant
    change, _ = change_of(new, without, effect, _own_values(effect, final, old))
    every, moved = _as_force(new, without, change), plant.slots[effect.slot].coordinate
    # a drive that feeds first-order states shows in the one that it moves most
    column = plant.disturbed.index(moved) if moved in plant.disturbed else int(np.argmax(_norms(every, plant)))
    law, unit = np.append(every[:, column], np.nan), plant.disturbance_unit(plant.disturbed[column])
    variables = variables_of(effect, new, without)
    return MissingForceSamples(new.stretch.recording, unit, new.stretch.t, new.w[:, column], law, variables)


def _norms(forces: Array, plant: Plant) -> Array:
    """Of first-order states' rates (n-1, nw) over their usual ones."""
    usual = [store_rate(plant, name) if name in plant.first_order else np.inf for name in plant.disturbed]
    return np.asarray(np.linalg.norm(forces, axis=0) / usual)


def _as_force(track: Track, found: HypothesisFit, change: Array) -> Array:
    """(n-1, nq) forces on the coordinates, held over a step, that change the one-step map so."""
    model = track.columns(found.values, ()).model
    # change = W force, in the least-squares sense
    return np.asarray(np.einsum("nqz,nz->nq", np.linalg.pinv(model.w[:, : model.nx]), change[:, : model.nx]))


def _reading(
    effect: Effect, final: HypothesisFit, without: HypothesisFit, old: Track, new: Track
) -> MissingForceSamples:
    # along the trajectory of the fit that has the effect: without it the trajectory bends after the reading
    along = Track(new.stretch, without.effects).like(old)
    fit = HypothesisFit(without.effects, final.values, (), [along], without.noise)
    _, loss = change_of(along, fit, effect, _own_values(effect, final, old))
    error = new.stretch.y - along.readings(final.values)
    column = _most_changed(effect, loss, without.noise[new.stretch.recording], along)
    channel, plant = along.composite.channels[column], new.stretch.plant
    unit = channel_unit(plant, channel)
    variables = variables_of(effect, along, fit)
    if effect.latency or effect.sensor_lag:
        variables = (_rate_of(along, channel),)
    return MissingForceSamples(
        new.stretch.recording, unit, new.stretch.t, error[:, column], -loss[:, column], variables,
        reading=True,
    )  # fmt: skip


def _most_changed(effect: Effect, loss: Array, noise: Noise, track: Track) -> int:
    """The channel that shows the effect best."""
    seen = np.isfinite(track.stretch.y)
    return int(np.argmax([np.linalg.norm(loss[seen[:, i], i]) / noise.reading[i] for i in range(loss.shape[1])]))


def _rate_of(track: Track, channel: str) -> Variable:
    """How fast a channel's true value changes: what is late is wrong in proportion to it."""
    plant, t = track.stretch.plant, track.stretch.t
    name = plant.state_of(channel)
    if not name:  # an expression: what it reads itself
        read = track.stretch.y[:, list(plant.channels).index(channel)]
        return Variable(rate_name(plant, channel), f"{channel_unit(plant, channel)}/s", np.gradient(read, t))
    value = np.gradient(track.z[:, plant.states.index(name)], t)
    second = name not in (*plant.coordinates, *plant.first_order)
    unit = f"{units(plant).coordinate}/s2" if second else f"{state_unit(plant, name)}/s"
    return Variable(rate_name(plant, channel), unit, value)


def rate_name(plant: Plant, channel: str) -> str:
    """What is late is wrong in proportion to: the rate of what a channel reads."""
    name = plant.state_of(channel)
    return f"d{name}" if name else f"{channel}'"


def follows(effect: Effect, plant: Plant, channel: str | None) -> tuple[str, ...]:
    """What a missing force is drawn against, and the time; of what is late in several channels, the `channel`."""
    late = {**effect.latency, **effect.sensor_lag}
    if late:
        return (rate_name(plant, channel if channel in late else next(iter(late))),)
    return effect.depends_on


def variables_of(effect: Effect, track: Track, found: HypothesisFit) -> tuple[Variable, ...]:
    """What an effect says that it depends on, the time apart: that is drawn anyway."""
    plant, here = track.stretch.plant, at_nodes(track, found)
    names = [name for name in effect.depends_on if name in here or name == "u"]
    rolling = _rolling(effect.slot, plant, names, track.z)
    rest = [name for name in names if not (rolling and name.startswith("d"))]
    return (*rolling, *(_variable(plant, name, np.ravel(getattr(here, name))) for name in rest))


def _rolling(slot: str, plant: Plant, names: Sequence[str], z: Array) -> tuple[Variable, ...]:
    """Of a contact, which rubs with the difference of two rates, that difference."""
    rates = [name for name in names if name in plant.states and name not in plant.coordinates]
    if plant.slots[slot].kind != "rolling_ball" or len(rates) < 2:
        return ()
    a, b = (z[:, plant.states.index(name)] for name in rates[:2])
    return (Variable(f"{rates[0]}-{rates[1]}", units(plant).rate, a - b),)


def _variable(plant: Plant, name: str, value: Array) -> Variable:
    if name == "u":
        return Variable(name, plant.force_unit, value)
    entered = next((one.unit for one in plant.inputs if one.name == name), None)
    if entered is not None:
        return Variable(name, entered, value)
    if name not in plant.coordinates:
        return Variable(name, state_unit(plant, name), value)
    return Variable(name, units(plant).coordinate, value, turns(plant, name))


def _in_a_turn(whole: Variable) -> Variable:
    """An angle that turned round comes back after a turn; one that swings about a place stays as it is."""
    if not whole.turning or np.nanmax(whole.value) - np.nanmin(whole.value) < 2 * np.pi:
        return replace(whole, turning=False)
    return replace(whole, value=np.mod(whole.value, 2 * np.pi))


def _joined(parts: Sequence[MissingForceSamples]) -> MissingForceSamples:
    """Stretches of one recording, a NaN between two."""

    def chained(arrays: Sequence[Array]) -> Array:
        return np.concatenate([part for one in arrays for part in (one, [np.nan])][:-1])

    first = parts[0]
    variables = tuple(
        _in_a_turn(replace(one, value=chained([part.variables[i].value for part in parts])))
        for i, one in enumerate(first.variables)
    )
    t, value, law = (chained([getattr(part, name) for part in parts]) for name in ("t_s", "value", "law"))
    return MissingForceSamples(first.recording, first.unit, t, value, law, variables, first.reading)
