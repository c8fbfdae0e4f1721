"""A curve fitted together with everything a fit has already: its values at the knots, with bands.

A screen estimates a curve to first order; the joint fit moves base, effects, curve and trajectory together.

Rules of this file: one way from scores to a fit with curves in it, and from that to shapes; nothing is judged.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.curve import UnnamedCurve
from hoopd.diagnose.curves.curve_screen import CurveScore
from hoopd.ident.normal import Z95
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.recording.spans import spans

Array = NDArray[np.float64]


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
        return [(float(self.x[a]), float(self.x[b - 1])) for a, b in spans(active)]


def shapes_of(score: CurveScore, recordings: Sequence[str]) -> tuple[Shape, ...]:
    """Values and bands as the screen estimates them, beside the base's parameters."""
    return _shapes(score.curve, score.values, score.covariance, recordings)


def _shapes(curve: UnnamedCurve, values: Array, covariance: Array, recordings: Sequence[str]) -> tuple[Shape, ...]:
    m, half = len(curve.knots), Z95 * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    names = list(recordings) if curve.per_recording else [None]
    found = []
    for i, name in enumerate(names):
        y, wide = values[i * m : (i + 1) * m], half[i * m : (i + 1) * m]
        if np.any(wide > 0.0):  # none: the recording's plant does not have the curve
            found.append(Shape(name, curve.knots, y, y - wide, y + wide))
    return tuple(found)


def with_curve(
    score: CurveScore, beside: HypothesisFit, recordings: Sequence[str]
) -> tuple[UnnamedCurve, dict[str, float]]:
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


def together(scores: Sequence[CurveScore], beside: HypothesisFit) -> tuple[HypothesisFit, list[UnnamedCurve]]:
    """Curves fitted jointly with everything the fit has, noise levels held: the fit, and the curves as it has them."""
    recordings = beside.recordings
    made = [with_curve(score, beside, recordings) for score in scores]
    start = {name: value for _, values in made for name, value in values.items()}
    joint = fit(
        [track.stretch for track in beside.tracks], (*beside.effects, *(curve.effect for curve, _ in made)), start,
        noise=beside.noise, like=beside, tune_noise=False,
    )  # fmt: skip
    return joint, [curve for curve, _ in made]


def fitted_shapes(curve: UnnamedCurve, joint: HypothesisFit, recordings: Sequence[str]) -> tuple[Shape, ...]:
    """Values and bands of a curve with a basis, by a fit that holds it."""
    assert curve.basis is not None
    k, values, blocks = curve.basis.shape[1], [], []
    if curve.per_recording:
        # those whose plant has the curve's slot
        recordings = [r for r in recordings if f"{curve.name}.c0@{r}" in joint.free]
    for mark in [f"@{r}" for r in recordings] if curve.per_recording else [""]:
        names = [f"{curve.name}.c{i}{mark}" for i in range(k)]
        where = [joint.free.index(name) for name in names]
        values.append(curve.basis @ np.array([joint.values[name] for name in names]))
        blocks.append(np.diag(curve.basis @ joint.covariance[np.ix_(where, where)] @ curve.basis.T))
    return _shapes(replace(curve, basis=None), np.concatenate(values), np.diag(np.concatenate(blocks)), recordings)
