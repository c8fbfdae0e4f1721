"""What of a case's recordings counts, and the plain fits of it.

Rules of this file: no name of an effect; what is set aside is told.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hoopd.diagnose.case import Case
from hoopd.diagnose.search.bounded_disturbance import likeliest
from hoopd.diagnose.search.candidates import free_of_recordings
from hoopd.diagnose.search.excluded_intervals import CountedData, without_events
from hoopd.diagnose.search.lost_commands import as_heard
from hoopd.diagnose.search.surprise import THRESHOLD
from hoopd.files.reading import InputError
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch


def as_given(case: Case, train: Sequence[Stretch]) -> HypothesisFit:
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


def proving(held: list[Stretch], base: HypothesisFit, threshold: float = THRESHOLD) -> CountedData:
    """What counts of the held-out data."""

    def refit(stretches: Sequence[Stretch]) -> HypothesisFit:
        return fit(stretches, base.effects, base.values, free=free_of_recordings(base.effects, stretches))

    if not held:
        return CountedData([], [])
    heard, found, lost = as_heard(held, refit(held), refit, threshold)
    return replace(without_events(heard, refit, found)[0], unheard=lost)
