"""Whether anything in the library explains the data, and if not, what the missing thing looks like.

A curve at some slot always explains at least as much as the law behind it, at the price of more columns. Nothing in the
library explains the data when, beside the best named set, a curve still says more than chance and carries a good part
of all there was to explain; or when no name was accepted, and the best name, were it the truth, would hardly ever leave
a curve so far ahead.

Rules of this file: gains are compared as expected nats (gain less half a nat a column) and as surprises; what chance
does to a difference is drawn from the data set's own columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.curve import UnnamedCurve
from hoopd.diagnose.curves.curve_fits import Shape, shapes_of
from hoopd.diagnose.curves.curve_screen import CurveScore, CurveScreen, by_slot, library_groups, null_quantiles
from hoopd.diagnose.search.candidates import surprise_of
from hoopd.diagnose.search.chance import Group, Null, projections
from hoopd.diagnose.search.scan_score import Scanned
from hoopd.diagnose.search.screen import Score, Screen
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit

Array = NDArray[np.float64]

# The best of the library and all curves exceeds the threshold by chance in this share of data sets without any effect.
DETECTION_CHANCE = 0.01
# Nothing in the library explains it when curves carry more than this of the gain of names and curves together ...
LEAST_SHARE = 0.25
# ... or when the best name has less than this of the best curve's expected nats ...
NAMED_PART = 0.75
# ... and would, were it the truth, leave a curve so far ahead with less than this chance.
DIFFERENCE_CHANCE = 0.01
# The curve alone stands for everything when it has this part of what names and curve explain together.
ALONE_PART = 0.9
# Another slot is not excluded when its best curve is at most this far behind, nats.
NOT_EXCLUDED_NATS = 3.0
# A ceiling has curves at so many slots: a further one follows what is left of the same thing.
MOST_SLOTS = 3


@dataclass(frozen=True)
class Survey:
    """What library and curves say beside one fit."""

    fit: HypothesisFit
    library: Screen
    named: list[Score]  # best of every name, most gain first
    screen: CurveScreen
    curves: list[CurveScore]
    null: Null
    threshold: float  # surprise, nats
    fitted: frozenset[str] = frozenset()  # names whose gain is that of a joint fit

    @property
    def fires(self) -> bool:
        """Whether a curve says more than chance."""
        return bool(self.curves) and self.curves[0].surprise > self.threshold


def survey(
    found: HypothesisFit,
    library: Sequence[Effect],
    *,
    draws: int = 100,
    seed: int = 0,
    screen: Screen | None = None,
    also: Iterable[Score] = (),
    fitted: Iterable[Score] = (),
) -> Survey:
    """All of a library and all curves beside a fit; `screen`: of the same fit, where there is one already; `also`:
    what scans know about names beside this fit, the better one counts; `fitted`: what joint fits came to, which counts
    whatever a screen hoped for: it is linear, and a lag that is no lag gains there what no lag can."""
    screen = Screen(found, library) if screen is None else screen
    of_curves = CurveScreen(found)
    null = null_quantiles(screen, of_curves, draws, seed)
    fitted = list(fitted)
    names = {one.member.effect.name for one in fitted}
    told = [_beside(screen, one) for one in (*fitted, *(s for s in also if s.member.effect.name not in names))]
    hoped = [one for one in screen.scores() if one.member.effect.name not in names]
    named = best_of_each([*told, *hoped])
    threshold = null.threshold(DETECTION_CHANCE)
    return Survey(found, screen, named, of_curves, of_curves.scores(), null, threshold, frozenset(names))


def best_curves(about: Survey) -> list[CurveScore]:
    """The best curve of every slot that asks for one beside those of the slots before, at most MOST_SLOTS."""
    chosen: list[CurveScore] = []
    left = {slot: one for slot, one in by_slot(about.curves).items() if one.surprise > about.threshold}
    while left and len(chosen) < MOST_SLOTS:
        beside = {slot: about.screen.beside(one, chosen) for slot, one in left.items()}
        slot = max(beside, key=lambda name: beside[name])
        if beside[slot] <= about.threshold:
            break
        chosen.append(left.pop(slot))
    return chosen


def best_of_each(scores: Iterable[Score]) -> list[Score]:
    """The largest gain of every name, the largest first."""
    best: dict[str, Score] = {}
    for one in scores:
        name = one.member.effect.name
        if name not in best or one.gain > best[name].gain:
            best[name] = one
    return sorted(best.values(), key=lambda one: -one.gain)


def _beside(screen: Screen, score: Score) -> Score:
    """A score from elsewhere with its change beside the screen's fit, as large as its gain says; none where the data
    are others."""
    if score.origin is screen.fit and np.isclose(score.vector @ score.vector, 2.0 * score.gain, rtol=1e-3):
        return score
    if len(score.vector) != len(screen.residual):
        return replace(score, vector=np.zeros(len(screen.residual)))
    vector = screen.projected(score.vector[:, None])[:, 0]
    size = np.sqrt(2.0 * max(score.gain, 0.0) / max(float(vector @ vector), 1e-300))
    return replace(score, vector=vector * size)


@dataclass(frozen=True)
class Unknown:
    """Something that is not in the library."""

    score: CurveScore
    beside: HypothesisFit  # what it stands beside
    shapes: tuple[Shape, ...]  # one, or one for each recording
    gain: float  # nats over the fit that it stands beside
    surprise: float
    threshold: float
    share: float  # of all that names and curve explain, the curve's
    beside_names: bool  # False: it stands alone, the accepted names explain nothing that it does not
    not_excluded: tuple[str, ...]  # other slots, the likeliest first
    channels: dict[str, float]  # share of the change that each channel shows
    reason: str
    carries_over: bool | None = None  # False: held-out data ask for such a curve with other values; None: not asked

    @property
    def curve(self) -> UnnamedCurve:
        """As it was screened."""
        return self.score.curve

    @property
    def name(self) -> str:
        """unknown.SLOT"""
        return f"unknown.{self.curve.slot}"


def judge_unknown(base: Survey, named: Survey | None = None, *, draws: int = 200, seed: int = 0) -> Unknown | None:
    """None when names (or chance) are enough; `named`: beside the best accepted set, None when nothing was accepted."""
    if not base.curves:
        return None
    if named is None:
        return _unnamed(base, draws, seed) if base.fires else None
    explained = max(base.fit.criterion - named.fit.criterion, 0.0)
    rest = of_curve(named.curves[0]) if named.fires else 0.0
    share = rest / max(rest + explained, 1e-12)
    if share <= LEAST_SHARE or _known_part(named) >= NAMED_PART:
        return None
    alone = base.fires and of_curve(base.curves[0]) > ALONE_PART * (rest + explained)
    reason = f"beside {', '.join(named.fit.names)} a curve still carries {share:.0%} of what can be explained"
    return _unknown(base if alone else named, share, not alone, reason)


def not_told_apart(base: Survey) -> Unknown | None:
    """The best curve, though the best name that was too little for itself could be what it follows; None where no
    curve says more than chance. Held-out data have to ask for it."""
    if not base.fires:
        return None
    name = max(base.named, key=of_name, default=None)
    could = "" if name is None else f"{name.member.effect.name} could be it, and has too few nats of its own"
    return _unknown(base, 1.0, False, could)


def expected(gain: float, columns: int) -> float:
    """Nats beyond what so many columns gain by chance."""
    return max(gain - columns / 2.0, 0.0)


def of_curve(score: CurveScore) -> float:
    """Expected nats of a curve; like a name's without regard to the residual's colour, which inflates both."""
    return expected(score.gain, score.columns)


def of_name(score: Score) -> float:
    """Expected nats of a name, told how many places were looked at."""
    if isinstance(score, Scanned):
        return max(expected(score.gain, score.freedom) - log(max(score.candidates, 1.0)), 0.0)
    return expected(score.gain, len(score.member.columns))


def _known_part(about: Survey) -> float:
    """Expected nats of the best name over those of the best curve."""
    return max(map(of_name, about.named), default=0.0) / max(of_curve(about.curves[0]), 1e-12)


def _unnamed(base: Survey, draws: int, seed: int) -> Unknown | None:
    """Nothing was accepted although a curve fires: unknown, unless the best name could have left it ahead by chance."""
    name, part = max(base.named, key=of_name, default=None), _known_part(base)
    if name is None:
        return _unknown(base, 1.0, False, "the library has nothing for this plant")
    if part >= NAMED_PART:
        return None
    chance = chance_of_lead(base, name, draws, seed)
    if chance > DIFFERENCE_CHANCE:
        return None
    reason = f"the best name, {name.member.effect.name}, explains {part:.0%} of what a curve explains"
    return _unknown(base, 1.0, False, reason)


def chance_of_lead(base: Survey, name: Score, draws: int, seed: int) -> float:
    """Were `name` the truth: how often the best curve would lead the best of the library as far as it does.

    Leads are in surprise (nats); the truth's change is the one the name makes at its best, the noise is white.
    """
    stretches = [track.stretch for track in base.fit.tracks]
    known = max((surprise_of(one, one.gain, stretches) for one in base.named), default=0.0)
    own = library_groups(base.library, base.fitted)
    if isinstance(name, Scanned) and np.any(name.vector):
        own.append(Group(name.vector[:, None], True))
    seen = _best_seen(base.screen.groups(), base) - max(_best_seen(own, base), known)
    noise = np.random.default_rng([seed, 13]).standard_normal((len(name.vector), draws))
    made = name.vector[:, None] + noise
    lead = _best(base.screen.groups(), made) - _best(own, made)
    return float((1 + np.sum(lead >= seen)) / (1 + draws))


def _best(groups: Sequence[Group], residuals: Array) -> Array:
    """(draws,) the largest surprise of any group."""
    found = np.zeros(residuals.shape[1])
    for one in projections(groups, residuals):
        found = np.maximum(found, one.surprises())
    return found


def _best_seen(groups: Sequence[Group], base: Survey) -> float:
    return float(_best(groups, base.library.residual[:, None])[0])


def _unknown(at: Survey, share: float, beside_names: bool, reason: str) -> Unknown:
    best = at.curves[0]
    near = [
        slot for slot, one in by_slot(at.curves).items()
        if slot != best.curve.slot and best.surprise - one.surprise < NOT_EXCLUDED_NATS
    ]  # fmt: skip
    return Unknown(
        best, at.fit, shapes_of(best, at.screen.recordings), best.gain, best.surprise, at.threshold, share,
        beside_names, tuple(near), at.screen.shares(best.vector), reason,
    )  # fmt: skip
