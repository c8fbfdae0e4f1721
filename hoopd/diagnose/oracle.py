"""What one would reach who knew the missing physics: the true effects fitted, nothing searched.

The measure of a search, and of how much a known effect is worth.
Rules of this file: the same fits and the same figures as a diagnosis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from hoopd.diagnose.engine.fitting import Fit, fit
from hoopd.diagnose.findings import fits_of
from hoopd.diagnose.inputs import Source, hoop_source
from hoopd.diagnose.proof.tables import played
from hoopd.diagnose.recordfile import to_plain
from hoopd.diagnose.search.naming import free_of_recordings
from hoopd.diagnose.search.screen import Screen
from hoopd.modelfiles import ModelFile, load_model
from hoopd.physics.effects.catalogue import library
from hoopd.recording.recording import Recording
from hoopd.shipped import or_shipped

DEFAULT_MODEL = Path("models/thesis.yaml")


def oracle(recordings: Sequence[Recording], holdout: Recording, names: Sequence[str]) -> Mapping[str, Any]:
    """`fit` of a diagnosis (train and heldout, NRMSE percent) with the effects `names`; ValueError for one unknown."""
    model = load_model(or_shipped(DEFAULT_MODEL))
    train = [_source(one, model) for one in recordings]
    stretches = [part for source in train for part in source.stretches]
    held = list(_source(holdout, model).stretches)
    known = library(stretches[0].plant)
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"not in the library: {', '.join(unknown)}")
    nominal = fit(stretches, (), model.values(), move=False)
    base = fit(stretches, (), model.values(), like=nominal, noise=nominal.noise)
    final = base
    for name in names:
        final = _with(final, known[name])
    frozen = {"nominal": nominal, "base": base, "final": final}
    on_held = {k: fit(held, f.effects, f.values, free=free_of_recordings(f.effects, held)) for k, f in frozen.items()}
    tables = {"train": fits_of(played(frozen)), "heldout": fits_of(played(on_held))}
    return {name: to_plain(msgspec.to_builtins(one)) for name, one in tables.items()}


def _with(before: Fit, effect: Any) -> Fit:
    """One more effect, from where the screen sees it; from the neutral values where that gains nothing."""
    stretches = [track.stretch for track in before.tracks]
    scores = Screen(before, [effect]).scores()
    start = {**before.values, **(scores[0].start if scores else {})}
    found = fit(stretches, (*before.effects, effect), start, like=before, noise=before.noise)
    return found if found.criterion < before.criterion else before


def _source(recording: Recording, model: ModelFile) -> Source:
    device = model.device
    return hoop_source(
        recording.source,
        recording,
        model.structure,
        model.values(),
        encoder_counts=device.encoder_counts,
        torque_limit=device.torque_limit_nm,
    )
