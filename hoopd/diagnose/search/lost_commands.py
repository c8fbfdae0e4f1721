"""Commands that a drive never heard: what was demanded before acted for a sample more.

Every change of the first input is asked for by itself. Had it not been heard, the input would have been another one
over a single sample; what the log-likelihood gains by that is one inner product with the fit's adjoint, and what it may
gain at most follows from the same pass over white rows. A mixture over all changes says whether a share of them was
lost: those are as the drive had them from then on, everything is fitted again, and the rest is looked at once more.

A drive that is late, or weak, shows at every change and is none of that: a share is small, and what is lost is lost
wholly.

Rules of this file: inputs that act on a coordinate; fits are asked for, none is made here.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, log, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from hoopd.diagnose.camera_faults import CountedFault
from hoopd.diagnose.search.adjoint import Adjoint
from hoopd.diagnose.search.screen import Screen
from hoopd.diagnose.search.surprise import needed_gain, surprise
from hoopd.ident.normal import Z95
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.stretches import Stretch

Array = NDArray[np.float64]
Refit = Callable[[Sequence[Stretch]], HypothesisFit]

# Shares that are tried; with a larger one a drive is late.
SHARES = np.geomspace(1e-4, 0.2, 60)
# One or two may be anything that took so long: they are left to what looks for pushes. Nothing else that is left out is
# known yet: what it brings has to be beyond the threshold by so much.
FEWEST, BEYOND = 3, 3.0
MOST_ROUNDS = 4
# Of a sample time, what is surely not over within one.
WITHIN = 0.5
# What a unit of force shows is much the same at neighbouring changes; over so many white rows tell it.
ALIKE = 15
# Moments that a sentence names.
TOLD = 5


@dataclass(frozen=True)
class LostCommands:
    """Over all recordings."""

    moments: Mapping[str, Sequence[float]] = field(default_factory=dict)  # by recording, s: starts of the samples
    changes: int = 0  # of the input, all recordings together
    gain: float = 0.0  # nats, what it costs to say which they are taken off

    @property
    def count(self) -> int:
        """Of those that were lost."""
        return sum(map(len, self.moments.values()))

    def fault(self, name: str, threshold: float) -> CountedFault | None:
        """As a counted fault; None where it is none."""
        told = surprise(self.gain, 1)
        if not self.count or told <= threshold:
            return None
        share = self.count / self.changes
        half = Z95 * sqrt(share * (1.0 - share) / self.changes)
        ends = max(share - half, 0.0), min(share + half, 1.0)
        return CountedFault(name, share, ends, self.gain, told, needed_gain(threshold, 1))

    @property
    def sentence(self) -> str:
        """How many, and when the first ones were."""
        each = [f"{t:.4g} s of {name}" for name, times in self.moments.items() for t in times]
        more = f" and {len(each) - TOLD} more" if len(each) > TOLD else ""
        return f"{self.count} of {self.changes} changes of the input, at {', '.join(each[:TOLD])}{more}"


def as_heard(
    stretches: Sequence[Stretch], first: HypothesisFit, refit: Refit, threshold: float
) -> tuple[list[Stretch], HypothesisFit, LostCommands]:
    """Stretches with the inputs as the drive had them, their fit, and what was lost."""
    current, found, every = list(stretches), first, dict[str, set[float]]()
    total = sum(len(_changes(one)) for one in stretches)
    for _ in range(MOST_ROUNDS):
        lost = _lost(found, stretches, threshold)
        new = {name: times - every.get(name, set()) for name, times in lost.items()}
        if not any(new.values()):
            break
        every |= {name: every.get(name, set()) | times for name, times in new.items()}
        # in the order of time, so that what was lost before a lost command stays for that, too
        current = [_without(one, every.get(one.recording, set())) for one in stretches]
        found = refit(current)
    moments = {name: sorted(times) for name, times in every.items()}
    count = sum(map(len, moments.values()))
    gain = first.criterion - found.criterion - _cost(count, total)
    if count < FEWEST or gain <= BEYOND * threshold:
        return list(stretches), first, LostCommands()
    return current, found, LostCommands(moments, total, gain)


def _cost(count: int, total: int) -> float:
    """Nats, to say which of all changes were lost."""
    if not 0 < count < total:
        return 0.0
    share = count / total
    return -count * log(share) - (total - count) * log(1.0 - share)


def _lost(found: HypothesisFit, given: Sequence[Stretch], threshold: float) -> dict[str, set[float]]:
    """Starts of samples whose command was not heard, by recording; none where chance may be it. Asked of are the
    changes of the inputs as they were `given`, that are still changes."""
    if not any(one.plant.driven is not None and len(_changes(one)) for one in given):
        return {}
    adjoint = Adjoint(Screen(found, []))
    gains: list[Array] = []
    places: list[tuple[str, Array]] = []
    for track, slopes, before in zip(found.tracks, adjoint.by_force, given, strict=True):
        stretch = track.stretch
        ends = _ends(before)
        changes = np.array([k for k in _changes(stretch).tolist() if k in ends], dtype=np.intp)
        if not len(changes) or stretch.plant.driven is None:
            continue
        own = slopes[:, stretch.plant.disturbed.index(stretch.plant.driven)]
        over = np.array([own[k : ends[k]].sum(axis=0) for k in changes.tolist()])
        size = stretch.u[changes - 1] - stretch.u[changes]
        shown = uniform_filter1d(np.mean(over[:, 1:] ** 2, axis=1), min(ALIKE, len(changes)), mode="nearest")
        gains.append(size * over[:, 0] - size**2 * shown / 2.0)
        places.append((stretch.recording, stretch.t[changes]))
    if not gains:
        return {}
    every = np.concatenate(gains)
    mixtures = np.array([np.logaddexp(np.log1p(-p), np.log(p) + every).sum() for p in SHARES])
    best = int(np.argmax(mixtures))
    if best == len(SHARES) - 1 or surprise(float(mixtures[best]), 1) <= threshold:
        return {}
    least = float(np.log1p(-SHARES[best]) - np.log(SHARES[best]))
    lost: dict[str, set[float]] = {}
    for (name, t), own in zip(places, gains, strict=True):
        lost.setdefault(name, set()).update(t[own > least].tolist())
    return lost


def _changes(stretch: Stretch) -> NDArray[np.intp]:
    """Steps that begin with another input than the one before."""
    return np.flatnonzero(np.diff(stretch.u) != 0.0) + 1


def _ends(stretch: Stretch) -> dict[int, int]:
    """Of every change the first step that does not belong to its sample: none beyond the next change, or half of a
    usual sample later."""
    changes = _changes(stretch)
    sample_s = min(stretch.plant.time_scale_s, _row_s(stretch))
    over = np.searchsorted(stretch.t[:-1], stretch.t[changes] + WITHIN * sample_s)
    ends = np.maximum(changes + 1, np.minimum(over, np.append(changes[1:], len(stretch.u))[: len(changes)]))
    return dict(zip(changes.tolist(), ends.tolist(), strict=True))


def _row_s(stretch: Stretch) -> float:
    """Usual time between two readings of what is driven, which come with the input; other sensors may read between."""
    plant = stretch.plant
    own = [i for i, name in enumerate(plant.channels) if plant.state_of(name) == plant.driven]
    rows = np.flatnonzero(np.isfinite(stretch.y[:, own]).any(axis=1)) if own else np.arange(len(stretch.t))
    return float(np.median(np.diff(stretch.t[rows]))) if len(rows) > 1 else inf


def _without(stretch: Stretch, moments: Collection[float]) -> Stretch:
    """With the input of the sample before where a command was lost."""
    if not moments:
        return stretch
    u = stretch.u.copy()
    for k, end in _ends(stretch).items():
        if float(stretch.t[k]) in moments:
            u[k:end] = u[k - 1]
    return replace(stretch, u=u)
