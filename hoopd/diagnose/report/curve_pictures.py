"""The curves of a report: from the fits of a diagnosis to the arrays that are drawn.

Rules of this file: arrays for `report_curves`, nothing judged and nothing fitted; what misses at a
slot is in `effect_force`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.effect_force import (
    MissingForceSamples,
    Variable,
    missing_where_it_acts,
    recording_with_most,
)
from hoopd.diagnose.curves.missing_force import binned, law_of_curve, missing_force
from hoopd.diagnose.curves.unknown_effects import Unknown
from hoopd.diagnose.proof.fit_tables import Played, series
from hoopd.diagnose.record import Ignored
from hoopd.diagnose.report.sentences import windows
from hoopd.diagnose.report.time_strips import strips
from hoopd.diagnose.report_curves import (
    Binned,
    Comparison,
    Harmonics,
    LawCurve,
    MissingForce,
    Regressor,
    Shown,
    Trace,
)
from hoopd.diagnose.search.naming import Named
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.usual_sizes import channel_unit
from hoopd.plants.likelihood.fitting import HypothesisFit

Array = NDArray[np.float64]
Ignoreds = Mapping[str, Sequence[Ignored]]

# A page shows so many recordings; more are in its tables.
MOST_RECORDINGS = 6
# Points of a law's curve: at most so many, each a median of so many samples.
LAW_POINTS, LAW_SAMPLES = 200, 8
# A step of a law at rest of more than this share of its range is a jump, not a slope.
JUMP_SHARE = 0.4
# A line through fewer samples goes through all; waves that a part of a turn cannot tell apart are left small.
LEAST_OF_A_LINE, LEAST_SINGULAR = 3, 1e-3
# A law that the other variables move by more than this share of its range is no curve over one of them.
SINGLE_SHARE = 0.1
# Points of a turn at which a periodic law is drawn, and neighbours that belong to one bin of samples.
TURN_POINTS, TURN_BINS = 721, 96
# The amplitude that noise exceeds with this chance; orders of a turn, and samples that one of them needs.
CHANCE, MOST_ORDERS, SAMPLES_AN_ORDER = 0.01, 24, 20


def shown_of(named: Named, heldout: Mapping[str, Played], unknown: Unknown | None, ignored: Ignoreds) -> Shown:
    """Everything that can be drawn of a search; `heldout`: base and final on held-out data; ignored: by recording."""
    own = [name for name in named.final.names if name not in named.base.names]
    found = [missing for name in own if (missing := _missing(named, name)) is not None]
    forces = [force_of(slot, label, missing) for slot, label, missing in found]
    spectra = [harmonics_of(slot, missing) for slot, _, missing in found]
    return Shown(
        comparisons=comparisons(heldout["base"], heldout["final"], ignored) if heldout else (),
        forces=[*forces, *([] if unknown is None else unknown_forces(named.base, unknown))],
        strips=[*strips(named.base, named.final, ignored)],
        harmonics=[one for one in spectra if one is not None],
    )


# ---------------------------------------------------------------------------------------------- before and after


def comparisons(base: Played, final: Played, ignored: Ignoreds) -> list[Comparison]:
    """Measured, before and after over windows, by recording."""
    return [
        Comparison(name, traces(base, final, name), windows(base.window_s), ignored.get(name, ()))
        for name in base.fit.recordings[:MOST_RECORDINGS]
    ]


def traces(base: Played, final: Played, recording: str) -> list[Trace]:
    """One for each channel of a recording."""
    before, after = (series(one.by_recording().get(recording, [])) for one in (base, final))
    plant = next(track.stretch.plant for track in base.fit.tracks if track.stretch.recording == recording)
    found = [_trace(name, plant, parts, after.get(name, [])) for name, parts in before.items()]
    # without a finding there is no model with any
    return found if final.fit.names != base.fit.names else [replace(one, after=None) for one in found]


def _trace(name: str, plant: Plant, before: Sequence[Sequence[Array]], after: Sequence[Sequence[Array]]) -> Trace:
    pieces = [np.stack([*one, two[2]]) for one, two in zip(before, after, strict=True) if len(one[0])]
    lifted = [part for piece in pieces for part in (piece, np.full((4, 1), np.nan))][:-1]
    t, measured, first, last = np.concatenate(lifted, axis=1) if lifted else np.zeros((4, 0))
    # the pen is lifted by values; the axis of time goes on
    t = np.interp(np.arange(len(t)), np.flatnonzero(np.isfinite(t)), t[np.isfinite(t)]) if len(t) else t
    return Trace(name, channel_unit(plant, name), t, measured, first, last)


# ---------------------------------------------------------------------------------------------- missing forces


def _missing(named: Named, name: str) -> tuple[str, str, MissingForceSamples] | None:
    effect = next(one for one in named.final.effects if one.name == name)
    found = missing_where_it_acts(effect, named.final, named.without.get(name, named.base).noise)
    return None if found is None else (effect.slot, name, found)


def force_of(slot: str, label: str, missing: MissingForceSamples) -> MissingForce:
    """As it is drawn: over each variable with bins and law."""
    regressors = [
        Regressor(
            one.name,
            one.unit,
            one.value,
            _bins(one.value, missing.value),
            law_over(label, one, missing.law),
            one.turning,
        )
        for one in missing.variables
    ]
    return MissingForce(slot, missing.unit, missing.t_s, missing.value, regressors, missing.recording, missing.reading)


def _bins(x: Array, y: Array) -> Binned | None:
    """None when there is too little."""
    found = binned(x, y)
    return found if len(found.x) > 1 else None


def law_over(label: str, over: Variable, law: Array) -> LawCurve | None:
    """The law as a curve where it follows this variable alone, on a fine grid over a turn; else its values."""
    # a step in which the variable changes its sign is a mean of both sides
    one_sided = np.append(over.value[1:] * over.value[:-1] > 0.0, False)
    x, y = _known(over.value[one_sided], law[one_sided])
    points = min(LAW_POINTS, len(x) // LAW_SAMPLES)
    if points < 3:
        return None
    if _scatter(x, y, over.turning) > SINGLE_SHARE * max(float(np.ptp(y)), 1e-300):
        return LawCurve(label, x, y, is_curve=False)
    if over.turning:
        return LawCurve(label, *_round(x, y))
    edges = _spread_edges(x, points)
    at, mean = np.array([(x[own].mean(), np.median(y[own])) for own in _members(x, edges) if own.any()]).T
    return LawCurve(label, *_lifted(at, mean))


def _scatter(x: Array, y: Array, turning: bool) -> float:
    """Usual spread of y (n,) about a line within neighbours in x (n,): of what else it follows."""
    edges = (
        np.linspace(0.0, 2 * np.pi, TURN_BINS + 1)
        if turning
        else _spread_edges(x, min(LAW_POINTS, len(x) // LAW_SAMPLES))
    )
    rest = []
    for own in _members(x, edges):
        if own.sum() > LEAST_OF_A_LINE:
            basis = np.column_stack([np.ones(own.sum()), x[own] - x[own].mean()])
            rest.append(float(np.std(y[own] - basis @ np.linalg.lstsq(basis, y[own], rcond=None)[0])))
    return float(np.median(rest)) if rest else 0.0


def _round(x: Array, y: Array) -> tuple[Array, Array]:
    """A law over a turn as the waves that its samples (n,) are made of; the pen is lifted where there are none."""
    grid = np.linspace(0.0, 2 * np.pi, TURN_POINTS)
    orders = np.arange(1, min(MOST_ORDERS, len(x) // SAMPLES_AN_ORDER) + 1)
    weights = np.linalg.lstsq(_waves(x, orders), y, rcond=LEAST_SINGULAR)[0]
    drawn = _waves(grid, orders) @ weights
    if float(np.var(y - _waves(x, orders) @ weights)) > (SINGLE_SHARE * float(np.ptp(y))) ** 2:
        # narrower than the shortest wave: from bin to bin
        bins = [own for own in _members(x, np.linspace(0.0, 2 * np.pi, TURN_BINS + 1)) if own.any()]
        drawn = np.interp(grid, [x[own].mean() for own in bins], [np.median(y[own]) for own in bins], period=2 * np.pi)
    there = np.sort(x)
    beside = np.searchsorted(there, grid)
    nearest = np.minimum(np.abs(grid - there[beside % len(x)]), np.abs(grid - there[beside - 1]))
    apart = np.minimum(nearest, 2 * np.pi - nearest)
    return grid, np.where(apart > 2 * np.pi / TURN_BINS, np.nan, drawn)


def _waves(x: Array, orders: NDArray[np.int_]) -> Array:
    """1, sin n x, cos n x as columns."""
    return np.column_stack([np.ones_like(x), *(f(n * x) for n in orders for f in (np.sin, np.cos))])


def _lifted(x: Array, y: Array) -> tuple[Array, Array]:
    """NaN between the two sides of zero where the law jumps there."""
    k = int(np.searchsorted(x, 0.0))
    if not 0 < k < len(x) or abs(y[k] - y[k - 1]) < JUMP_SHARE * np.ptp(y):
        return x, y
    return np.insert(x, k, 0.0), np.insert(y, k, np.nan)


def _known(x: Array, y: Array) -> tuple[Array, Array]:
    both = np.isfinite(x) & np.isfinite(y)
    return x[both], y[both]


def _spread_edges(x: Array, count: int) -> Array:
    """Edges with as many values in every bin; none holds both signs."""
    if len(x) < count:
        return np.zeros(0)
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, count + 1)))
    return np.unique(np.append(edges, 0.0)) if edges[0] < 0.0 < edges[-1] else edges


def _members(x: Array, edges: Array) -> Iterator[NDArray[np.bool_]]:
    where = np.clip(np.searchsorted(edges, x, side="right"), 1, max(len(edges) - 1, 1))
    return (where == k for k in range(1, len(edges)))


def unknown_forces(base: HypothesisFit, unknown: Unknown) -> list[MissingForce]:
    """What the base needs at the slot of a curve over what it follows, with the curve; a coefficient is no force."""
    curve, recording = unknown.curve, recording_with_most(base, unknown.curve.slot)
    if recording is None or curve.factor is not None:
        return []
    index = next(i for i, track in enumerate(base.tracks) if track.stretch.recording == recording)
    shape = next((one for one in unknown.shapes if one.recording == recording), unknown.shapes[0])
    laws = {curve.variable.name: [replace(law_of_curve(curve, shape), label="fitted curve")]}
    return [missing_force(base, index, curve.slot, curve.depends_on, laws)]


def harmonics_of(slot: str, missing: MissingForceSamples) -> Harmonics | None:
    """Amplitudes by order of a turning angle that the force follows; None when it follows none."""
    angle = next((one for one in missing.variables if one.turning), None)
    if angle is None:
        return None
    x, y = _known(angle.value, missing.value)
    orders = np.arange(1, min(MOST_ORDERS, len(x) // SAMPLES_AN_ORDER) + 1)
    if not len(orders):
        return None
    # y = c + sum a_n sin n x + b_n cos n x
    basis = _waves(x, orders)
    weights, *_ = np.linalg.lstsq(basis, y, rcond=None)
    rest = y - basis @ weights
    # an amplitude of noise: Rayleigh with 2 sigma^2/n, n (1 - rho)/(1 + rho) independent values of n correlated ones
    rho = float(np.clip(rest[1:] @ rest[:-1] / max(float(rest @ rest), 1e-300), 0.0, 0.99))
    sigma = np.sqrt(2.0 * np.mean(rest**2) / max(len(x) * (1 - rho) / (1 + rho), 1.0))
    threshold = np.full(len(orders), sigma * np.sqrt(-2.0 * np.log(CHANCE)))
    pairs = weights[1:].reshape(-1, 2)
    return Harmonics(slot, angle.name, missing.unit, orders.astype(float), np.hypot(*pairs.T), threshold)
