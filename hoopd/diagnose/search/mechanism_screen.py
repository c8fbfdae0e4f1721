"""What every mechanism of the grammar would explain of what a fit leaves: some thousand columns, none of them refitted.

What a mechanism remembers is a further axis, on a grid of its constants. Columns are whitened in blocks
(`mechanism_columns`), and only what a score needs is kept. What white noise would make of the same columns is drawn
beside them where it is asked for, so that the largest of thousands has its own level.

Rules of this file: it proposes, a fit decides; laws come from the grammar.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import groupby
from math import atan2, exp

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.search.chance import EULER, Null, colour, independent
from hoopd.diagnose.search.kept_columns import free_of
from hoopd.diagnose.search.mechanism_columns import ColumnPlace, FollowedTrack, MechanismChoice, place_of
from hoopd.diagnose.search.processes import computed
from hoopd.diagnose.search.screen import MOST_DEVIATIONS, orthonormal
from hoopd.diagnose.search.surprise import log_chances, surprise
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.grammar.axes import TIME
from hoopd.plants.effects.grammar.mechanism import Mechanism
from hoopd.plants.effects.grammar.mechanisms import code_nats
from hoopd.plants.effects.grammar.shapes import ALWAYS, BEGAN, CHANGE, STEPS
from hoopd.plants.likelihood.fitting import HypothesisFit

Array = NDArray[np.float64]

# Columns that are whitened at once: they stay near the processor. So many times in one task.
AT_ONCE = 64
SCORED_TOGETHER = 6
DRAWS, DRAW_SEED = 64, 17
# Of a direction's squared length, what must be its own, not the free parameters'.
OWN_SHARE = 0.01
# The residual's colour is asked for the best so many only.
COLOURED = 40
# What began between two recordings did so, in widths, before the second one.
BETWEEN = 2.0
# Frequencies from which a wave over the time is fitted.
MOST_STARTS = 3


@dataclass(frozen=True)
class ProposedMechanism:
    """A mechanism at its best constants beside a fit."""

    mechanism: Mechanism
    constants: dict[str, float]
    gain: float  # nats
    columns: int
    looked_at: float  # choices of its constants, as many as differ
    surprise: float  # nats, told the colour of the residual and how much was looked at; its cost is not taken off
    cost: float  # nats, to say which it is
    start: dict[str, float]  # by the whole model's names
    vector: Array  # (rows,) the change it would make, whitened and projected
    effect: Effect  # its constants in a range about those that were tried

    @property
    def worth(self) -> float:
        """Nats that are left when its cost is paid."""
        return self.surprise - self.cost


class MechanismScreen:
    """The whitened changes of a grammar about one fit, reduced to scores."""

    def __init__(
        self, fit: HypothesisFit, wanted: Sequence[Mechanism], *, level: bool = True, among: int | None = None
    ) -> None:
        """`level`: whether what chance would make of the same columns is asked for (`null`); `among`: of how many
        mechanisms these are the nearest."""
        self.fit = fit
        rows = fit.stacked()
        self._basis = orthonormal(rows[:, 1:])
        self.residual = self._projected(rows[:, :1])[:, 0]
        self._tracks = [FollowedTrack(track, fit, gains) for track, gains in zip(fit.tracks, fit.gains, strict=True)]
        self._recordings = fit.recordings
        self._choices = [one for mechanism in wanted for one in self._tried(mechanism)]
        self._constants: dict[str, list[dict[str, float]]] = {}
        for one in self._choices:
            self._constants.setdefault(one.mechanism.name, []).append(one.constants)
        self._code = code_nats(len(wanted) if among is None else among)
        self._null: Null | None = None
        self._score(DRAWS if level else 0)

    @property
    def null(self) -> Null:
        """What the best of all reaches by chance."""
        if self._null is None:
            raise ValueError("this screen was made without its level")
        return self._null

    # ------------------------------------------------------------------------------------------ what is tried

    def _tried(self, mechanism: Mechanism) -> Iterator[MechanismChoice]:
        own = [one for one in self._tracks if mechanism.effect.fits(one.track.stretch.plant)]
        if not own:
            return
        v = np.concatenate([one.nodes(mechanism.axis) for one in own])
        if not np.all(np.isfinite(v)) or np.ptp(v) <= 1e-9 * max(float(np.abs(v).max()), 1e-300):
            return
        t = _joined_times(own)
        phased = mechanism.shape is not None and mechanism.shape.phased
        # a clock begins anew with each recording
        parts = len(self._recordings) if phased and mechanism.axis.kind == TIME else 1
        means = int(phased and mechanism.shape is not None and mechanism.shape.mean != 0.0)
        followed = v if mechanism.memory is None else np.concatenate([one.way(mechanism.axis) for one in own])
        for constants in self._grid(mechanism, own, followed, t):
            yield MechanismChoice(mechanism, constants, 2 if phased else 1, parts, means)

    def _grid(
        self, mechanism: Mechanism, own: Sequence[FollowedTrack], followed: Array, t: Array
    ) -> Iterator[dict[str, float]]:
        """Constants that are tried; of what lasts, those of each recording in which it may have begun."""
        every = [*dict.fromkeys(one.track.stretch.recording for one in own)]
        if mechanism.shape not in STEPS:
            yield from mechanism.grid(followed, t)
        elif mechanism.shape is not CHANGE:
            # in a single recording it is the same as what lasts, and hardly happens at one time in each
            yield from mechanism.grid(followed, t) if len(every) > 1 else ()
        else:
            for k, name in enumerate(every):
                times = np.concatenate([one.track.stretch.t for one in own if one.track.stretch.recording == name])
                marks = {f"{BEGAN}@{r}": ALWAYS * float(np.sign(j - k)) for j, r in enumerate(every)}
                moments = mechanism.grid(times, times)
                before = [{**one, "v0": -BETWEEN * one["w"]} for one in moments[: int(k > 0)]]
                yield from ({**one, **marks} for one in (*before, *moments))

    def tried(self, name: str) -> dict[str, tuple[float, float]]:
        """Least and largest of each constant that was tried of a mechanism."""
        every = self._constants.get(name, [{}])
        return {key: (min(one[key] for one in every), max(one[key] for one in every)) for key in every[0]}

    # ------------------------------------------------------------------------------------------ scores

    def _score(self, draws: int) -> None:
        noise = np.random.default_rng(DRAW_SEED).standard_normal((len(self.residual), draws))
        beside = np.column_stack([self.residual, self._projected(noise), self._basis])
        every = list(self._together(range(len(self._choices))))
        # what a place does to the residual is worked out once for those that one task scores
        parts = [
            same[i : i + SCORED_TOGETHER]
            for same in (list(group) for _, group in groupby(every, key=lambda one: one[0]))
            for i in range(0, len(same), SCORED_TOGETHER)
        ]
        self._gains = np.zeros(len(self._choices))
        best = np.zeros(draws)
        for part, scored in zip(
            parts, computed([partial(self._scored, part, beside, draws) for part in parts]), strict=True
        ):
            for (_, indices), (gains, chances) in zip(part, scored, strict=True):
                self._gains[indices] = gains
                best = np.minimum(best, chances)
        self._null = Null(max(1.0, float(np.exp(-np.mean(best) - EULER)))) if draws else None

    def _scored(
        self, part: Sequence[tuple[ColumnPlace, list[int]]], beside: Array, draws: int
    ) -> list[tuple[Array, Array]]:
        """Gains of choices that act at one place, and the log chance (draws,) of the best of each draw."""
        found = []
        for place, indices in part:
            some = [self._choices[i] for i in indices]
            with_all, gram = self._products(place, some, beside)
            # what has no number, or one beyond any meaning, explains nothing and draws nothing
            wild = ~(np.einsum("kii->ki", gram) < MOST_DEVIATIONS**2).all(axis=1)
            with_all[wild], gram[wild] = 0.0, 0.0
            along, shared = with_all[:, :, : 1 + draws], with_all[:, :, 1 + draws :]
            size = np.einsum("kii->ki", gram).copy()
            gains = _gains(gram - shared @ shared.transpose(0, 2, 1), size, along)
            best = log_chances(gains[:, 1:].max(axis=0), some[0].columns) if draws else np.zeros(0)
            found.append((gains[:, 0], best))
        return found

    def _together(self, indices: Sequence[int]) -> Iterator[tuple[ColumnPlace, list[int]]]:
        """Choices that act at one place and have as many columns, not too many at once."""
        found: dict[tuple[ColumnPlace, int, int, int], list[int]] = {}
        for i in indices:
            one = self._choices[i]
            found.setdefault((place_of(one.mechanism), one.phases, one.parts, one.means), []).append(i)
        for (place, phases, _, means), every in found.items():
            most = max(1, AT_ONCE // (phases + means))
            yield from ((place, every[i : i + most]) for i in range(0, len(every), most))

    def _products(self, place: ColumnPlace, some: Sequence[MechanismChoice], beside: Array) -> tuple[Array, Array]:
        """Of the whitened columns of some choices with rows `beside` (rows, k), and among each choice's own."""
        count = some[0].columns
        with_all, gram = np.zeros((len(some) * count, beside.shape[1])), np.zeros((len(some), count, count))
        for mine, columns, rows in self._whitened(place, some):
            with_all[columns] += rows @ beside[mine]
            own = rows.reshape(-1, some[0].in_one, rows.shape[1])
            which, within = columns[:: some[0].in_one] // count, columns[: some[0].in_one] % count
            gram[which[:, None, None], within[:, None], within] += own @ own.transpose(0, 2, 1)
        return with_all.reshape(len(some), count, -1), gram

    def _whitened(
        self, place: ColumnPlace, some: Sequence[MechanismChoice]
    ) -> Iterator[tuple[slice, NDArray[np.intp], Array]]:
        """Of every track: which rows are its, which columns it has, and these, each a row."""
        first, count = 0, some[0].columns
        for own, track_rows in zip(self._tracks, self.fit.rows, strict=True):
            mine = slice(first, first + len(track_rows))
            first += len(track_rows)
            fitting = [i for i, one in enumerate(some) if one.mechanism.effect.fits(own.track.stretch.plant)]
            if fitting:
                part = self._recordings.index(own.track.stretch.recording) if some[0].parts > 1 else 0
                columns = (np.array(fitting)[:, None] * count + some[0].within(part)).ravel()
                yield mine, columns, own.rows(place, [some[i] for i in fitting])

    def _projected(self, x: Array) -> Array:
        return free_of(self._basis, x.copy())

    # ------------------------------------------------------------------------------------------ proposals

    def nearest(self, count: int) -> list[Mechanism]:
        """Those that gain most."""
        found: dict[str, Mechanism] = {}
        for i in np.argsort(-self._gains, kind="stable"):
            mechanism = self._choices[i].mechanism
            found.setdefault(mechanism.name, mechanism)
            if len(found) == count:
                break
        return [*found.values()]

    @cached_property
    def proposals(self) -> list[ProposedMechanism]:
        """The best of each mechanism that gains anything, most surprising first."""
        order: dict[str, int] = {}
        alike: dict[str, list[float]] = {}
        for i in np.argsort(-self._gains, kind="stable"):
            name = self._choices[i].mechanism.name
            alike.setdefault(name, []).append(float(self._gains[i]))
            if self._gains[i] > 0.0:
                order.setdefault(name, int(i))
        # of choices that explain as much as the best one, it does not matter which it is
        counts = {name: len(gains) / sum(exp(one - gains[0]) for one in gains) for name, gains in alike.items()}
        found = self._proposed([*order.values()][:COLOURED], counts)
        by_gain = [found[i] for i in sorted(found, key=lambda i: (-self._gains[i], i))]
        return sorted(by_gain, key=lambda one: -one.worth)

    def other_starts(self, proposed: ProposedMechanism) -> list[ProposedMechanism]:
        """Of a wave over the time, its next best frequencies that are not beside a better one: from a wrong one no fit
        comes to the right one, and the best to first order need not be it."""
        mechanism = proposed.mechanism
        if mechanism.shape is None or not mechanism.shape.phased or mechanism.axis.kind != TIME:
            return []
        mine = [i for i, one in enumerate(self._choices) if one.mechanism.name == mechanism.name]
        taken: list[int] = []
        for k in sorted(range(len(mine)), key=lambda k: -self._gains[mine[k]]):
            if all(abs(k - other) > 1 for other in taken):
                taken.append(k)
            if len(taken) == MOST_STARTS:
                break
        found = self._proposed([mine[k] for k in taken[1:]], {mechanism.name: proposed.looked_at})
        return [*found.values()]

    def _proposed(self, wanted: Sequence[int], counts: Mapping[str, float]) -> dict[int, ProposedMechanism]:
        """Choices by their index; `counts`: choices of a mechanism that differ."""
        found = {}
        for place, indices in self._together(wanted):
            some = [self._choices[i] for i in indices]
            raw = np.zeros((len(self.residual), len(some), some[0].columns))
            for mine, columns, rows in self._whitened(place, some):
                raw.reshape(len(raw), -1)[mine, columns] = rows.T
            for k, i in enumerate(indices):
                found[i] = self._proposal(i, raw[:, k], counts[self._choices[i].mechanism.name])
        return found

    def _proposal(self, index: int, raw: Array, looked_at: float) -> ProposedMechanism:
        choice = self._choices[index]
        z = self._projected(raw)
        size, values, vectors = independent(z, np.sqrt(np.sum(raw**2, axis=0)), OWN_SHARE)
        basis = vectors / np.sqrt(np.maximum(values, 1e-300)) / size[:, None]
        unit = z @ basis
        weights = basis @ (unit.T @ self.residual)
        gain = float(self._gains[index])
        shapes = [(len(t.z), len(t.composite.channels)) for t in self.fit.tracks]
        inflated = colour(unit, self.residual, shapes) if unit.shape[1] else 1.0
        beyond = surprise(gain / inflated, choice.columns, looked_at)
        return ProposedMechanism(
            choice.mechanism, choice.constants, gain, choice.columns, looked_at, beyond,
            choice.mechanism.effect.cost_nats + (0.0 if choice.mechanism.textbook else self._code),
            _start(choice, weights, self._recordings), z @ weights,
            choice.mechanism.effect_near(self._constants[choice.mechanism.name]),
        )  # fmt: skip


def _gains(gram: Array, square: Array, along: Array) -> Array:
    """(k, 1+draws) of columns with these products among themselves (k, m, m), freed of the free parameters' part, their
    squared lengths before (k, m) and their products with the rows (k, m, 1+draws)."""
    size = np.sqrt(np.maximum(square, 1e-24))
    values, vectors = np.linalg.eigh(gram / size[:, :, None] / size[:, None, :])
    kept = values > OWN_SHARE
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    turned = np.swapaxes(vectors, 1, 2) @ (along / size[:, :, None])
    return np.asarray(np.sum(inverse[:, :, None] * turned**2, axis=1) / 2.0)


def _start(choice: MechanismChoice, weights: Array, recordings: Sequence[str]) -> dict[str, float]:
    mechanism, effect = choice.mechanism, choice.mechanism.effect
    found = {effect.key(name): value for name, value in choice.constants.items()}
    a = effect.parameter("A")
    if choice.phases == 1:
        return found | {effect.key("A"): float(np.clip(weights[0], a.low, a.high))}
    assert mechanism.shape is not None
    # A sin(x + phi) = a sin x + b cos x, one A of all recordings
    pairs = weights[: 2 * choice.parts].reshape(-1, 2)
    found[effect.key("A")] = float(np.sqrt(np.sum(pairs**2) / len(pairs))) / mechanism.shape.first
    marks = [f"@{name}" for name in recordings] if choice.parts > 1 else [""]
    angles = (atan2(float(b), float(a)) for a, b in pairs)
    return found | {effect.key("phi") + mark: angle for mark, angle in zip(marks, angles, strict=True)}


def _joined_times(own: Sequence[FollowedTrack]) -> Array:
    """Times that run on from stretch to stretch, from zero; grids of constants ask for differences only."""
    parts, end = [], 0.0
    for one in own:
        t = one.track.stretch.t
        parts.append(end + t - t[0])
        end = float(parts[-1][-1])
    return np.concatenate(parts)
