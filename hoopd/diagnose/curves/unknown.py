"""Whether anything in the library explains the data, and if not, what the missing thing looks like.

A curve at some slot always explains at least as much as the law behind it, at the price of more columns. Nothing in the
library explains the data when, beside the best named set, a curve still says more than chance and carries a good part
of all there was to explain; or when no name was accepted, and the best name, were it the truth, would hardly ever leave
a curve so far ahead.

Rules of this file: gains are compared as expected nats (gain less half a nat a column) and as surprises; what chance
does to a difference is drawn from the data set's own columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.curve import Curve
from hoopd.diagnose.curves.screen import CurveScore, CurveScreen, by_slot, library_groups, null_quantiles
from hoopd.diagnose.engine.fitting import Fit, fit
from hoopd.diagnose.search.chance import Group, Null, projections
from hoopd.diagnose.search.screen import Score, Screen
from hoopd.ident.device.uncertainty import Z95
from hoopd.physics.effects.base import Effect

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


@dataclass(frozen=True)
class Survey:
    """What library and curves say beside one fit."""

    fit: Fit
    library: Screen
    named: list[Score]
    screen: CurveScreen
    curves: list[CurveScore]
    null: Null
    threshold: float  # surprise, nats

    @property
    def fires(self) -> bool:
        """Whether a curve says more than chance."""
        return bool(self.curves) and self.curves[0].surprise > self.threshold


def survey(
    found: Fit, library: Sequence[Effect], *, draws: int = 100, seed: int = 0, screen: Screen | None = None
) -> Survey:
    """All of a library and all curves beside a fit; `screen`: of the same fit, where there is one already."""
    screen = Screen(found, library) if screen is None else screen
    of_curves = CurveScreen(found)
    null = null_quantiles(screen, of_curves, draws, seed)
    return Survey(
        found, screen, screen.scores(), of_curves, of_curves.scores(), null, null.threshold(DETECTION_CHANCE)
    )  # fmt: skip


@dataclass(frozen=True)
class Shape:
    """Values of a curve at its knots with their 95 % bands, (m,) each."""

    recording: str | None
    x: Array
    y: Array
    low: Array
    high: Array

    @property
    def region(self) -> list[tuple[float, float]]:
        """Intervals of the variable in which the band excludes zero."""
        active = (self.low > 0.0) | (self.high < 0.0)
        edges = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(int)))
        return [(float(self.x[a]), float(self.x[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


@dataclass(frozen=True)
class Unknown:
    """Something that is not in the library."""

    curve: Curve
    shapes: tuple[Shape, ...]  # one, or one for each recording
    gain: float  # nats over the fit that it stands beside
    surprise: float
    threshold: float
    share: float  # of all that names and curve explain, the curve's
    beside_names: bool  # False: it stands alone, the accepted names explain nothing that it does not
    not_excluded: tuple[str, ...]  # other slots, the likeliest first
    channels: dict[str, float]  # share of the change that each channel shows
    reason: str

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
    rest = expected(named.curves[0].gain, named.curves[0].columns) if named.fires else 0.0
    share = rest / max(rest + explained, 1e-12)
    if share <= LEAST_SHARE:
        return None
    alone = expected(base.curves[0].gain, base.curves[0].columns) > ALONE_PART * (rest + explained)
    reason = f"beside {', '.join(named.fit.names)} a curve still carries {share:.0%} of what can be explained"
    return _unknown(base if alone and base.fires else named, share, not alone, reason)


def expected(gain: float, columns: int) -> float:
    """Nats beyond what so many columns gain by chance."""
    return max(gain - columns / 2.0, 0.0)


def _unnamed(base: Survey, draws: int, seed: int) -> Unknown | None:
    """Nothing was accepted although a curve fires: unknown, unless the best name could have left it ahead by chance."""
    best, name = base.curves[0], base.named[0] if base.named else None
    if name is None:
        return _unknown(base, 1.0, False, "the library has nothing for this plant")
    part = expected(name.gain, len(name.member.columns)) / max(expected(best.gain, best.columns), 1e-12)
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
    seen = _best_seen(base.screen.groups(), base) - _best_seen(library_groups(base.library), base)
    noise = np.random.default_rng([seed, 13]).standard_normal((len(name.vector), draws))
    made = name.vector[:, None] + noise
    lead = _best(base.screen.groups(), made) - _best(library_groups(base.library), made)
    return float((1 + np.sum(lead >= seen)) / (1 + draws))


def _best(groups: Sequence[Group], residuals: Array) -> Array:
    """(draws,) the largest surprise of any group."""
    found = np.zeros(residuals.shape[1])
    for group in groups:
        found = np.maximum(found, projections(group, residuals).surprises())
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
        best.curve, shapes_of(best, at.screen.recordings), best.gain, best.surprise, at.threshold, share,
        beside_names, tuple(near), at.screen.shares(best.vector), reason,
    )  # fmt: skip


# ---------------------------------------------------------------------------------------------- its shape


def shapes_of(score: CurveScore, recordings: Sequence[str]) -> tuple[Shape, ...]:
    """Values and bands as the screen estimates them, beside the base's parameters."""
    return _shapes(score.curve, score.values, score.covariance, recordings)


def _shapes(curve: Curve, values: Array, covariance: Array, recordings: Sequence[str]) -> tuple[Shape, ...]:
    m, half = len(curve.knots), Z95 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    names = list(recordings) if curve.per_recording else [None]
    found = []
    for i, name in enumerate(names):
        y, wide = values[i * m : (i + 1) * m], half[i * m : (i + 1) * m]
        found.append(Shape(name, curve.knots, y, y - wide, y + wide))
    return tuple(found)


def with_curve(score: CurveScore, beside: Fit, recordings: Sequence[str]) -> tuple[Curve, dict[str, float]]:
    """The curve in directions that are not the base's, and where a joint fit with it starts."""
    m, parts = len(score.curve.knots), len(recordings) if score.curve.per_recording else 1
    basis = _pooled(score.basis, m, parts)
    curve = score.curve.with_basis(basis)
    start = dict(beside.values)
    for i in range(parts):
        mark = f"@{recordings[i]}" if score.curve.per_recording else ""
        weights = np.linalg.lstsq(basis, score.values[i * m : (i + 1) * m], rcond=None)[0]
        start.update({f"{curve.name}.c{k}{mark}": float(w) for k, w in enumerate(weights)})
    return curve, start


def _pooled(basis: Array, m: int, parts: int) -> Array:
    """One basis (m, k) for all recordings: the span of each one's directions."""
    if parts == 1:
        return basis
    blocks = np.concatenate(np.split(basis, parts, axis=0), axis=1)
    u, s, _ = np.linalg.svd(blocks, full_matrices=False)
    kept = s > 1e-3 * s[0]
    return np.asarray(u[:, kept] * s[kept])


def refitted(score: CurveScore, beside: Fit) -> tuple[Fit, tuple[Shape, ...]]:
    """The curve fitted jointly with everything the fit has: the fit, and the curve's values with their bands."""
    recordings = tuple(dict.fromkeys(track.stretch.recording for track in beside.tracks))
    curve, start = with_curve(score, beside, recordings)
    joint = fit(
        [track.stretch for track in beside.tracks], (*beside.effects, curve.effect), start,
        noise=beside.noise, like=beside, tune_noise=False,
    )  # fmt: skip
    return joint, fitted_shapes(curve, joint, recordings)


def fitted_shapes(curve: Curve, joint: Fit, recordings: Sequence[str]) -> tuple[Shape, ...]:
    """Values and bands of a curve with a basis, by a fit that holds it."""
    assert curve.basis is not None
    k, marks = curve.basis.shape[1], [f"@{r}" for r in recordings] if curve.per_recording else [""]
    values, blocks = [], []
    for mark in marks:
        names = [f"{curve.name}.c{i}{mark}" for i in range(k)]
        where = [joint.free.index(name) for name in names]
        values.append(curve.basis @ np.array([joint.values[name] for name in names]))
        blocks.append(np.diag(curve.basis @ joint.covariance[np.ix_(where, where)] @ curve.basis.T))
    return _shapes(replace(curve, basis=None), np.concatenate(values), np.diag(np.concatenate(blocks)), recordings)
