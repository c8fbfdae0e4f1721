"""What the search found, as records of the diagnosis.

Rules of this file: from fits to records; a verdict is a table, not a judgement made anew.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, pi

import numpy as np
from msgspec.structs import replace

from hoopd.diagnose.camera_faults import CountedFault
from hoopd.diagnose.curves.unknown_effects import Unknown
from hoopd.diagnose.proof.confirmation import Confirmation, status_of
from hoopd.diagnose.proof.disagreement import Differs
from hoopd.diagnose.proof.finding_standings import Standing, Standings
from hoopd.diagnose.proof.fit_record import mean_nrmse
from hoopd.diagnose.proof.fit_tables import Played, with_and_without
from hoopd.diagnose.proof.not_excluded import Separation
from hoopd.diagnose.proof.probabilities import Option, likely
from hoopd.diagnose.proof.unknown_proof import Proven
from hoopd.diagnose.record import (
    NONE_OF_THESE,
    PARAMETERS,
    Ablation,
    Base,
    Candidate,
    Curve,
    Disagreement,
    EffectFinding,
    Evidence,
    Placebo,
    Quantity,
    Refused,
    Remains,
    Unexplained,
    Verdict,
)
from hoopd.diagnose.search.candidates import needed_of, surprise_of
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.surprise import surprise
from hoopd.plants.effects.base import Effect, EffectParameter
from hoopd.plants.effects.grammar.shapes import BEGAN
from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.priors import ranges
from hoopd.plants.likelihood.recording_parameters import values_of
from hoopd.plants.likelihood.stretch_scatter import interval

# Candidates that were not tried on their own are told of when they are this likely.
LEAST_TOLD = 0.01
# An interval so many times as wide as a parameter is large says nothing.
SAYS_NOTHING = 1e6


def verdict_of(named: Named, effects: Sequence[EffectFinding], unknown: Unknown | None, threshold: float) -> Verdict:
    """Unknown when what has no name is there at all; consistent when the nominal parameters are enough."""
    if unknown is not None:
        return "unknown_physics"
    if effects:
        return "missing_physics"
    gain = named.nominal.criterion - named.base.criterion
    return "parameters" if surprise(gain, len(named.base.free)) > threshold else "consistent"


def base_of(model: str, named: Named, final: HypothesisFit) -> Base:
    """Re-estimated base parameters beside the effects of `final`; of effects that the base has: `slot.effect.name`."""
    units = _units(final) | {e.key(p.name): p.unit for e in named.base.effects for p in e.parameters}
    bounds = ranges(final.effects, final.tracks)
    return Base(
        model=model,
        parameters={
            name: Quantity(
                value=final.values[name], unit=units.get(name, ""),
                ci95=_within(interval(final, name), *bounds.get(name, (-inf, inf))),
                nominal=named.nominal.values[name],
            )
            for name in final.free
            if name in units
        },
    )  # fmt: skip


def disagreement_of(
    differs: Differs | None, found: HypothesisFit, library: Mapping[str, Effect]
) -> Disagreement | None:
    """As a record; `library`: whose effects were asked."""
    if differs is None:
        return None
    units = _units(found) | {e.key(p.name): p.unit for e in (*library.values(), *found.effects) for p in e.parameters}
    return Disagreement(
        name=differs.name,
        unit=units.get(differs.name, ""),
        by_recording=dict(differs.values),
        log_likelihood_gain=differs.gain,
        needed=differs.needed,
        not_excluded=list(differs.alike),
    )


def _units(found: HypothesisFit) -> dict[str, str]:
    return {name: unit for track in found.tracks for name, unit in track.stretch.plant.units.items()}


def parameters_of(effect: Effect, found: HypothesisFit) -> dict[str, Quantity]:
    """Of one effect; what belongs to a recording is given for the first one in which it is anything, then by
    recording."""
    out = {}
    recordings = found.recordings
    for p in effect.parameters:
        key = effect.key(p.name)
        if p.name == BEGAN:
            continue  # a sentence says in which recording it was
        own = [f"{key}@{r}" for r in recordings if f"{key}@{r}" in found.values] if p.per_recording else []
        own.sort(key=lambda name, p=p: found.values[name] == p.neutral)  # type: ignore[misc]
        # outside of its range a neutral value stands for infinity
        neutral = p.neutral if p.low <= p.neutral <= p.high else None
        names = {p.name: own[0] if own else key}
        if len(own) > 1:
            names |= {name.removeprefix(f"{effect.name}."): name for name in own}
        for label, name in names.items():
            out[label] = Quantity(
                value=found.values.get(name, p.neutral), unit=p.unit, ci95=_possible(interval(found, name), p),
                nominal=neutral,
            )  # fmt: skip
    return out


def _within(found: tuple[float, float] | None, low: float, high: float) -> tuple[float, float] | None:
    return None if found is None else (max(found[0], low), min(found[1], high))


def _possible(found: tuple[float, float] | None, p: EffectParameter) -> tuple[float, float] | None:
    """The part of an interval in which a parameter can be; None where it is all the way round, or says nothing."""
    if found is None or (p.role == "phase" and found[1] - found[0] >= 2.0 * pi):
        return None
    if not found[1] - found[0] < SAYS_NOTHING * max(abs(found[0] + found[1]) / 2.0, p.size):
        return None
    return _within(found, 0.0 if p.low >= 0.0 else -inf, p.most)


def effects_of(
    named: Named,
    heldout: Mapping[str, Played],
    threshold: float,
    faults: Sequence[CountedFault],
    apart: Mapping[str, Separation],
    placebos: Mapping[str, Placebo],
    said: Confirmation,
) -> list[EffectFinding]:
    """Named effects that are not refused and faults of the camera, most evidence first."""
    percents = {name: mean_nrmse(one) for name, one in heldout.items()}
    found = [
        _effect(named, name, heldout, percents, threshold, apart[name], placebos.get(name), said)
        for name in (one.effect.name for one in named.accepted)
        if name not in said.refused
    ]
    found += [_fault(one, threshold) for one in faults]
    return sorted(found, key=lambda one: -(one.evidence.log_likelihood_gain or 0.0))


def _effect(
    named: Named,
    name: str,
    heldout: Mapping[str, Played],
    percents: Mapping[str, dict[str, float]],
    threshold: float,
    apart: Separation,
    placebo: Placebo | None,
    said: Confirmation,
) -> EffectFinding:
    tried = next(one for one in named.accepted if one.effect.name == name)
    effect, loss = tried.effect, named.losses[name]
    gain, ablation = None, None
    if percents:
        gain, ablation = _taken_out(loss, *with_and_without(percents, name))
        ablation = replace(ablation, heldout_nats=heldout_nats(heldout, name))
    needed = needed_of(tried.score, threshold, [track.stretch for track in named.base.tracks])
    return EffectFinding(
        name=name,
        slot=effect.slot,
        parameters=parameters_of(effect, said.kept if name in said.kept.names else named.final),
        evidence=Evidence(log_likelihood_gain=loss, threshold=needed, heldout_gain_percent=gain),
        not_excluded=apart.not_excluded,
        statement=effect.statement + _when(effect, named.final),
        formula=effect.formula,
        alternatives=list(apart.alternatives),
        ablation=ablation,
        placebo=placebo,
        status=said.statuses[name],
        reason=said.reason(name) or ("" if is_in_vocabulary(name, named.final) else OF_YOUR_OWN),
        in_model=name in said.written.names and is_in_vocabulary(name, named.final),
    )


# What pushes does so for so many samples at least.
LEAST_SAMPLES = 2.0
# What begins in so small a part of a recording began with it, or before.
AT_ONCE = 0.01


def _when(effect: Effect, found: HypothesisFit) -> str:
    """From when on it is as it is, where it began once in one of the recordings; and what is over at once."""
    recordings = found.recordings
    if _is_over_at_once(effect, found):
        driven = any(
            slot.coordinate == track.stretch.plant.driven
            for track in found.tracks
            if (slot := track.stretch.plant.slots.get(effect.slot)) is not None
        )
        why = ": a command that was lost or came late, sooner than a hand" if driven else ""
        return f", for less than two samples{why}"
    began = [name for name in recordings if found.values.get(f"{effect.key(BEGAN)}@{name}") == 0.0]
    if not began:
        return ""
    times = np.concatenate([track.stretch.t for track in found.tracks if track.stretch.recording == began[0]])
    moment = found.values[effect.key("v0")]
    early = moment <= times[0] + AT_ONCE * (times[-1] - times[0])
    place = began[0] if early else f"{moment:.3g} s of {began[0]}"
    return f": from {place} on, and in what was recorded after it"


def _is_over_at_once(effect: Effect, found: HypothesisFit) -> bool:
    """Whether every push of an effect is over before two samples see it."""
    spans = []
    for track in found.tracks:
        own = values_of(track.stretch.recording, found.values)
        t0, t1 = (own.get(effect.key(name), 0.0) for name in ("t0", "t1"))
        if t1 > t0:
            spans.append((t1 - t0) / float(np.median(track.stretch.h)))
    return bool(spans) and max(spans) < LEAST_SAMPLES


# Why a user's own effect is in no model.
OF_YOUR_OWN = "a model file holds no effects of your own"


def is_in_vocabulary(name: str, found: HypothesisFit) -> bool:
    """Whether a model file can hold an effect of this name: a user's own stand in a program."""
    plants = {id(one): one for one in (track.stretch.plant for track in found.tracks)}.values()
    return any(name in known_effects(plant, [name]) for plant in plants)


def heldout_nats(heldout: Mapping[str, Played], name: str) -> float:
    """Nats that the held-out data gain by a name beside the others."""
    with_it, without = with_and_without(heldout, name)
    return without.fit.criterion - with_it.fit.criterion


def _taken_out(loss: float, with_it: Mapping[str, float], without: Mapping[str, float]) -> tuple[float, Ablation]:
    """Mean percent that the held-out channels gain by a finding, and what is left without it."""
    gain = float(np.nanmean([with_it[c] - without[c] for c in with_it]))
    return gain, Ablation(log_likelihood_loss=loss, heldout_with={**with_it}, heldout_without={**without})


# Of a counted fault: of what it is a share, and what those are.
FAULTS = {
    "late_frames": ("samples", "repeats the picture before"),
    "outliers": ("samples", "is a false detection"),
    "lost_commands": ("demands", "is not heard, and the one before stays for a sample more"),
}


def _fault(fault: CountedFault, threshold: float) -> EffectFinding:
    slot, _, kind = fault.name.partition(".")
    each, happens = FAULTS[kind]
    known = likely([Option(fault.name, fault.surprise, True), Option(PARAMETERS, threshold)])
    status = status_of(fault.surprise, threshold)
    return EffectFinding(
        name=fault.name,
        slot=slot,
        parameters={"share": Quantity(value=fault.share, unit="-", ci95=fault.ci95, nominal=0.0)},
        evidence=Evidence(log_likelihood_gain=fault.gain, threshold=fault.needed, heldout_gain_percent=None),
        not_excluded=[],
        statement=f"a share of the {slot}'s {each} {happens}",
        formula=f"a share of the {each} {happens}",
        probability=known.named,
        status=status,
        in_model=status != "weak",
    )


def faults_of(effects: Sequence[EffectFinding], faults: Sequence[CountedFault]) -> list[float]:
    """Probabilities of the findings that are counted faults of a sensor."""
    names = {one.name for one in faults}
    return [one.probability or 0.0 for one in effects if one.name in names]


def refused_of(named: Named, said: Confirmation, curve: Proven | None = None) -> list[Refused]:
    """What was beyond the threshold: names that folds refused, and names and a curve of which held-out data leave no
    evidence."""
    folds = [
        Refused(
            name=name, log_likelihood_gain=one.gain,
            reason=f"fitted to two thirds of the data it loses {one.loss:.1f} nats in the other third",
        )
        for name, one in named.refusals.items()
    ]  # fmt: skip
    denied = [
        Refused(name=name, log_likelihood_gain=named.losses[name], reason=said.denials[name].reason)
        for name in said.refused
    ]
    if curve is not None and curve.denial is not None:
        denied.append(
            Refused(name=curve.unknown.name, log_likelihood_gain=curve.unknown.gain, reason=curve.denial.reason)
        )
    return sorted([*folds, *denied], key=lambda one: (-(one.log_likelihood_gain or 0.0), one.name))


def is_any_told(named: Named, said: Confirmation) -> bool:
    """Whether any of the names is told as a finding, or none was there."""
    return not named.accepted or any(one.effect.name not in said.refused for one in named.accepted)


def told(findings: Sequence[EffectFinding], standings: Standings) -> list[EffectFinding]:
    """Findings with how each of them stands; faults that were counted before any model stand by themselves."""
    return [_told(one, standings.findings[one.name]) if one.name in standings.findings else one for one in findings]


def _told(finding: EffectFinding, standing: Standing) -> EffectFinding:
    return replace(
        finding,
        probability=standing.probability,
        nearest=standing.nearest,
        explained=standing.explained,
        statement=f"{finding.statement}; it {standing.caveat}" if standing.caveat else finding.statement,
    )


def candidates_of(
    named: Named, threshold: float, shares: Mapping[str, float], counted_with: Mapping[str, str]
) -> list[Candidate]:
    """Every effect on its own over the base: refitted where it was, else as the screen saw it; and whatever else is
    likely. `counted_with`: names that nothing tells from a finding -> the finding."""
    stretches = [track.stretch for track in named.base.tracks]
    found = {s.member.effect.name: (s, s.gain, surprise_of(s, s.gain, stretches)) for s in named.scores}
    found |= {one.effect.name: (one.score, one.gain, one.surprise) for one in named.tried}
    known = [
        Candidate(
            name=name, log_likelihood_gain=gain, surprise=beyond, threshold=threshold,
            needed=needed_of(score, threshold, stretches), probability=shares.get(name, 0.0),
            counted_with=counted_with.get(name),
        )
        for name, (score, gain, beyond) in found.items()
    ]  # fmt: skip
    more = [name for name, one in shares.items() if name not in found and (one >= LEAST_TOLD or name == NONE_OF_THESE)]
    screened = [
        Candidate(name=name, log_likelihood_gain=None, probability=shares[name], counted_with=counted_with.get(name))
        for name in more
    ]
    return [*known, *screened]


def unknown_finding(unknown: Unknown, heldout: Mapping[str, Played], said: Confirmation | None = None) -> EffectFinding:
    """As an effect without a name; taken out again it leaves what it stands beside."""
    gain, ablation, without = None, None, heldout.get(f"without {unknown.name}")
    denied = None if said is None else said.denials.get(unknown.name)
    if without is not None:
        gain, ablation = _taken_out(unknown.gain, mean_nrmse(heldout["final"]), mean_nrmse(without))
    return EffectFinding(
        name=unknown.name,
        slot=unknown.curve.slot,
        parameters={},
        evidence=Evidence(log_likelihood_gain=unknown.gain, threshold=unknown.threshold, heldout_gain_percent=gain),
        not_excluded=[f"unknown.{slot}" for slot in unknown.not_excluded],
        statement=f"something that is not in the library, at the {unknown.curve.slot}, "
        f"follows {' and '.join(unknown.curve.depends_on)}"
        f"{', by another curve in the held-out recordings' if unknown.carries_over is False and not denied else ''}",
        ablation=ablation,
        status=None if said is None else said.statuses[unknown.name],
        reason="" if denied is None else denied.reason,
        in_model=False,
    )


def remains_of(standings: Standings) -> Remains | None:
    """What still follows a law beside everything that was named; None where that is no more than noise allows."""
    rest = standings.rest
    if rest is None or not rest.fires or not standings.findings:
        return None
    return Remains(slot=rest.slot, follows=rest.follows, log_likelihood_gain=rest.surprise, by_chance=rest.usual)


def unexplained_of(unknown: Unknown | None, standings: Standings) -> Unexplained | None:
    """The curve of what has no name, and how likely it is."""
    if unknown is None:
        return None
    shape, curve = unknown.shapes[0], unknown.curve
    return Unexplained(
        fires=True,
        slot=curve.slot,
        curve=Curve(
            regressor=curve.variable.name, regressor_unit=curve.variable.unit, unit=curve.unit,
            x=shape.x.tolist(), y=shape.y.tolist(), low=shape.low.tolist(), high=shape.high.tolist(),
        ),
        share=unknown.share,
        carries_over=unknown.carries_over,
        probability=standings.findings[unknown.name].probability,
    )  # fmt: skip
