"""The diagnosis of recordings: judged, fitted, searched, proven, and put down as data.

Rules of this file: it calls the steps in their order and fills the record; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hoopd.diagnose.curves.unknown import Survey, Unknown, judge_unknown, survey
from hoopd.diagnose.engine.dataset import Stretch
from hoopd.diagnose.engine.fitting import Fit, fit
from hoopd.diagnose.engine.intervals import Interval, set_aside
from hoopd.diagnose.findings import (
    base_of,
    candidates_of,
    effects_of,
    fits_of,
    location_of,
    unexplained_of,
    unknown_finding,
    verdict_of,
)
from hoopd.diagnose.inputs import Source
from hoopd.diagnose.proof.freechoice import free_choice
from hoopd.diagnose.proof.freeruns import free_runs
from hoopd.diagnose.proof.nextexperiment import next_experiment
from hoopd.diagnose.proof.placebo import placebos
from hoopd.diagnose.proof.separate import parameter_notes, separations
from hoopd.diagnose.proof.tables import channel_source
from hoopd.diagnose.proof.visible import visible
from hoopd.diagnose.quality.judged import corruption_findings
from hoopd.diagnose.record import SCHEMA, DataQuality, Diagnosis, FitTable, FreeRunChoice, RecordingQuality, rounded
from hoopd.diagnose.report.pictures import shown_of
from hoopd.diagnose.search.naming import Named, Settings, free_of_recordings, name_effects
from hoopd.diagnose.search.stiff import likeliest
from hoopd.diagnose.shown import Shown
from hoopd.physics.effects.base import Effect

Progress = Callable[[str], None]

LAST_SHARE = 1.0 / 3.0
# A disturbance of the drive's coordinate that began within these seconds is a start-up.
START_UP_S = 0.3


@dataclass
class Case:
    """What is diagnosed."""

    model: str
    values: Mapping[str, float]
    train: Sequence[Source]
    heldout: Sequence[Source]
    library: Mapping[str, Effect]
    effects: Sequence[Effect] = ()  # that the judged model has already; their values are among `values`
    free_run: bool = True  # one run over each whole stretch too, the parameters refined on it
    choose_free_run: bool = False  # look for the effects that make that run better, too (minutes)
    whole: Sequence[Source] = ()  # recordings whose parts are fitted and held out
    seed: int = 0
    held_out_how: str = ""
    progress: Progress = lambda text: None
    settings: Settings = field(default_factory=Settings)


@dataclass(frozen=True)
class Outcome:
    """The diagnosis, the curves behind it, and the fits for who writes a model."""

    diagnosis: Diagnosis
    named: Named
    heldout: Mapping[str, Fit]
    unknown: Unknown | None = None

    @cached_property
    def shown(self) -> Shown:
        """The curves of the report."""
        each = self.diagnosis.data_quality.recordings
        ignored = {name: one.segments_ignored for name, one in each.items()}
        return shown_of(self.named, self.heldout, self.unknown, ignored)


def last_third(sources: Sequence[Source]) -> tuple[list[Source], list[Source]]:
    """Training and held-out parts of each recording."""
    train, held = [], []
    for source in sources:
        first, last = source.stretches[0].t[0], source.stretches[-1].t[-1]
        cut = float(last - LAST_SHARE * (last - first))
        train.append(source.part(-np.inf, cut))
        held.append(source.part(cut, np.inf))
    return train, held


def diagnose(case: Case) -> Outcome:
    """The whole chain."""
    train, held = _stretches(case.train), _stretches(case.heldout)
    case.progress("base parameters")
    nominal = fit(train, case.effects, case.values, move=False)
    train, aside, nominal, base = _without_events(case, train, nominal)
    held, aside_held = _heldout_without_events(case, held, base)
    named = name_effects(train, held, case.library, nominal, base, case.settings)
    case.progress("what no name explains")
    unknown = unknown_of(case, named)
    case.progress("proof on held-out data")
    if unknown is not None and not unknown.beside_names:
        drop_names(named)
    fits = heldout_fits(named, held)
    table = FitTable(
        train=fits_of({"nominal": named.nominal, "base": named.base, "final": named.final}),
        heldout=fits_of(fits) if fits else {},
        free_run=free_runs(named.nominal, named.base, named.final, held) if case.free_run else {},
        free_run_choice=_choice(case, named, held, whole=not (aside or aside_held)),
        how_heldout=case.held_out_how,
        channel_source=channel_source([*train, *held]),
    )
    case.progress("what else could explain it")
    threshold, apart = case.settings.threshold, separations(named, case.library)
    proofs = placebos(named, case.seed, threshold)
    effects = effects_of(named, fits, threshold, corruption(case.train), apart, proofs)
    if unknown is not None:
        effects = sorted([*effects, unknown_finding(unknown)], key=lambda e: -(e.evidence.log_likelihood_gain or 0.0))
    verdict = verdict_of(named, effects, unknown, threshold)
    diagnosis = Diagnosis(
        schema=SCHEMA,
        verdict=verdict,
        base=base_of(case.model, named),
        location=location_of(named, unknown),
        effects=effects,
        fit=table,
        unexplained=unexplained_of(unknown),
        next_experiment=next_experiment(named, apart, case.library, case.seed),
        data_quality=quality_of([*case.train, *case.heldout], [*aside, *aside_held]),
        seed=case.seed,
        candidates=candidates_of(named, threshold),
        power=visible(named, case.library, threshold),
        notes=parameter_notes(case.library) if verdict == "parameters" else [],
    )
    return Outcome(rounded(diagnosis), named, fits, unknown)


def _without_events(case: Case, train: list[Stretch], nominal: Fit) -> tuple[list[Stretch], list[Interval], Fit, Fit]:
    """Stretches without what does not belong to them, and the fits of the rest."""

    def refit(stretches: Sequence[Stretch]) -> Fit:
        return likeliest(fit(stretches, case.effects, case.values))

    base = likeliest(fit(train, case.effects, case.values, like=nominal, noise=nominal.noise))
    kept, aside, base = set_aside(train, refit, base, lambda one: does_not_belong(one, train))
    if aside:
        nominal = fit(kept, case.effects, case.values, move=False)
    return kept, aside, nominal, base


def _heldout_without_events(case: Case, held: list[Stretch], base: Fit) -> tuple[list[Stretch], list[Interval]]:
    def refit(stretches: Sequence[Stretch]) -> Fit:
        return fit(stretches, base.effects, base.values, free=free_of_recordings(base.effects, stretches))

    if not held:
        return held, []
    kept, aside, _ = set_aside(held, refit, None, lambda one: does_not_belong(one, held))
    return (kept, aside) if kept else (held, [])


def does_not_belong(one: Interval, stretches: Sequence[Stretch]) -> bool:
    """A hand, a lost camera, a start-up: a push on the driven coordinate later than that is an effect."""
    mine = [s for s in stretches if s.recording == one.recording]
    if one.kind == "force" and mine and one.where == mine[0].plant.driven:
        return one.t0 < float(mine[0].t[0]) + START_UP_S
    return True


def _choice(case: Case, named: Named, held: Sequence[Stretch], *, whole: bool) -> FreeRunChoice | None:
    """What the free run is better with, where it is asked for; `whole`: nothing was set aside."""
    if not case.choose_free_run:
        return None
    case.progress("effects by the free run")
    return free_choice(named.final, held, case.library, case.seed, _stretches(case.whole) if whole else ())


def unknown_of(case: Case, named: Named) -> Unknown | None:
    """What the library has no name for."""
    effects = list(case.library.values())

    def of(found: Fit) -> Survey:
        return survey(found, effects, seed=case.seed, screen=named.screens.get(id(found)))

    first, second = of(named.base), of(named.final) if named.accepted else None
    return judge_unknown(first, second, seed=case.seed)


def drop_names(named: Named) -> None:
    """Names that explain nothing which a curve does not."""
    named.accepted.clear()
    named.losses.clear()
    named.without.clear()
    named.final = named.base


def heldout_fits(named: Named, held: Sequence[Stretch]) -> dict[str, Fit]:
    """Nominal, base, final and each ablation on the held-out stretches, parameters frozen."""
    if not held:
        return {}
    wanted = {"nominal": named.nominal, "base": named.base, "final": named.final}
    wanted |= {f"without {name}": one for name, one in named.without.items()}
    found: dict[int, Fit] = {}
    for one in wanted.values():
        if id(one) not in found:
            own = free_of_recordings(one.effects, held)
            found[id(one)] = fit(held, one.effects, one.values, free=own)
    return {name: found[id(one)] for name, one in wanted.items()}


def corruption(sources: Sequence[Source]) -> dict[str, tuple[float, tuple[float, float], float]]:
    """Faults of the camera that are effects, over the recordings that have them: share, interval, nats."""
    parts: dict[str, list[tuple[float, tuple[float, float], float]]] = {}
    for source in sources:
        for name, share, interval, gain in corruption_findings(source.quality):
            parts.setdefault(name, []).append((share, interval, gain))
    return {
        name: (
            float(np.mean([p[0] for p in each])),
            (float(np.mean([p[1][0] for p in each])), float(np.mean([p[1][1] for p in each]))),
            float(sum(p[2] for p in each)),
        )
        for name, each in parts.items()
        if 2 * len(each) >= len(sources)
    }


def quality_of(sources: Sequence[Source], aside: Sequence[Interval]) -> DataQuality:
    """Numbers of samples over all recordings, and of each."""
    each: dict[str, RecordingQuality] = {}
    for source in {source.name: source for source in sources}.values():
        counts = source.quality.data_quality()
        own = [(i.t0, i.t1, f"{i.where}: does not belong to the rest") for i in aside if i.recording == source.name]
        segments = [(a - source.start_s, b - source.start_s, why) for a, b, why in counts["segments_ignored"]]
        each[source.name] = RecordingQuality(
            missing=counts["missing"],
            late_frames=counts["late_frames"],
            outliers=counts["outliers"],
            segments_ignored=sorted([*segments, *own]),
            notes=list(source.quality.notes),
        )
    return DataQuality(
        missing=sum(one.missing or 0 for one in each.values()),
        late_frames=sum(one.late_frames or 0 for one in each.values()),
        outliers=sum(one.outliers or 0 for one in each.values()),
        segments_ignored=[one for part in each.values() for one in part.segments_ignored],
        recordings=each,
    )


def _stretches(sources: Sequence[Source]) -> list[Stretch]:
    return [one for source in sources for one in source.stretches]
