"""Did the inputs go on between their rows as was told? The base model, fitted to the other ways, says.

An input that is held is late by nothing; one that was averaged or filtered goes on smoothly. Told wrongly, half a
sample of it is found as a delay of the drive or a latency of a sensor, and an inertia that is too small.

Where a curve was laid through the rows, a fit allows for what they leave open of it; the ways are compared without this
allowance, which one of them alone has.

Rules of this file: a sentence, never an act: what the device did between two rows its maker knows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hoopd.diagnose.inputs import Source, source_of
from hoopd.diagnose.quality.excluded_stretches import without
from hoopd.diagnose.quality.unusual_intervals import Interval
from hoopd.files.reading import InputError
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretches import Stretch
from hoopd.recording.recording import Recording


def hold_doubts(
    sources: Sequence[Source], ignored: Sequence[Interval], base: HypothesisFit, threshold: float
) -> list[str]:
    """One sentence where another hold is likelier by more than `threshold` nats; none where the device's is known."""
    told = {signal.hold for source in sources for signal in source.recording.inputs.values()}
    if len(told) != 1 or told == {"mean"} or any(source.recording.is_tick for source in sources):
        return []
    criterion = _criterion_as_told(base)
    gains = {hold: criterion - _criterion(sources, ignored, base, hold) for hold in _HOW if hold not in told}
    best = max(gains, key=lambda hold: gains[hold])
    if gains[best] < threshold:
        return []
    return [
        f"the inputs are read with --hold {told.pop()}; with --hold {best} the model without any effect explains the"
        f" same readings better by {gains[best]:.3g} nats: was the input {_HOW[best]}?"
    ]


_HOW: Mapping[str, str] = {
    "zero": "held from row to row",
    "linear": "going straight from row to row",
    "smooth": "filtered, or averaged (--hold mean, where readings were, too), before it was written down",
}


def _criterion_as_told(base: HypothesisFit) -> float:
    """Of the base model, its inputs taken for known between their rows."""
    stretches = [track.stretch for track in base.tracks]
    if not any(one.unresolved.any() for one in stretches):
        return base.criterion
    return fit([_known(one) for one in stretches], base.effects, base.values, noise=base.noise).criterion


def _known(stretch: Stretch) -> Stretch:
    return replace(stretch, unresolved=np.zeros_like(stretch.unresolved))


def _criterion(sources: Sequence[Source], ignored: Sequence[Interval], base: HypothesisFit, hold: str) -> float:
    """Of the base model with another hold; endless where there is nothing to fit."""
    try:
        others = [_held(source, hold) for source in sources]
    except InputError:
        return np.inf
    stretches = without([one for source in others for one in source.stretches], ignored)
    if sum(one.samples for one in stretches) != sum(track.stretch.samples for track in base.tracks):
        return np.inf
    return fit([_known(one) for one in stretches], base.effects, base.values, noise=base.noise).criterion


def _held(source: Source, hold: str) -> Source:
    """The same part of a recording with its inputs told otherwise."""
    other = source_of(source.name, _with_hold(source.recording, hold), source.quality.plant)
    return other.part(float(source.stretches[0].t[0]), float(source.stretches[-1].t[-1]))


def _with_hold(recording: Recording, hold: str) -> Recording:
    return recording.replaced(inputs={name: replace(one, hold=hold) for name, one in recording.inputs.items()})
