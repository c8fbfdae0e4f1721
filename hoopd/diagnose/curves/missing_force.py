"""The smoothed missing force of a slot against what it may depend on: the picture behind a name.

Rules of this file: it fills `report_curves` from a fit; nothing is judged here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.curves.curve import UnnamedCurve
from hoopd.diagnose.curves.curve_fits import Shape
from hoopd.diagnose.curves.curve_sites import CurveVariable, wanted
from hoopd.diagnose.quality.unusual_intervals import disturbance
from hoopd.diagnose.report_curves import Binned, LawCurve, MissingForce, Regressor
from hoopd.diagnose.search.effect_changes import at_nodes
from hoopd.ident.normal import Z95
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Point
from hoopd.plants.likelihood.fitting import HypothesisFit

Array = NDArray[np.float64]

BINS = 24
# A bin with fewer samples has no mean of its own.
FEWEST = 8


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
    """Means of y (n,) in bins of x (n,) of equal numbers, 95 % bands; neighbours in time are correlated."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, bins + 1))) if len(x) else np.zeros(0)
    where = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    # n samples with correlation rho of neighbours count as n (1 - rho)/(1 + rho)
    rho = float(np.clip(y[1:] @ y[:-1] / max(float(y @ y), 1e-300), 0.0, 0.99)) if len(y) > 1 else 0.0
    rows = []
    for i in range(max(len(edges) - 1, 0)):
        own = y[where == i]
        if len(own) >= FEWEST:
            half = Z95 * float(own.std(ddof=1)) / np.sqrt(max(len(own) * (1 - rho) / (1 + rho), 1.0))
            rows.append((float(x[where == i].mean()), float(own.mean()), half))
    centre, mean, half_width = np.array(rows).reshape(-1, 3).T
    return Binned(centre, mean, mean - half_width, mean + half_width)


# ---------------------------------------------------------------------------------------------- laws


def law_of_curve(curve: UnnamedCurve, shape: Shape) -> LawCurve:
    """A fitted curve over its variable; over a turn it ends where it began."""
    if curve.variable.period is None:
        return LawCurve(curve.slot, shape.x, shape.y)
    return LawCurve(curve.slot, np.append(shape.x, curve.variable.period), np.append(shape.y, shape.y[0]))
