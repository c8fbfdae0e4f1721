"""What held-out data say to the names, and what acts where none is told.

Rules of this file: it calls the steps in their order; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hoopd.diagnose.case import Case
from hoopd.diagnose.curves.unknown_effects import Unknown
from hoopd.diagnose.findings import is_any_told, refused_of
from hoopd.diagnose.proof.confirmation import Confirmation, confirmation
from hoopd.diagnose.proof.fit_tables import Played
from hoopd.diagnose.proof.hypotheses import heldout_fits
from hoopd.diagnose.proof.placebo import placebos
from hoopd.diagnose.proof.unknown_proof import Missing, drop_names, missing_instead, missing_of
from hoopd.diagnose.quality.hold_doubt import hold_doubts
from hoopd.diagnose.quality.input_doubt import input_doubts
from hoopd.diagnose.record import Placebo, Refused
from hoopd.diagnose.search.bounded_disturbance import far_beyond
from hoopd.diagnose.searched import Searched


@dataclass(frozen=True)
class ProvenNames:
    """The names that are told, with what proves or denies them."""

    missing: Missing  # what has no name
    fits: Mapping[str, Played]  # on held-out data, by hypothesis; empty without such
    said: Confirmation
    placebos: Mapping[str, Placebo]  # by name
    refused: Sequence[Refused]
    doubts: Sequence[str]  # of the inputs: their sign and scale, how they went on

    @property
    def unknown(self) -> Unknown | None:
        """What has no name, as fitted."""
        return self.missing.unknown


def proven(case: Case, found: Searched) -> ProvenNames:
    """Names that explain nothing beside what has none are dropped from `found.named`."""
    named, runs, threshold = found.named, found.runs, case.settings.threshold
    effects = list(found.library.values())
    case.progress("what no name explains")
    missing = missing_of(named, runs, effects, case.seed)
    case.progress("how the inputs went on")
    doubts = _doubts(case, found)
    case.progress("proof on held-out data")
    fits = runs.played(heldout_fits(named, runs, missing.base, missing.proof))
    proofs = placebos(named, case.seed, threshold)
    said = confirmation(named, runs, fits, missing.proof, threshold, case.seed, proofs)
    refused = refused_of(named, said, missing.refused)
    if missing.unknown is None and not is_any_told(named, said):
        denied = {one.effect.name for one in named.accepted}
        drop_names(named)
        case.progress("what acts where no name is told")
        instead = missing_instead(named, runs, effects, denied, case.seed) if denied else None
        if instead is not None:
            missing = instead
            fits = runs.played(heldout_fits(named, runs, missing.base, missing.proof))
            said = confirmation(named, runs, fits, missing.proof, threshold, case.seed, {})
    return ProvenNames(missing, fits, said, proofs, refused, doubts)


def _doubts(case: Case, found: Searched) -> list[str]:
    """Of the inputs, where the device itself did not write them: sign and scale where something is missing."""
    named, threshold = found.named, case.settings.threshold
    is_ours = any(source.recording.is_tick for source in case.train)
    is_missing = bool(named.accepted) or far_beyond(named.final)
    wrong = input_doubts(named.nominal, named.base, named.final, threshold) if is_missing and not is_ours else []
    return wrong or hold_doubts(case.train, found.data.ignored, named.base, threshold)
