"""The diagnosis of recordings: judged, fitted, searched, proven, and put down as data.

Rules of this file: it calls the steps in their order and fills the record; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hoopd.diagnose.dataset import Stretch
from hoopd.diagnose.findings import base_of, candidates_of, effects_of, fits_of, location_of, verdict_of
from hoopd.diagnose.fitting import Fit, fit
from hoopd.diagnose.inputs import Source
from hoopd.diagnose.naming import Named, Settings, free_of_recordings, name_effects
from hoopd.diagnose.quality import corruption_findings
from hoopd.diagnose.record import SCHEMA, DataQuality, Diagnosis, FitTable, RecordingQuality
from hoopd.diagnose.shown import Shown
from hoopd.physics.effects.base import Effect

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
    seed: int = 0
    held_out_how: str = ""
    progress: Progress = lambda text: None
    settings: Settings = field(default_factory=Settings)


@dataclass(frozen=True)
class Outcome:
    """The diagnosis, the curves behind it, and the fits for who writes a model."""

    diagnosis: Diagnosis
    shown: Shown
    named: Named
    heldout: Mapping[str, Fit]


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
    named = name_effects(train, held, case.library, case.values, case.settings)
    case.progress("proof on held-out data")
    fits = heldout_fits(named, held)
    table = FitTable(
        train=fits_of({"nominal": named.nominal, "base": named.base, "final": named.final}),
        heldout=fits_of(fits) if fits else {},
        how_heldout=case.held_out_how,
    )
    found = corruption(case.train)
    effects = effects_of(named, fits, case.settings.threshold, found)
    diagnosis = Diagnosis(
        schema=SCHEMA,
        verdict=verdict_of(named, effects, case.settings.threshold),
        base=base_of(case.model, named),
        location=location_of(named),
        effects=effects,
        fit=table,
        unexplained=None,
        next_experiment=None,
        data_quality=quality_of([*case.train, *case.heldout]),
        seed=case.seed,
        candidates=candidates_of(named, case.settings.threshold),
    )
    return Outcome(diagnosis, Shown(), named, fits)


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


def quality_of(sources: Sequence[Source]) -> DataQuality:
    """Shares over all recordings, and of each."""
    each, notes = {}, []
    unique = {source.name: source for source in sources}
    for name, source in unique.items():
        counts, rows = source.quality.data_quality(), max(len(source.recording), 1)
        each[name] = RecordingQuality(
            missing=counts["missing"] / rows,
            late_frames=counts["late_frames"] / rows,
            outliers=counts["outliers"] / rows,
            segments_ignored=[tuple(one) for one in counts["segments_ignored"]],
            notes=list(source.quality.notes),
        )
    total = sum(len(s.recording) for s in unique.values())

    def mean(key: str) -> float:
        return sum(getattr(each[n], key) * len(s.recording) for n, s in unique.items()) / max(total, 1)

    return DataQuality(
        missing=mean("missing"),
        late_frames=mean("late_frames"),
        outliers=mean("outliers"),
        segments_ignored=[one for part in each.values() for one in part.segments_ignored],
        recordings=each,
        notes=notes,
    )


def _stretches(sources: Sequence[Source]) -> list[Stretch]:
    return [one for source in sources for one in source.stretches]
