"""The diagnosis of recordings: judged, fitted, searched, proven, and put down as data.

Rules of this file: it calls the steps in their order and fills the record; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import msgspec
import numpy as np

from hoopd.diagnose.camera_faults import CountedFault, camera_faults
from hoopd.diagnose.curves.unknown_effects import Unknown
from hoopd.diagnose.findings import (
    base_of,
    candidates_of,
    disagreement_of,
    effects_of,
    faults_of,
    is_any_told,
    refused_of,
    remains_of,
    told,
    unexplained_of,
    unknown_finding,
    verdict_of,
)
from hoopd.diagnose.inputs import Source
from hoopd.diagnose.location import location_of
from hoopd.diagnose.proof.confirmation import Confirmation, confirmation, less_sure
from hoopd.diagnose.proof.disagreement import Differs, differing
from hoopd.diagnose.proof.ends_of_ranges import end_sentences
from hoopd.diagnose.proof.error_windows import error_windows
from hoopd.diagnose.proof.finding_standings import Asked, standings
from hoopd.diagnose.proof.fit_record import fits_of
from hoopd.diagnose.proof.fit_tables import Played, channel_source
from hoopd.diagnose.proof.free_run_record import free_choice
from hoopd.diagnose.proof.free_runs import free_runs
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.proof.hypotheses import heldout_fits
from hoopd.diagnose.proof.large_disturbance import LargeDisturbance, large_disturbance
from hoopd.diagnose.proof.late_sensors import late_sentences
from hoopd.diagnose.proof.next_experiment import next_experiment
from hoopd.diagnose.proof.not_excluded import one_body_notes, parameter_notes, separations
from hoopd.diagnose.proof.placebo import placebos
from hoopd.diagnose.proof.power import visible
from hoopd.diagnose.proof.probabilities import beside_faults, where_recordings_differ
from hoopd.diagnose.proof.replacement import replace_denied
from hoopd.diagnose.proof.told_together import together_sentence
from hoopd.diagnose.proof.unknown_proof import drop_names, missing_instead, missing_of
from hoopd.diagnose.proof.window_lengths import growth_sentence, window_of
from hoopd.diagnose.proof.written_parameters import Written, written_parameters
from hoopd.diagnose.quality.hold_doubt import hold_doubts
from hoopd.diagnose.quality.unusual_intervals import Interval
from hoopd.diagnose.record import (
    SCHEMA,
    DataQuality,
    Diagnosis,
    FitTable,
    FreeRunChoice,
    NextExperiment,
    RecordingQuality,
)
from hoopd.diagnose.record_file import rounded
from hoopd.diagnose.report.curve_pictures import shown_of
from hoopd.diagnose.report_curves import Shown
from hoopd.diagnose.search.bounded_disturbance import likeliest, unexplained_sentences
from hoopd.diagnose.search.candidates import Judge, Settings, free_of_recordings
from hoopd.diagnose.search.excluded_intervals import CountedData, looked_at_again, start_ups, without_events
from hoopd.diagnose.search.lost_commands import as_heard
from hoopd.diagnose.search.mechanism_search import name_mechanisms
from hoopd.diagnose.search.naming import Named, leave_out_worthless, name_effects
from hoopd.diagnose.search.processes import side_by_side
from hoopd.diagnose.search.simpler_names import tell_simply
from hoopd.diagnose.search.surprise import THRESHOLD
from hoopd.files.reading import InputError
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.mechanism import Mechanism
from hoopd.plants.effects.grammar.mechanisms import mechanisms
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.step_halving import step_nats, step_sentence
from hoopd.plants.likelihood.stretches import Stretch

Progress = Callable[[str], None]

LAST_SHARE = 1.0 / 3.0


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
    without: Collection[str] = ()  # names that are not looked for
    jobs: int = 1  # processes that share the work; the numbers are the same with any
    odds: Mapping[str, float] = field(default_factory=dict)  # nats by which names are likelier beforehand
    progress: Progress = lambda text: None
    settings: Settings = field(default_factory=Settings)


@dataclass(frozen=True)
class Outcome:
    """The diagnosis, the curves behind it, and the fits for who writes a model."""

    diagnosis: Diagnosis
    named: Named
    kept: HypothesisFit  # with the names that a model is written with
    heldout: Mapping[str, Played]
    unknown: Unknown | None = None
    progress: Progress = lambda text: None
    large: LargeDisturbance | None = None  # where nothing was found, and something acts
    memory: bytes = b""  # with this diagnosis in it, where there is one

    @cached_property
    def written(self) -> Written:
        """What a model is written from: the names that are kept, with the parameters that simulate best."""
        return written_parameters(self.kept, self.named.nominal.values, self.progress)

    @cached_property
    def shown(self) -> Shown:
        """The curves of the report."""
        each = self.diagnosis.data_quality.recordings
        ignored = {name: one.segments_ignored for name, one in each.items()}
        shown = shown_of(self.named, self.heldout, self.unknown, ignored)
        return shown if self.large is None else replace(shown, forces=self.large.forces(self.named.base))


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
    """The whole chain, by as many processes as the case says."""
    with side_by_side(case.jobs):
        return _diagnosed(case)


def _diagnosed(case: Case) -> Outcome:
    train, held = stretches_of(case.train), stretches_of(case.heldout)
    case.progress("base parameters")
    nominal = _as_given(case, train)
    data, nominal, base = training(case, train, nominal)
    data_held = proving(held, base, case.settings.threshold)
    named = name_effects(data.kept, case.library, nominal, base, case.settings)
    named, data, data_held = _started(case, named, data, data_held)
    named, data = looked_at_again(named, data, case.settings.threshold)
    grammar = _mechanisms(case, data)
    library = _with_mechanisms(case, named, data, grammar)
    data_held, runs = _heldout_again(named, data_held, HeldOut(data_held.kept))
    replace_denied(named, runs, Judge(data.kept, case.library, case.settings), case.seed)
    case.progress("what no name explains")
    missing = missing_of(named, runs, list(library.values()), case.seed)
    unknown = missing.unknown
    case.progress("how the inputs went on")
    doubts = hold_doubts(case.train, data.ignored, base, case.settings.threshold)
    case.progress("proof on held-out data")
    fits = runs.played(heldout_fits(named, runs, missing.base, missing.proof))
    proofs = placebos(named, case.seed, case.settings.threshold)
    said = confirmation(named, runs, fits, missing.proof, case.settings.threshold, case.seed, proofs)
    refused = refused_of(named, said, missing.refused)
    if unknown is None and not is_any_told(named, said):
        denied = {one.effect.name for one in named.accepted}
        drop_names(named)
        case.progress("what acts where no name is told")
        instead = missing_instead(named, runs, list(library.values()), denied, case.seed) if denied else None
        if instead is not None:
            missing, unknown = instead, instead.unknown
            fits = runs.played(heldout_fits(named, runs, missing.base, missing.proof))
            said = confirmation(named, runs, fits, missing.proof, case.settings.threshold, case.seed, {})
    fitted = runs.played({"nominal": named.nominal, "base": named.base, "final": said.final})
    table = FitTable(
        train=fits_of(fitted),
        heldout={},
        window_s=window_of([one.plant for one in data.kept]),
        free_run=free_runs(named.nominal, named.base, said.kept, data_held.kept) if case.free_run else {},
        free_run_choice=_choice(case, named, data, data_held),
        how_heldout=case.held_out_how,
        channel_source=channel_source([*train, *held]),
        error_windows=error_windows((said.fits if fits else fitted)["final"]),
    )
    case.progress("what else could explain it")
    threshold, apart = case.settings.threshold, separations(named, library)
    faults = [*camera_faults([one.quality for one in case.train], threshold), *_unheard(data, threshold)]
    known = {name: library[name] for name in case.library}
    stand = standings(
        Asked(named, known, grammar, missing.base, missing.beside, unknown, threshold, case.odds, said.denials)
    )
    said = less_sure(said, {name: one.probability for name, one in stand.findings.items()}, case.seed)
    table = msgspec.structs.replace(table, heldout=fits_of({**said.fits, **_saved(said, runs)}) if fits else {})
    effects = effects_of(named, said.fits, threshold, faults, apart, proofs, said)
    if unknown is not None:
        effects = sorted(
            [*effects, unknown_finding(unknown, fits, said)],
            key=lambda e: -(e.evidence.log_likelihood_gain or 0.0),
        )
    effects = told(effects, stand)
    large = _large(case, named, data) if not effects else None
    shares = stand.candidates if large is None else large.shares(stand.candidates)
    differs = differing(said.final, list(case.library.values()), threshold)
    verdict = verdict_of(named, effects, unknown, threshold)
    diagnosis = Diagnosis(
        schema=SCHEMA,
        verdict=verdict,
        base=base_of(case.model, named, said.kept),
        location=location_of(named, missing.base, unknown, verdict, effects),
        effects=effects,
        fit=table,
        unexplained=unexplained_of(unknown, stand),
        next_experiment=_played_where_recorded(next_experiment(named, apart, library, case.seed), case),
        data_quality=quality_of(
            [*case.train, *case.heldout],
            [*data.ignored, *data_held.ignored],
            [
                *doubts,
                *data.notes,
                *data_held.notes,
                *(f"not heard by the drive: {one.unheard.sentence}" for one in (data, data_held) if one.unheard.count),
                step_sentence(step_nats(named.final)),
                *late_sentences(named, case.library, case.settings.threshold),
                *filter(None, [growth_sentence([one.plant for one in data.kept]), together_sentence(named.final)]),
                *unexplained_sentences(said.final),
                *end_sentences(said.final),
            ],
        ),
        seed=case.seed,
        candidates=candidates_of(
            named, threshold, _alone(shares, faults_of(effects, faults), differs), stand.counted_with
        ),
        refused=refused,
        remains=remains_of(stand),
        disagreement=disagreement_of(differs, said.final, case.library),
        power=visible(named, case.library, threshold),
        notes=parameter_notes(case.library) if verdict == "parameters" else one_body_notes(effects),
    )
    diagnosis = diagnosis if large is None else large.told_in(diagnosis)
    return Outcome(rounded(diagnosis), named, said.written, said.fits, unknown, case.progress, large)


def _alone(shares: Mapping[str, float], faults: Sequence[float], differs: Differs | None) -> dict[str, float]:
    """Candidates' probabilities: parameters alone are as much less likely as a sensor is at fault, or as the recordings
    differ in one of them."""
    found = beside_faults(shares, faults)
    return found if differs is None else where_recordings_differ(found, differs.probability)


def _played_where_recorded(planned: NextExperiment | None, case: Case) -> NextExperiment | None:
    """What was recorded on the simulated rig is recorded there again: the printed line says so."""
    if planned is None or not planned.command or not all(one.recording.rig for one in case.train):
        return planned
    return msgspec.structs.replace(planned, command=f"{planned.command} --sim")


def _saved(said: Confirmation, runs: HeldOut) -> dict[str, Played]:
    """What a model is written with, on the held-out data, where that is not all that is shown."""
    written = None if set(said.written.names) == set(said.final.names) else runs.played_of(said.written)
    return {} if written is None else {"written": written}


def _large(case: Case, named: Named, data: CountedData) -> LargeDisturbance | None:
    """What acts beyond the usual where nothing was found."""
    case.progress("disturbances beyond the usual")
    return large_disturbance(named, Judge(data.kept, case.library, case.settings))


def _mechanisms(case: Case, data: CountedData) -> list[Mechanism]:
    """Of the grammar, those that are looked for."""
    if not case.settings.grammar:
        return []
    plant = max((one.plant for one in data.kept), key=lambda one: len(one.coordinates))
    return [one for one in mechanisms(plant).values() if one.name not in case.without]


def _with_mechanisms(case: Case, named: Named, data: CountedData, wanted: Sequence[Mechanism]) -> Mapping[str, Effect]:
    """The library with the mechanisms beyond it that the recordings ask for, put among the names."""
    judge = Judge(data.kept, case.library, case.settings)
    if wanted:
        name_mechanisms(named, judge, wanted)
    tell_simply(named, judge, wanted)
    leave_out_worthless(named, judge)
    return {**case.library, **{one.effect.name: one.effect for one in named.accepted}}


def _as_given(case: Case, train: Sequence[Stretch]) -> HypothesisFit:
    """The fit with the parameters as given; InputError where the model's equations are no numbers there."""
    nominal = fit(train, case.effects, case.values, move=False)
    if not np.isfinite(nominal.criterion):
        reason = "no number, or no slope, along these recordings (a square root of nothing, or of what nobody read?)"
        raise InputError(case.model, "equations", f"{reason}: sqrt(max(h, 0.001)) has both")
    return nominal


def training(
    case: Case, train: list[Stretch], nominal: HypothesisFit
) -> tuple[CountedData, HypothesisFit, HypothesisFit]:
    """What counts of the training data, and the nominal and base fits of it."""

    def refit(stretches: Sequence[Stretch]) -> HypothesisFit:
        return likeliest(fit(stretches, case.effects, case.values))

    base = likeliest(fit(train, case.effects, case.values, like=nominal, noise=nominal.noise), nominal)
    heard, base, lost = as_heard(train, base, refit, case.settings.threshold)
    data, base = without_events(heard, refit, base)
    data = replace(data, unheard=lost)
    if data.ignored or lost.count:
        nominal = fit(data.kept, case.effects, case.values, move=False)
    return data, nominal, base


def _started(case: Case, named: Named, data: CountedData, held: CountedData) -> tuple[Named, CountedData, CountedData]:
    """Named again without the start-ups of the drive that were named as pushes; the held-out data judged anew."""
    early = start_ups(named, {source.name: float(source.stretches[0].t[0]) for source in case.train})
    if not early:
        return named, data, held
    case.progress("without a start-up")
    data = data.begun_later(early)
    base = likeliest(fit(data.kept, case.effects, case.values))
    nominal = fit(data.kept, case.effects, case.values, move=False)
    # the inputs of these are as the drive had them already
    held = replace(proving(list(held.whole), base, case.settings.threshold), unheard=held.unheard)
    return name_effects(data.kept, case.library, nominal, base, case.settings), data, held


def _unheard(data: CountedData, threshold: float) -> list[CountedFault]:
    """Commands that the drive did not hear, as a counted fault."""
    drives = [name for one in data.whole for name, slot in one.plant.slots.items() if slot.kind == "actuator"]
    found = data.unheard.fault(f"{drives[0]}.lost_commands", threshold) if drives else None
    return [] if found is None else [found]


def proving(held: list[Stretch], base: HypothesisFit, threshold: float = THRESHOLD) -> CountedData:
    """What counts of the held-out data."""

    def refit(stretches: Sequence[Stretch]) -> HypothesisFit:
        return fit(stretches, base.effects, base.values, free=free_of_recordings(base.effects, stretches))

    if not held:
        return CountedData([], [])
    heard, found, lost = as_heard(held, refit(held), refit, threshold)
    return replace(without_events(heard, refit, found)[0], unheard=lost)


def _choice(case: Case, named: Named, data: CountedData, held: CountedData) -> FreeRunChoice | None:
    """What the free run is better with, where it is asked for; in-sample only where nothing was set aside."""
    if not case.choose_free_run:
        return None
    case.progress("effects by the free run")
    changed = data.ignored or held.ignored or data.unheard.count or held.unheard.count
    whole = () if changed else stretches_of(case.whole)
    return free_choice(named.final, held.kept, case.library, case.seed, whole)


def _heldout_again(named: Named, data: CountedData, held: HeldOut) -> tuple[CountedData, HeldOut]:
    """Held-out intervals that the names explain come back, too."""
    final = held.of(named.final) if named.accepted and data.aside else None
    more = data if final is None else data.brought_back(final)
    return (data, held) if more is data else (more, HeldOut(more.kept))


def quality_of(sources: Sequence[Source], aside: Sequence[Interval], notes: Sequence[str] = ()) -> DataQuality:
    """Numbers of samples over all recordings, and of each."""
    each: dict[str, RecordingQuality] = {}
    for source in {source.name: source for source in sources}.values():
        counts = source.quality.data_quality()
        own = [(i.t0, i.t1, i.reason) for i in aside if i.recording == source.name]
        segments = [(a - source.start_s, b - source.start_s, why) for a, b, why in counts["segments_ignored"]]
        each[source.name] = RecordingQuality(
            missing=counts["missing"],
            late_frames=counts["late_frames"],
            outliers=counts["outliers"],
            segments_ignored=sorted([*segments, *own]),
            samples=counts["samples"],
            frames=counts["frames"],
            notes=list(source.quality.notes),
            jumps={name: len(found) for name, found in source.quality.jumps.items() if found},
        )
    return DataQuality(
        missing=sum(one.missing or 0 for one in each.values()),
        late_frames=sum(one.late_frames or 0 for one in each.values()),
        outliers=sum(one.outliers or 0 for one in each.values()),
        samples=sum(one.samples or 0 for one in each.values()),
        frames=sum(one.frames or 0 for one in each.values()),
        segments_ignored=[one for part in each.values() for one in part.segments_ignored],
        recordings=each,
        notes=list(notes),
    )


def stretches_of(sources: Sequence[Source]) -> list[Stretch]:
    """All stretches, recording by recording."""
    return [one for source in sources for one in source.stretches]
