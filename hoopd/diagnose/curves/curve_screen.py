"""What every curve would explain of what a fit leaves, and how surprising that is.

All hats of all curves are whitened in one pass of the fit's own filter.

Rules of this file: like `screen`: it proposes, a fit decides.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.curve import UnnamedCurve, curves
from hoopd.diagnose.curves.curve_changes import add_change, within
from hoopd.diagnose.search.chance import Group, Null, colour, independent, null_of
from hoopd.diagnose.search.effect_changes import at_nodes
from hoopd.diagnose.search.kept_columns import KeptColumns, exact, free_of, joined, kept_columns
from hoopd.diagnose.search.processes import computed
from hoopd.diagnose.search.screen import Screen, meaningful, orthonormal
from hoopd.diagnose.search.surprise import surprise
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import whitened
from hoopd.plants.likelihood.reference_track import Track

Array = NDArray[np.float64]

# A direction counts as a curve's own when at least this share of its squared length is not the base's. What is nearly
# the base's (a scale of the camera at small angles is) would be decided by how well the disturbance's spectrum is
# known, because the angles answer to the disturbance: 3 of 26 clean tuning cases had a false scale, with this none.
OWN_SHARE = 0.01


# Curves whose hats one task whitens.
TOGETHER = 12


@dataclass(frozen=True)
class CurveScore:
    """What a curve would gain over the fit; values at its knots are of least size among those that gain as much."""

    curve: UnnamedCurve
    gain: float  # nats
    columns: int  # directions that are not the base's
    surprise: float  # nats: -log of the chance of so large a gain, the residual's colour allowed for
    values: Array  # (m,) or (recordings * m,) in the curve's unit
    covariance: Array  # of the values, without what the base's parameters share
    vector: Array  # (rows,) the change it makes, whitened and projected
    basis: Array  # (m, k) of the values: unit steps are one standard error each
    colour: float  # by which the residual's colour inflates the gain


class CurveScreen:
    """The whitened hats of all curves about one fit."""

    def __init__(self, fit: HypothesisFit, of: Sequence[UnnamedCurve] | None = None) -> None:
        self.fit, self.curves = fit, list(curves(fit) if of is None else of)
        self.recordings = fit.recordings
        rows = fit.stacked()
        self._known = orthonormal(rows[:, 1:])
        self.residual = self.projected(rows[:, :1])[:, 0]
        counts = [self._columns_of(curve) for curve in self.curves]
        self._first = np.concatenate([[0], np.cumsum(counts)]).astype(int)
        self._size, self.vectors = self._kept()
        self._bases: dict[int, Array] = {}

    def projected(self, x: Array) -> Array:
        """Rows freed of the directions of all free parameters."""
        return free_of(self._known, x.copy())

    def scores(self) -> list[CurveScore]:
        """Of all curves, the most surprising first."""
        found = [self.score(index, self.residual) for index in range(len(self.curves))]
        return sorted(found, key=lambda one: (-one.surprise, one.curve.name))

    def score(self, index: int, residual: Array) -> CurveScore:
        """Of one curve for a projected residual (rows,)."""
        z, basis = self._own(index)[0], self._basis(index)
        unit = z @ basis
        along = unit.T @ residual
        gain, inflated = float(along @ along) / 2, self._colour(unit, residual)
        return CurveScore(
            self.curves[index], gain, basis.shape[1], surprise(gain / inflated, basis.shape[1]),
            basis @ along, basis @ basis.T, unit @ along, basis, inflated,
        )  # fmt: skip

    def beside(self, score: CurveScore, others: Sequence[CurveScore]) -> float:
        """Surprise of a curve beside others, all their values free; nats."""
        if not others:
            return score.surprise
        z = [self._own(self._index(one.curve))[0] @ one.basis for one in (*others, score)]
        known = orthonormal(np.concatenate(z[:-1], axis=1))
        own, rest = z[-1] - known @ (known.T @ z[-1]), self.residual - known @ (known.T @ self.residual)
        _, values, vectors = independent(own, np.ones(own.shape[1]), OWN_SHARE)
        along = (own @ (vectors / np.sqrt(values))).T @ rest
        return surprise(float(along @ along) / 2 / score.colour, len(values))

    def shares(self, vector: Array) -> dict[str, float]:
        """Share of a whitened change (rows,) that each channel shows."""
        energy: dict[str, float] = {}
        ends = np.cumsum([len(rows) for rows in self.fit.rows])[:-1]
        for track, part in zip(self.fit.tracks, np.split(vector, ends), strict=True):
            channels = track.composite.channels
            for name, one in zip(channels, np.sum(part.reshape(-1, len(channels)) ** 2, axis=0), strict=True):
                energy[name] = energy.get(name, 0.0) + float(one)
        total = max(sum(energy.values()), 1e-300)
        return {name: one / total for name, one in energy.items()}

    def groups(self) -> list[Group]:
        """Orthonormal directions of every curve."""
        found = []
        for index in range(len(self.curves)):
            basis = self._basis(index)
            if basis.shape[1]:
                found.append(Group(self.vectors[:, self._place(index)], basis=basis))
        return found

    def _basis(self, index: int) -> Array:
        """(m, k) of a curve's values in units of one standard error each."""
        if index not in self._bases:
            # U = Z B,  B = D^-1 V L^-1/2
            size, values, vectors = independent(*self._own(index), OWN_SHARE)
            self._bases[index] = vectors / np.sqrt(values) / size[:, None]
        return self._bases[index]

    def _index(self, curve: UnnamedCurve) -> int:
        return next(i for i, one in enumerate(self.curves) if one is curve)

    def _colour(self, unit: Array, residual: Array) -> float:
        if not unit.shape[1]:
            return 1.0
        return colour(unit, residual, [(len(t.z), len(t.composite.channels)) for t in self.fit.tracks])

    def _own(self, index: int) -> tuple[Array, Array]:
        columns = self._place(index)
        return exact(self.vectors[:, columns]), self._size[columns]

    def _place(self, index: int) -> slice:
        return slice(self._first[index], self._first[index + 1])

    def _columns_of(self, curve: UnnamedCurve) -> int:
        return len(curve.knots) * (len(self.recordings) if curve.per_recording else 1)

    def _kept(self) -> tuple[Array, KeptColumns]:
        """Norms (m,) of all columns, and the columns without the directions of the free parameters."""
        parts = [range(i, min(i + TOGETHER, len(self.curves))) for i in range(0, len(self.curves), TOGETHER)]
        found = computed([partial(self._kept_together, part) for part in parts])
        return np.concatenate([size for size, _ in found] or [np.zeros(0)]), joined(
            [columns for _, columns in found], len(self.residual)
        )

    def _kept_together(self, part: range) -> tuple[Array, KeptColumns]:
        raw = self._whitened_together(part)
        return np.sqrt(np.einsum("rm,rm->m", raw, raw)), kept_columns(free_of(self._known, raw))

    def _whitened_together(self, part: range) -> Array:
        out = []
        for track, columns, found in zip(self.fit.tracks, self.fit.columns, self.fit.gains, strict=True):
            f, eps = self._changes(track, part)
            with np.errstate(over="ignore", invalid="ignore"):  # what overflows is left out below
                white = whitened(columns.model, found, f, eps)
            out.append(white.reshape(-1, white.shape[2]))
        # what is added to the model is taken from the residual
        every = np.concatenate(out)
        return meaningful(np.negative(every, out=every))

    def _changes(self, track: Track, part: range) -> tuple[Array, Array]:
        n, begin = len(track.z), int(self._first[part.start])
        total = int(self._first[part.stop]) - begin
        f = np.zeros((n - 1, track.composite.nz, total))
        eps = np.zeros((n, len(track.composite.channels), total))
        points = within(track, self.fit), at_nodes(track, self.fit)
        which = self.recordings.index(track.stretch.recording)
        for first, curve in ((self._first[i] - begin, self.curves[i]) for i in part):
            if curve.fits(track.stretch.plant):
                m = len(curve.knots)
                start = first + (m * which if curve.per_recording else 0)
                add_change(curve, track, self.fit, points, f[:, :, start : start + m], eps[:, :, start : start + m])
        return f, eps


# ---------------------------------------------------------------------------------------------- beside a named library


def library_groups(screen: Screen, without: Collection[str] = ()) -> list[Group]:
    """Columns of every member of a library but some effects'; more than one that must be positive count as free."""
    found, first = [], 0
    for member in screen.members:
        z = screen.vectors[:, first : first + len(member.columns)]
        first += len(member.columns)
        if member.effect.name not in without and np.any(np.sum(exact(z) ** 2, axis=0) > 1e-12):
            found.append(Group(z, len(member.columns) == 1 and member.columns[0].signed))
    return found


def null_quantiles(screen: Screen | None, of: CurveScreen | None, draws: int = 100, seed: int = 0) -> Null:
    """What the best of a library and all curves reaches by chance on these very data."""
    groups = [*(library_groups(screen) if screen else []), *(of.groups() if of else [])]
    return null_of(groups, draws, seed)


def by_slot(scores: Sequence[CurveScore]) -> Mapping[str, CurveScore]:
    """The most surprising curve of every slot."""
    best: dict[str, CurveScore] = {}
    for one in scores:
        if one.curve.slot not in best or one.surprise > best[one.curve.slot].surprise:
            best[one.curve.slot] = one
    return best
