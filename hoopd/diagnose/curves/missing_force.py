"""The smoothed missing force of a slot against what it may depend on: the picture behind a name.

Rules of this file: it fills `report_curves` from a fit; nothing is judged here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from hoopd.diagnose.curves.curve import UnnamedCurve
from hoopd.diagnose.curves.curve_fits import Shape
from hoopd.diagnose.curves.curve_sites import CurveVariable, wanted
from hoopd.diagnose.quality.unusual_intervals import disturbance
from hoopd.diagnose.report_curves import Binned, LawCurve, MissingForce, Regressor
from hoopd.diagnose.search.effect_changes import at_nodes
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Point
from hoopd.plants.likelihood.fitting import HypothesisFit

Array = NDArray[np.float64]

BINS = 24
# A bin with fewer samples has no mean of its own.
FEWEST = 8
# What is in a bin for a moment only says next to nothing of its mean: so many independent samples more are taken.
LEAST_FREEDOM, LEVEL = 2.0, 0.95


def missing_force(
    fit: HypothesisFit,
    index: int,
    slot: str,
    depends_on: Sequence[str],
    laws: Mapping[str, Sequence[LawCurve]] | None = None,
) -> MissingForce:
    """Of one track: force on the slot's coordinate, or the error of its first channel; regressors by name."""
    track = fit.tracks[index]
    plant = track.stretch.plant
    value, unit = _value(fit, index, slot)
    s, known = at_nodes(track, fit), variables(plant)
    regressors = []
    for name in dict.fromkeys(depends_on):
        if name in known:
            x = _wrapped(known[name], s, len(value))
            law = next(iter((laws or {}).get(name, ())), None)
            regressors.append(Regressor(name, known[name].unit, x, binned(x, value), law))
    return MissingForce(slot, unit, track.stretch.t, value, regressors, track.stretch.recording)


def _value(fit: HypothesisFit, index: int, slot: str) -> tuple[Array, str]:
    track, columns = fit.tracks[index], fit.columns[index]
    plant = track.stretch.plant
    own = plant.slots[slot]
    if own.kind == "sensor":
        # what is left of the readings on the smoothed trajectory
        channel = own.channels[0]
        column = list(plant.channels).index(channel)
        left = np.where(columns.model.seen[:, column], columns.eps[:, column, 0], np.nan)
        return left, next(s.unit for s, _, _ in wanted(plant) if s.acts == "reading" and channel in s.on)
    q = own.coordinate if own.coordinate in plant.disturbed else plant.disturbed[0]
    return disturbance(fit, index)[:, plant.disturbed.index(q)], plant.disturbance_unit(q)


def variables(plant: Plant) -> dict[str, CurveVariable]:
    """All that curves of this plant depend on, by name; of an angle the one that comes back after a turn."""
    found: dict[str, CurveVariable] = {}
    for _, variable, factor in wanted(plant):
        found.setdefault(variable.name, variable)
        if factor is not None:
            found.setdefault(factor.name, CurveVariable(*factor))
    return found


def _wrapped(variable: CurveVariable, s: Point, n: int) -> Array:
    x = np.broadcast_to(np.asarray(variable.of(s), dtype=float), (n,))
    return np.asarray(x if variable.period is None else np.mod(x, variable.period))


def binned(x: Array, y: Array, bins: int = BINS) -> Binned:
    """Means of y (n,) in bins of x (n,) of equal numbers, 95 % bands; what was sampled soon after counts less."""
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    x, y = x[known], y[known]
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1))) if len(x) else np.zeros(0)
    where = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    each = [one for i in range(max(len(edges) - 1, 0)) if len(one := np.flatnonzero(where == i)) >= FEWEST]
    rho = _correlation(y, each)
    rows = []
    for one in each:
        # about their own mean so many independent samples scatter by (n - 1)/n of their variance
        freedom = max(_independent(known[one], rho) - 1.0, LEAST_FREEDOM)
        half = float(stdtrit(freedom, 0.5 + LEVEL / 2.0) * y[one].std()) / np.sqrt(freedom)
        rows.append((float(x[one].mean()), float(y[one].mean()), half))
    centre, mean, half_width = np.array(rows).reshape(-1, 3).T
    return Binned(centre, mean, mean - half_width, mean + half_width)


def _correlation(y: Array, each: Sequence[NDArray[np.intp]]) -> float:
    """Of neighbours in time, of what is left of y (n,) about the means of its bins."""
    rest = y.copy()
    for one in each:
        rest[one] -= y[one].mean()
    return float(np.clip(rest[1:] @ rest[:-1] / max(float(rest @ rest), 1e-300), 0.0, 0.99)) if len(y) > 1 else 0.0


def _independent(index: NDArray[np.intp], rho: float) -> float:
    """As how many the samples of a bin count, which were taken at these indices: n^2 / sum_ij rho^|k_i - k_j|."""
    together, before = float(len(index)), 0.0
    for gap in np.diff(index):
        before = rho ** float(gap) * (1.0 + before)
        together += 2.0 * before
    return len(index) ** 2 / together


# ---------------------------------------------------------------------------------------------- laws


def law_of_curve(curve: UnnamedCurve, shape: Shape) -> LawCurve:
    """A fitted curve over its variable; over a turn it ends where it began."""
    if curve.variable.period is None:
        return LawCurve(curve.slot, shape.x, shape.y)
    return LawCurve(curve.slot, np.append(shape.x, curve.variable.period), np.append(shape.y, shape.y[0]))
