"""Where a mismatch sits: evidence by slot.

The evidence of a slot is the surprise of the best curve or law that could sit there: a curve is a free force, torque
map or sensor error over one variable, so that no name is needed to find a place.

Rules of this file: it ranks what `unknown.survey` measured and fits nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

from hoopd.diagnose.curves.unknown_effects import Survey
from hoopd.diagnose.search.candidates import surprise_of


def locate(found: Survey) -> dict[str, float]:
    """Nats by slot, of every slot of the plant, from a survey beside the re-fitted base."""
    evidence: dict[str, float] = dict.fromkeys(found.fit.tracks[0].stretch.plant.slots, 0.0)
    for slot, surprise in _explanations(found):
        evidence[slot] = max(evidence.get(slot, 0.0), surprise)
    return evidence


def _explanations(found: Survey) -> Iterator[tuple[str, float]]:
    """Slot and surprise of every law and curve."""
    stretches = [track.stretch for track in found.fit.tracks]
    for score in found.named:
        yield score.member.effect.slot, surprise_of(score, score.gain, stretches)
    for curve in found.curves:
        yield curve.curve.slot, curve.surprise
