"""What one would reach who knew the missing physics: the true effects fitted, no name searched.

The measure of a search, and of how much a known effect is worth.
Rules of this file: the same stretches, screens, scans, fits and figures as a diagnosis; only the names are given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from hoopd.diagnose.case import Case, stretches_of
from hoopd.diagnose.counted_data import proving, training
from hoopd.diagnose.inputs import source_of
from hoopd.diagnose.proof.fit_record import fits_of
from hoopd.diagnose.proof.fit_tables import played
from hoopd.diagnose.record_file import to_plain, unwrapped
from hoopd.diagnose.search.candidates import Judge, Settings, free_of_recordings
from hoopd.files.shipped import or_shipped
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.plants.model_file import effects_plant, load_model
from hoopd.recording.recording import Recording

DEFAULT_MODEL = Path("models/thesis.yaml")
# Those that a fit can have: a fault of single pictures is counted, a lost contact is no smooth map.
FITTED = ("screen", "scan", "base")


def oracle(recordings: Sequence[Recording], holdout: Recording, names: Sequence[str]) -> Mapping[str, Any]:
    """`fit` of a diagnosis (train and heldout, NRMSE percent) with the effects `names`; ValueError for one unknown."""
    model = load_model(or_shipped(DEFAULT_MODEL))
    plant = effects_plant(model)
    train = [source_of(one.source, one, plant) for one in recordings]
    known = library(train[0].stretches[0].plant)
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"not in the library: {', '.join(unknown)}")
    told = {name: known[name] for name in names if known[name].found_by in FITTED}
    case = Case(model.name, model.values(), train, [source_of(holdout.source, holdout, plant)], told)
    stretches, held, nominal, base = prepared(case)
    frozen = {"nominal": nominal, "base": base, "final": told_fit(stretches, told, base)}
    on_held = {k: fit(held, f.effects, f.values, free=free_of_recordings(f.effects, held)) for k, f in frozen.items()}
    tables = {"train": fits_of(played(frozen)), "heldout": fits_of(played(on_held))}
    return {name: to_plain(msgspec.to_builtins(one, enc_hook=unwrapped)) for name, one in tables.items()}


def prepared(case: Case) -> tuple[Sequence[Stretch], Sequence[Stretch], HypothesisFit, HypothesisFit]:
    """Training and held-out stretches without what was set aside; parameters as given and re-estimated."""
    train = stretches_of(case.train)
    data, nominal, base = training(case, train, fit(train, case.effects, case.values, move=False))
    return data.kept, proving(stretches_of(case.heldout), base).kept, nominal, base


def told_fit(train: Sequence[Stretch], told: Mapping[str, Effect], base: HypothesisFit) -> HypothesisFit:
    """All effects that gain something, each from where screens and scans see it beside the ones before: the most
    surprising first."""
    judge, final, left = Judge(train, told, Settings()), base, set(told)
    while left:
        scores = [one for one in judge.proposals(final, final.names) if one.member.effect.name in left]
        if not scores:
            break
        tried = judge.tried(final, scores[0])
        left.discard(tried.effect.name)
        final = tried.fit if tried.gain > 0.0 else final
    return final
