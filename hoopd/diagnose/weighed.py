"""What is told: how likely each name is beside what else could explain the data, and the figures of its fits.

Rules of this file: it calls the steps in their order; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec

from hoopd.diagnose.camera_faults import CountedFault, camera_faults
from hoopd.diagnose.case import Case, stretches_of
from hoopd.diagnose.findings import effects_of, faults_of, told, unknown_finding
from hoopd.diagnose.proof.confirmation import Confirmation, less_sure
from hoopd.diagnose.proof.disagreement import Differs, differing
from hoopd.diagnose.proof.error_windows import error_windows
from hoopd.diagnose.proof.finding_standings import Asked, Standings, standings
from hoopd.diagnose.proof.fit_record import fits_of
from hoopd.diagnose.proof.fit_tables import Played, channel_source
from hoopd.diagnose.proof.free_run_record import free_choice
from hoopd.diagnose.proof.free_runs import free_runs
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.proof.large_disturbance import LargeDisturbance, large_disturbance
from hoopd.diagnose.proof.not_excluded import Separation, separations
from hoopd.diagnose.proof.probabilities import beside_faults, where_recordings_differ
from hoopd.diagnose.proof.window_lengths import window_of
from hoopd.diagnose.proven import ProvenNames
from hoopd.diagnose.record import EffectFinding, FitTable, FreeRunChoice
from hoopd.diagnose.search.candidates import Judge
from hoopd.diagnose.search.excluded_intervals import CountedData
from hoopd.diagnose.searched import Searched


@dataclass(frozen=True)
class Weighed:
    """The findings with their probabilities, and what stands beside them."""

    effects: Sequence[EffectFinding]
    said: Confirmation  # names that are less likely than they must be are not confirmed any more
    stand: Standings
    apart: Mapping[str, Separation]  # by name
    table: FitTable
    large: LargeDisturbance | None  # where nothing was found, and something acts
    differs: Differs | None  # a number that is another one in each recording
    shares: Mapping[str, float]  # candidates' probabilities


def weighed(case: Case, found: Searched, proof: ProvenNames) -> Weighed:
    """What names stand for, beside everything else that could."""
    named, data, said, unknown = found.named, found.data, proof.said, proof.unknown
    table = _table(case, found, proof)
    case.progress("what else could explain it")
    threshold, apart = case.settings.threshold, separations(named, found.library)
    faults = [*camera_faults([one.quality for one in case.train], threshold), *_unheard(data, threshold)]
    known = {name: found.library[name] for name in case.library}
    missing = proof.missing
    stand = standings(
        Asked(named, known, found.grammar, missing.base, missing.beside, unknown, threshold, case.odds, said.denials)
    )
    said = less_sure(said, {name: one.probability for name, one in stand.findings.items()}, case.seed)
    heldout = fits_of({**said.fits, **_saved(said, found.runs)}) if proof.fits else {}
    effects = effects_of(named, said.fits, threshold, faults, apart, proof.placebos, said)
    if unknown is not None:
        effects = sorted(
            [*effects, unknown_finding(unknown, proof.fits, said)],
            key=lambda e: -(e.evidence.log_likelihood_gain or 0.0),
        )
    effects = told(effects, stand)
    large = _large(case, found) if not effects else None
    shares = stand.candidates if large is None else large.shares(stand.candidates)
    differs = differing(said.final, list(case.library.values()), threshold)
    return Weighed(
        effects,
        said,
        stand,
        apart,
        msgspec.structs.replace(table, heldout=heldout),
        large,
        differs,
        _alone(shares, faults_of(effects, faults), differs),
    )


def _table(case: Case, found: Searched, proof: ProvenNames) -> FitTable:
    named, said = found.named, proof.said
    fitted = found.runs.played({"nominal": named.nominal, "base": named.base, "final": said.final})
    return FitTable(
        train=fits_of(fitted),
        heldout={},
        window_s=window_of([one.plant for one in found.data.kept]),
        free_run=free_runs(named.nominal, named.base, said.kept, found.data_held.kept) if case.free_run else {},
        free_run_choice=_choice(case, found),
        how_heldout=case.held_out_how,
        channel_source=channel_source(stretches_of([*case.train, *case.heldout])),
        error_windows=error_windows((said.fits if proof.fits else fitted)["final"]),
    )


def _alone(shares: Mapping[str, float], faults: Sequence[float], differs: Differs | None) -> dict[str, float]:
    """Candidates' probabilities: parameters alone are as much less likely as a sensor is at fault, or as the recordings
    differ in one of them."""
    found = beside_faults(shares, faults)
    return found if differs is None else where_recordings_differ(found, differs.probability)


def _saved(said: Confirmation, runs: HeldOut) -> dict[str, Played]:
    """What a model is written with, on the held-out data, where that is not all that is shown."""
    written = None if set(said.written.names) == set(said.final.names) else runs.played_of(said.written)
    return {} if written is None else {"written": written}


def _large(case: Case, found: Searched) -> LargeDisturbance | None:
    """What acts beyond the usual where nothing was found."""
    case.progress("disturbances beyond the usual")
    return large_disturbance(found.named, Judge(found.data.kept, case.library, case.settings))


def _unheard(data: CountedData, threshold: float) -> list[CountedFault]:
    """Commands that the drive did not hear, as a counted fault."""
    drives = [name for one in data.whole for name, slot in one.plant.slots.items() if slot.kind == "actuator"]
    found = data.unheard.fault(f"{drives[0]}.lost_commands", threshold) if drives else None
    return [] if found is None else [found]


def _choice(case: Case, found: Searched) -> FreeRunChoice | None:
    """What the free run is better with, where it is asked for; in-sample only where nothing was set aside."""
    if not case.choose_free_run:
        return None
    case.progress("effects by the free run")
    data, held = found.data, found.data_held
    changed = data.ignored or held.ignored or data.unheard.count or held.unheard.count
    whole = () if changed else stretches_of(case.whole)
    return free_choice(found.named.final, held.kept, case.library, case.seed, whole)
