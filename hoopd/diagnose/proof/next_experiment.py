"""The experiment that would tell two explanations apart best: T-optimal among those of `experiment_menu`.

Each experiment is simulated with the final model; along it the changes of both explanations are whitened with the
noise levels of the fit, and stacked on those of the recordings that are there already, so that base and rival are
re-fitted to both together. What the new recording brings is the difference in expected nats.

Rules of this file: it proposes and says what to expect; nothing runs here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from hoopd.diagnose.proof.experiment_menu import Entry, command, entries
from hoopd.diagnose.proof.not_excluded import Separation
from hoopd.diagnose.proof.separation import (
    Rows,
    condensed,
    linear,
    nats_apart,
    nats_seen,
    rows_beside,
    rows_of,
    without_effect,
)
from hoopd.diagnose.record import PARAMETERS, NextExperiment, Quantity
from hoopd.diagnose.search.naming import NOT_EXCLUDED_NATS, Named
from hoopd.diagnose.search.screen import Member
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.composites import composite_of, fitting_effects
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.kalman_filter import Noise
from hoopd.plants.likelihood.recording_parameters import own_values, values_of
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Held, Stretch

# An interval reaches this many standard errors.
ERRORS = 2.0
# The best of some thirty candidates is beyond it by chance in one recording of five: 30 exp(-5).
WORTH_A_LOOK_NATS = 5.0
# What the recording to come is called.
NEXT = "the next recording"


@dataclass(frozen=True)
class Pair:
    """An effect that is taken for true, the rival that it is to be told from, and the fits with and without it."""

    final: HypothesisFit
    effect: Effect
    rival: Effect
    ablated: HypothesisFit
    apart: float = 0.0  # nats by which the recordings tell them apart


@dataclass(frozen=True)
class Expected:
    """An entry of the menu and the nats that it adds to what the recordings say already."""

    entry: Entry
    nats: float


def next_experiment(
    named: Named, found: Mapping[str, Separation], library: Mapping[str, Effect], seed: int = 0
) -> NextExperiment | None:
    """For the pair that is hardest to tell apart; None where there is nothing to tell."""
    if not named.accepted:
        return _to_see_the_likeliest(named, seed)
    pair = _pair(named, found, library)
    if pair is None:
        return _change_of_hardware(found, library)
    best = max(expectations(pair, seed), key=lambda one: one.nats, default=None)
    return _by_hand(pair) if best is None else _told(pair, best)


def expectations(pair: Pair, seed: int = 0) -> list[Expected]:
    """Every entry of the menu, in its order."""
    return _expected(pair, None, lambda every: nats_apart(every)[pair.rival.name], seed)


def expected_to_show(pair: Pair, seed: int = 0) -> list[Expected]:
    """Every entry of the menu, and the nats that it adds to what the recordings say of the pair's effect alone."""
    return _expected(pair, [], nats_seen, seed)


def _expected(
    pair: Pair, rivals: Sequence[Effect] | None, counted: Callable[[Sequence[Rows]], float], seed: int
) -> list[Expected]:
    """`rivals`: others than the pair's; `counted`: nats of some recordings' rows together."""
    track = _stage(pair)
    if track is None:
        return []
    period, values = float(np.median(track.stretch.h)), _values_of_next(pair)
    known = rows_of_recordings(pair, rivals)
    before, members = counted([known]), [member for member, _ in known.rivals]
    every = entries(track.composite, {**track.composite.values, **values_of(NEXT, values)}, period, seed)
    return [Expected(one, counted([known, rows_of_entry(pair, one, members)]) - before) for one in every]


def rows_of_recordings(pair: Pair, rivals: Sequence[Effect] | None = None) -> Rows:
    """Both explanations along the recordings that are there, condensed; `rivals`: others than the pair's."""
    about = without_effect(pair.final, pair.effect, pair.ablated, _free_of_next(pair))
    told = [pair.rival] if rivals is None else rivals
    return condensed(rows_beside(about, pair.effect, pair.final.values, told, _recordings(pair.final)))


def rows_of_entry(pair: Pair, entry: Entry, members: Sequence[Member]) -> Rows:
    """The same along an experiment that was not made; `members`: the choices of the rival."""
    rest, track = pair.ablated.effects, _stage(pair)
    assert track is not None
    like = track.stretch
    seen = np.resize(np.isfinite(like.y), (len(entry.t), like.y.shape[1]))
    stretch = Stretch(NEXT, like.plant, entry.t, entry.u, np.where(seen, 0.0, np.nan))
    about = linear(
        [_simulated(stretch, rest, entry)], rest, _values_of_next(pair), (*pair.ablated.free, *_free_of_next(pair)),
        {NEXT: _usual_noise(pair.final, like)},
    )  # fmt: skip
    return rows_of(about, pair.effect, _values_of_next(pair), members)


def why_by_hand(plants: Sequence[Plant]) -> str:
    """Why no signal is proposed for the recorded plants."""
    if not any(plant.inputs for plant in plants):
        return "Nothing drives this plant: by hand."
    if all(len(plant.inputs) > 1 for plant in plants):
        return "Signals are proposed for plants with one input, and this one has several: by hand."
    if any(plant.driven is not None for plant in plants):
        return "No signal of the menu is safe and reaches both on the fitted model: by hand."
    if any(plant.coordinates and plant.first_order for plant in plants):
        return "Signals are proposed for drives of a coordinate, and this plant's acts through a state: by hand."
    if any(plant.coordinates for plant in plants):
        return "The drive does not move what was recorded: by hand."
    return "Signals are proposed for drives of a coordinate, and this plant has none: by hand."


# ---------------------------------------------------------------------------------------------- the pair


def _pair(named: Named, found: Mapping[str, Separation], library: Mapping[str, Effect]) -> Pair | None:
    """The nearest of the alternatives that a recording may exclude; where there is none, the nearest rival at all."""
    first = [(one.nats[name], one.effect, name) for one in found.values() for name in one.open if name in one.nats]
    other = [(nats, one.effect, name) for one in found.values() for name, nats in one.nats.items()]
    never = any(one.never for one in found.values())
    choice = sorted(first or ([] if never else other), key=lambda one: (one[0], one[1].name, one[2]))
    pairs = (_of(named, effect, library[name], max(nats, 0.0)) for nats, effect, name in choice if name in library)
    return next((pair for pair in pairs if pair is not None), None)


def _of(named: Named, effect: Effect, rival: Effect, apart: float) -> Pair | None:
    if effect.name not in rival.contains:
        return Pair(named.final, effect, rival, named.without[effect.name], apart)
    # what contains the effect explains no less: the question is how much more than the effect it is
    fitted = next((one.fit for one in named.tried if one.effect.name == rival.name), None)
    if fitted is None or len(named.accepted) > 1:
        return None
    larger = _where_the_base_is(fitted, named.base)
    return Pair(_as_large_as_it_may_be(larger, rival, effect), rival, effect, named.base, apart)


def _where_the_base_is(fitted: HypothesisFit, base: HypothesisFit) -> HypothesisFit:
    """A fit along the base's seconds; of others it may be, where what a name explains came back after it was tried."""
    here, there = ([track.stretch for track in found.tracks] for found in (base, fitted))
    if [*map(_span, here)] == [*map(_span, there)]:
        return fitted
    return fit(here, fitted.effects, fitted.values, noise=fitted.noise)


def _span(stretch: Stretch) -> tuple[str, int, float, float]:
    return stretch.recording, len(stretch.t), float(stretch.t[0]), float(stretch.t[-1])


def _as_large_as_it_may_be(fitted: HypothesisFit, larger: Effect, effect: Effect) -> HypothesisFit:
    """What a larger effect has beyond the one that it contains, at the end of its interval: the fit may have none."""
    own = {p.name for p in effect.parameters}
    values = dict(fitted.values)
    for p in larger.parameters:
        key = larger.key(p.name)
        if p.role == "amplitude" and p.name not in own and key in fitted.free:
            values[key] = min(values[key] + ERRORS * fitted.deviation(key), p.high)
    return replace(fitted, values=values)


def _recordings(final: HypothesisFit) -> tuple[str, ...]:
    return (*final.recordings, NEXT)


def _free_of_next(pair: Pair) -> tuple[str, ...]:
    """Phases that the next recording has for itself."""
    own = [(e, p) for e in pair.ablated.effects for p in e.parameters if p.per_recording and p.role == "phase"]
    return tuple(f"{e.key(p.name)}@{NEXT}" for e, p in own)


def _stage(pair: Pair) -> Track | None:
    """The first track of a driven plant that has both slots."""
    slots = {pair.effect.slot, pair.rival.slot}
    plants = ((track.stretch.plant, track) for track in pair.final.tracks)
    return next((t for plant, t in plants if _is_played(plant) and slots <= set(plant.slots)), None)


def _is_played(plant: Plant) -> bool:
    """Signals are for the one drive of a coordinate."""
    return plant.driven is not None and len(plant.inputs) == 1


def _values_of_next(pair: Pair) -> dict[str, float]:
    """What belongs to a recording, for the next one as for the one that it is like."""
    track, final = _stage(pair), pair.final
    own = own_values((track or final.tracks[0]).stretch.recording, final.values)
    return {**final.values, **{f"{name}@{NEXT}": value for name, value in own.items()}}


def _usual_noise(final: HypothesisFit, like: Stretch) -> Noise:
    """Geometric mean over the recordings of the same plant."""
    names = dict.fromkeys(t.stretch.recording for t in final.tracks if t.stretch.plant.channels == like.plant.channels)
    every = [final.noise[name] for name in names]
    return Noise(*(np.exp(np.mean(np.log(np.stack(part)), axis=0)) for part in zip(*every, strict=True)))


def _simulated(stretch: Stretch, rest: Sequence[Effect], entry: Entry) -> Track:
    """A model without the effect along the run of the model that has it."""
    composite = composite_of(stretch.plant, fitting_effects(stretch.plant, rest))
    track = Track.of(stretch, Held.of(stretch), composite)
    nx, u = composite.nx, np.append(stretch.u, stretch.u[-1])
    own = min(nx, entry.z.shape[1])
    x = np.zeros((len(entry.t), nx))
    x[:, :own] = entry.z[:, :own]
    # what lags is taken as settled
    z = np.array([composite.beginning(x[k], float(u[k])) for k in range(len(x))])
    track.moved(z, np.zeros((len(x), len(stretch.plant.disturbed))), z, z)
    return track


def _to_see_the_likeliest(named: Named, seed: int) -> NextExperiment | None:
    """Where nothing was named: what would show the likeliest candidate, if it is there at its fitted size."""
    one = next((tried for tried in named.tried if tried.surprise >= WORTH_A_LOOK_NATS), None)
    if one is None:
        return None
    pair = Pair(_where_the_base_is(one.fit, named.base), one.effect, one.effect, named.base, one.gain)
    best = max(expected_to_show(pair, seed), key=lambda entry: entry.nats, default=None)
    if best is None or best.nats <= 0.0:
        return None
    told = _told(pair, best)
    return msgspec.structs.replace(
        told, tells_apart=(one.effect.name, PARAMETERS), apart_nats=None,
        reason=f"{one.effect.name} is the likeliest of what was not found ({one.gain:.1f} nats, too few to name it); "
        "of the safe signals this one would show most of it, if it is there.",
    )  # fmt: skip


# ---------------------------------------------------------------------------------------------- in words


def _told(pair: Pair, best: Expected) -> NextExperiment:
    plan, track = best.entry.plan, _stage(pair)
    assert track is not None
    plant = track.stretch.plant
    numbers = {
        "amplitude": (plan.amplitude_nm, plant.force_unit),
        "duration": (plan.duration_s, "s"),
        **({"low": (plan.low_hz, "Hz"), "high": (plan.high_hz, "Hz")} if plan.kind in ("chirp", "multisine") else {}),
        **({"hold": (plan.hold_s, "s")} if plan.kind == "steps" else {}),
        **({"kick": (plan.kick_s, "s"), "rest": (plan.rest_s, "s")} if plan.kind == "decay" else {}),
    }
    return NextExperiment(
        signal=best.entry.words,
        parameters={name: Quantity(value=v, unit=unit, ci95=None, nominal=None) for name, (v, unit) in numbers.items()},
        tells_apart=(pair.effect.name, pair.rival.name),
        expected_nats=best.nats,
        reason=_reason(pair.apart, best.nats),
        apart_nats=pair.apart,
        command=command(plan, plant.plays) if plant.plays else "",
    )


def _reason(apart: float, more: float) -> str:
    before = f"These recordings tell the two apart by {apart:.1f} nats"
    if apart + more < NOT_EXCLUDED_NATS:
        return f"{before}; of the safe signals none brings enough, this one brings most: repeat it."
    if apart >= NOT_EXCLUDED_NATS:
        return (
            f"{before} already, and no other known law is nearer: nothing has to be recorded to tell names apart. "
            "Of the safe signals this one would add most to the proof."
        )
    return f"{before}; of the safe signals this one is expected to bring most."


def _by_hand(pair: Pair) -> NextExperiment:
    """Of the menu nothing can be played."""
    return NextExperiment(
        signal=pair.effect.best_experiment, parameters={}, tells_apart=(pair.effect.name, pair.rival.name),
        expected_nats=None, reason=why_by_hand([track.stretch.plant for track in pair.final.tracks]),
        apart_nats=pair.apart,
    )  # fmt: skip


def _change_of_hardware(found: Mapping[str, Separation], library: Mapping[str, Effect]) -> NextExperiment | None:
    """For explanations that are the same for every sensor."""
    for one in found.values():
        for name in one.never:
            return NextExperiment(
                signal=library[name].best_experiment, parameters={}, tells_apart=(one.effect.name, name),
                expected_nats=None, reason="No input tells these two apart: something has to be changed by hand.",
            )  # fmt: skip
    return None
