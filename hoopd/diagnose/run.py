"""The diagnosis of recordings: judged, fitted, searched, proven, weighed, and put down as data.

Rules of this file: it calls the steps in their order and fills the record; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import msgspec

from hoopd.diagnose.case import Case, Progress
from hoopd.diagnose.curves.unknown_effects import Unknown
from hoopd.diagnose.data_quality import quality_of
from hoopd.diagnose.findings import (
    base_of,
    candidates_of,
    disagreement_of,
    remains_of,
    unexplained_of,
    verdict_of,
)
from hoopd.diagnose.location import location_of
from hoopd.diagnose.proof.ends_of_ranges import end_sentences
from hoopd.diagnose.proof.fit_tables import Played
from hoopd.diagnose.proof.large_disturbance import LargeDisturbance
from hoopd.diagnose.proof.late_sensors import late_sentences
from hoopd.diagnose.proof.next_experiment import next_experiment
from hoopd.diagnose.proof.not_excluded import one_body_notes, parameter_notes
from hoopd.diagnose.proof.power import visible
from hoopd.diagnose.proof.told_together import together_sentence
from hoopd.diagnose.proof.window_lengths import growth_sentence
from hoopd.diagnose.proof.written_parameters import Written, written_parameters
from hoopd.diagnose.proven import ProvenNames, proven
from hoopd.diagnose.record import SCHEMA, DataQuality, Diagnosis, NextExperiment
from hoopd.diagnose.record_file import rounded
from hoopd.diagnose.report.curve_pictures import shown_of
from hoopd.diagnose.report_curves import Shown
from hoopd.diagnose.search.bounded_disturbance import unexplained_sentences
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.processes import side_by_side
from hoopd.diagnose.searched import Searched, searched
from hoopd.diagnose.weighed import Weighed, weighed
from hoopd.files.memory import RememberedDiagnosis
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.step_halving import step_nats, step_sentence


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
    memory: RememberedDiagnosis | None = None  # what is to be remembered of it, where there is a memory

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


def diagnose(case: Case) -> Outcome:
    """The whole chain, by as many processes as the case says."""
    with side_by_side(case.jobs):
        found = searched(case)
        proof = proven(case, found)
        told = weighed(case, found, proof)
        diagnosis = _record(case, found, proof, told)
    named, said = found.named, told.said
    return Outcome(rounded(diagnosis), named, said.written, said.fits, proof.unknown, case.progress, told.large)


def _record(case: Case, found: Searched, proof: ProvenNames, told: Weighed) -> Diagnosis:
    named, threshold, effects, final = found.named, case.settings.threshold, told.effects, told.said.final
    verdict = verdict_of(named, effects, proof.unknown, threshold)
    power = visible(named, case.library, threshold)
    diagnosis = Diagnosis(
        schema=SCHEMA,
        verdict=verdict,
        base=base_of(case.model, named, told.said.kept),
        location=location_of(named, proof.missing.base, proof.unknown, verdict, effects),
        effects=list(effects),
        fit=told.table,
        unexplained=unexplained_of(proof.unknown, told.stand),
        next_experiment=_played_where_recorded(next_experiment(named, told.apart, found.library, case.seed), case),
        data_quality=_data_quality(case, found, proof, final),
        seed=case.seed,
        candidates=candidates_of(named, threshold, told.shares, told.stand.counted_with),
        refused=list(proof.refused),
        remains=remains_of(told.stand),
        disagreement=disagreement_of(told.differs, final, case.library),
        power=power,
        notes=parameter_notes(case.library, power) if verdict == "parameters" else one_body_notes(effects),
    )
    return diagnosis if told.large is None else told.large.told_in(diagnosis)


def _data_quality(case: Case, found: Searched, proof: ProvenNames, final: HypothesisFit) -> DataQuality:
    data, held = found.data, found.data_held
    notes = [
        *proof.doubts,
        *data.notes,
        *held.notes,
        *(f"not heard by the drive: {one.unheard.sentence}" for one in (data, held) if one.unheard.count),
        step_sentence(step_nats(found.named.final)),
        *late_sentences(found.named, case.library, case.settings.threshold),
        *filter(None, [growth_sentence([one.plant for one in data.kept]), together_sentence(found.named.final)]),
        *unexplained_sentences(final),
        *end_sentences(final),
    ]
    return quality_of([*case.train, *case.heldout], [*data.ignored, *held.ignored], notes)


def _played_where_recorded(planned: NextExperiment | None, case: Case) -> NextExperiment | None:
    """What was recorded on the simulated rig is recorded there again: the printed line says so."""
    if planned is None or not planned.command or not all(one.recording.rig for one in case.train):
        return planned
    return msgspec.structs.replace(planned, command=f"{planned.command} --sim")
