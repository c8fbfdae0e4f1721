"""What does not belong to a recording is taken out of it: the worst first, the rest looked at again with a new fit.

What happened bends the fit it was found with: a candidate is judged against the level of a fit without it.

Rules of this file: fits are asked for, none is made here.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from hoopd.diagnose.quality.unusual_energy import CANDIDATE
from hoopd.diagnose.quality.unusual_intervals import END_S, Interval, intervals, levels_of, signals_by_name, strongest
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.stretches import Stretch, is_long_enough
from hoopd.plants.scales import motion_scale

# A candidate that is less beyond the usual level once it does not bend the fit any more belongs to the tails that
# disturbances and laws left out have without a hand (measured on tuning cases).
FAR_BEYOND = 5.0
# What is taken out in one round has at least this part of the strongest one's strength.
ROUND_PART = 0.5
MOST_ROUNDS = 3
# More of a recording than this is not set aside: what happens so often is how the plant behaves.
MOST_SHARE = 0.25
# Nor what happens in it so often that no hand, start-up or lost sensor does: play at every reversal is over at once.
# That is more than so many times, and more than once in so many seconds of a plant as fast as the hoop.
MOST_TIMES, ONCE_IN_S = 4, 5.0
# Nor is anything of which so little is left, between the pieces that are too short: there is nothing to compare with.
LEAST_LEFT = 0.5
# Beyond what was seen of it, this much on either side goes too: its onset is below the noise.
MARGIN_S = 0.1


def set_aside(
    stretches: Sequence[Stretch],
    refit: Callable[[Sequence[Stretch]], HypothesisFit],
    first: HypothesisFit | None = None,
    belongs_not: Callable[[Interval], bool] = lambda one: True,
) -> tuple[list[Stretch], list[Interval], HypothesisFit, list[Interval]]:
    """Stretches without what does not belong to them (of what is unusual), what that was, the fit of the rest; and what
    would not belong to them, did it not happen so often."""
    found, current = refit(stretches) if first is None else first, list(stretches)
    out: list[Interval] = []
    total = {name: _seconds([s for s in stretches if s.recording == name]) for name in {s.recording for s in stretches}}
    for _ in range(MOST_ROUNDS):
        worst = _worst([one for one in intervals(found) if _may_not_belong(one, belongs_not)])
        worst = [one for one in worst if _share([*out, *worst], one.recording, total) <= MOST_SHARE]
        worst = leaving_enough(current, worst)
        kept, trial = _without(current, worst, refit) if worst else (current, found)
        confirmed = [one for one in _confirmed(worst, trial) if belongs_not(one)]
        if not confirmed:
            break
        if len(confirmed) < len(worst):
            kept, trial = _without(current, confirmed, refit)
        current, found, out = kept, trial, [*out, *confirmed]
    often = [one for one in out if _is_often(sum(same.recording == one.recording for same in out), one, stretches)]
    if often:
        out = [one for one in out if one not in often]
        current, found = _without(stretches, out, refit)
    return current, sorted(out, key=lambda one: (one.recording, one.t0)), found, often


def often_notes(often: Sequence[Interval]) -> list[str]:
    """What was left in for that, by recording."""
    counts = Counter(one.recording for one in often)
    return [
        f"{name}: something unusual happens {count} times: so often is how the plant behaves, and nothing was set aside"
        for name, count in counts.items()
    ]


def still_unusual(aside: Sequence[Interval], whole: HypothesisFit, usual: HypothesisFit) -> list[Interval]:
    """Those of the intervals that are far beyond the levels of `usual` in a fit of the whole stretches."""
    found = []
    for one in aside:
        every = signals_by_name(whole, one.recording)
        found.append(replace(one, signals=strongest(whole, one.recording, every, (one.t0, one.t1))))
    return _confirmed(found, usual)


def without(stretches: Sequence[Stretch], out: Sequence[Interval]) -> list[Stretch]:
    """Stretches with intervals cut out; what is left too short between two goes as well."""
    return [piece for one in stretches for piece in _cut(one, out)]


def leaving_enough(stretches: Sequence[Stretch], out: Sequence[Interval]) -> list[Interval]:
    """Intervals of the recordings of which their removal leaves a good part."""
    found = []
    for name in dict.fromkeys(one.recording for one in out):
        own = [one for one in stretches if one.recording == name]
        mine = [one for one in out if one.recording == name]
        if _seconds(without(own, mine)) >= LEAST_LEFT * _seconds(own):
            found += mine
    return found


def _is_often(times: int, one: Interval, stretches: Sequence[Stretch]) -> bool:
    """Whether what happens so many times in the interval's recording is how the plant behaves."""
    mine = [each for each in stretches if each.recording == one.recording]
    slower = min(motion_scale(each.plant) for each in mine)
    return times > max(MOST_TIMES, _seconds(mine) / (ONCE_IN_S * slower))


def _without(
    stretches: Sequence[Stretch], out: Sequence[Interval], refit: Callable[[Sequence[Stretch]], HypothesisFit]
) -> tuple[list[Stretch], HypothesisFit]:
    kept = without(stretches, out)
    return kept, refit(kept)


def _may_not_belong(one: Interval, belongs_not: Callable[[Interval], bool]) -> bool:
    """Whether any of the signals in which it shows would say so."""
    named = [replace(one, signals=(signal,)) for signal in one.signals if signal.strength >= CANDIDATE]
    return any(belongs_not(each) for each in named)


def _confirmed(candidates: Sequence[Interval], without: HypothesisFit) -> list[Interval]:
    """Those far beyond the level of a fit that they do not bend, as they look against that level."""
    found = []
    for one in candidates:
        now = levels_of(without, one.recording)
        signals = [
            s._replace(strength=s.strength * s.level / max(level, 1e-300), level=level)
            for s in one.signals
            if (level := now.get((s.where, s.kind), s.level)) > 0.0
        ]
        again = replace(one, signals=tuple(sorted(signals, key=lambda s: -s.strength)))
        if again.signals and again.strength >= FAR_BEYOND:
            found.append(again)
    return found


def _worst(found: Sequence[Interval]) -> list[Interval]:
    most = max((one.strength for one in found), default=0.0)
    return [one for one in found if one.strength >= ROUND_PART * most]


def _share(out: Sequence[Interval], recording: str, total: Mapping[str, float]) -> float:
    return sum(one.t1 - one.t0 for one in out if one.recording == recording) / max(total[recording], 1e-9)


def _seconds(stretches: Sequence[Stretch]) -> float:
    return float(sum(one.t[-1] - one.t[0] for one in stretches))


def _cut(stretch: Stretch, out: Sequence[Interval]) -> list[Stretch]:
    pieces, slower = [stretch], motion_scale(stretch.plant)
    margin, end = MARGIN_S * slower, END_S * slower
    for one in out:
        if one.recording == stretch.recording:
            # what is unusual right from the start has been so before
            begin = one.t0 - margin if one.t0 > stretch.t[0] + 2 * end else -np.inf
            ends = (-np.inf, begin), (one.t1 + margin, np.inf)
            pieces = [piece.seconds(*span) for piece in pieces for span in ends]
    return [piece for piece in pieces if is_long_enough(piece)]
