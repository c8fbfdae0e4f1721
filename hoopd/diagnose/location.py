"""Where a mismatch sits, as it is told: slot, channel, what it follows, when, and the evidence of every slot.

The place is that of the strongest finding; the evidence by slot needs no finding: it is the surprise of the best law or
curve that could sit there. Where re-estimated parameters are the whole answer, no slot is told, only the channel that
showed it.

Rules of this file: from what was measured to a record; nothing is screened or fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from hoopd.diagnose.curves.effect_force import follows
from hoopd.diagnose.curves.location_evidence import locate
from hoopd.diagnose.curves.unknown_effects import Survey, Unknown
from hoopd.diagnose.record import EffectFinding, Location, Verdict
from hoopd.diagnose.search.naming import Named
from hoopd.diagnose.search.screen import Column, whitened_changes
from hoopd.plants.effects.base import Effect
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

# What shows in less than so much of the time has segments of its own: the fewest seconds that hold most of its energy.
MOST_ENERGY, SELDOM = 0.9, 0.25
BIN_S = 0.5


def location_of(
    named: Named, base: Survey, unknown: Unknown | None, verdict: Verdict, findings: Sequence[EffectFinding] = ()
) -> Location:
    """Of the first of the findings (they come with the most evidence first); of a channel where parameters are it."""
    evidence: dict[str, float | None] = {**locate(base)}
    if verdict == "parameters":
        return Location(
            slot=None, channel=_most(base.screen.shares(_moved(named))), segments=None, depends_on=[],
            evidence=evidence,
        )  # fmt: skip
    if not findings:
        return Location.nowhere(evidence)
    first = findings[0]
    if unknown is not None and first.name == unknown.name:
        return _at(unknown.curve.slot, unknown.curve.depends_on, unknown.score.vector, base, evidence)
    effect = next((one.effect for one in named.accepted if one.effect.name == first.name), None)
    if effect is None:
        # a counted fault, before any model: it is there all the time
        return Location(
            slot=first.slot, channel=_seen_by(first.slot, named), segments=None, depends_on=[], evidence=evidence
        )  # fmt: skip
    found = _at(effect.slot, effect.depends_on, change_by(effect, named), base, evidence)
    plant = next(t.stretch.plant for t in named.final.tracks if effect.slot in t.stretch.plant.slots)
    return replace(found, depends_on=[*follows(effect, plant, found.channel)])


def _seen_by(slot: str, named: Named) -> str:
    """The channel of a sensor; of a drive, the one that reads what it moves."""
    plant = next(t.stretch.plant for t in named.base.tracks if slot in t.stretch.plant.slots)
    own = plant.slots[slot].channels or [name for name in plant.channels if plant.state_of(name) == plant.driven]
    return next(iter(own or plant.channels))


def _at(
    slot: str, depends_on: tuple[str, ...], vector: Array, base: Survey, evidence: dict[str, float | None]
) -> Location:
    shares = base.screen.shares(vector)
    return Location(
        slot=slot, channel=_most(shares), segments=segments_of(vector, base), depends_on=list(depends_on),
        evidence=evidence,
    )  # fmt: skip


def _most(shares: Mapping[str, float]) -> str | None:
    return max(shares, key=lambda name: shares[name]) if sum(shares.values()) > 0.0 else None


def _moved(named: Named) -> Array:
    """(rows,) what the parameters' way from the given to the re-estimated values changes, whitened."""
    base = named.base
    delta = [base.values[name] - named.nominal.values.get(name, base.values[name]) for name in base.free]
    return np.asarray(base.stacked()[:, 1:] @ np.array(delta))


def change_by(effect: Effect, named: Named) -> Array:
    """(rows,) what a named effect changes at its fitted values, whitened as the base's innovations are."""
    final, total = named.final, np.zeros(sum(len(rows) for rows in named.base.rows))
    for recording in final.recordings:
        mark = f"@{recording}"
        values = {
            p.name: final.values.get(effect.key(p.name) + mark, final.values.get(effect.key(p.name), p.neutral))
            for p in effect.parameters
        }
        total += whitened_changes(named.base, [(effect, Column(tuple(values.items()), recording))])[:, 0]
    return total


def segments_of(vector: Array, base: Survey) -> list[tuple[float, float]] | None:
    """Seconds of the recording in which a change (rows,) shows most; None when it is there most of the time."""
    energy, seconds = _by_bin(vector, base)
    bin_s = _bin_s(base)
    order = np.argsort([-one for one in energy.values()], kind="stable")
    total, names = sum(energy.values()), list(energy)
    upto = np.searchsorted(np.cumsum(np.array([*energy.values()])[order]), MOST_ENERGY * total) + 1
    if total <= 0.0 or upto * bin_s >= SELDOM * seconds:
        return None
    chosen = [names[i] for i in order[:upto]]
    first = chosen[0][0]
    return _joined(sorted(number for recording, number in chosen if recording == first), bin_s)


def _by_bin(vector: Array, base: Survey) -> tuple[dict[tuple[str, int], float], float]:
    """Energy by recording and bin of time, and the seconds of all recordings."""
    energy: dict[tuple[str, int], float] = {}
    ends = np.cumsum([len(rows) for rows in base.fit.rows])[:-1]
    seconds = 0.0
    for track, part in zip(base.fit.tracks, np.split(vector, ends), strict=True):
        t = track.stretch.t
        seconds += float(t[-1] - t[0])
        each = np.sum(part.reshape(len(t), -1) ** 2, axis=1)
        for number, one in zip(np.floor(t / _bin_s(base)).astype(int), each, strict=True):
            key = (track.stretch.recording, int(number))
            energy[key] = energy.get(key, 0.0) + float(one)
    return energy, seconds


def _bin_s(base: Survey) -> float:
    """A bin of time, s."""
    return BIN_S * min(motion_scale(track.stretch.plant) for track in base.fit.tracks)


def _joined(numbers: list[int], bin_s: float) -> list[tuple[float, float]]:
    """Bins that touch, or have one between them, as one segment."""
    found: list[tuple[float, float]] = []
    for number in numbers:
        begin, end = number * bin_s, (number + 1) * bin_s
        if found and begin - found[-1][1] <= bin_s:
            found[-1] = (found[-1][0], end)
        else:
            found.append((begin, end))
    return found
