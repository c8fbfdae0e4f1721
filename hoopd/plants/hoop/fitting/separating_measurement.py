"""Which further measurement would tell the two kinematics apart, calculated before anyone makes it.

Rules of this file: expectations from entries and their covariance; no recording is simulated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.hoop.entries import ENTRIES, entries_of
from hoopd.plants.hoop.fitting.physical_parameters import Known, physical_from_entries, quantity
from hoopd.plants.hoop.parameters import KINEMATICS

Array = NDArray[np.float64]

# Twice the log-likelihood ratio that decides: 150 to 1.
DECISIVE = 10.0
# The search starts at the measured geometry, so few starts are needed.
STARTS = 3


class FurtherMeasurement(NamedTuple):
    """A measurement that could be made: words and the quantities with their relative standard deviations."""

    words: str
    quantities: Mapping[str, float]


CANDIDATES = (
    FurtherMeasurement("Ro-Rb by a ruler or the picture's circle", {"Ro-Rb": 0.006}),
    FurtherMeasurement("the ball's mass and diameter (mb, Ib)", {"mb": 0.005, "Ib": 0.01}),
    FurtherMeasurement("the ball's mass and diameter and Ro-Rb", {"mb": 0.005, "Ib": 0.01, "Ro-Rb": 0.006}),
    FurtherMeasurement("Ih from a hoop-only experiment", {"Ih": 0.005}),
    FurtherMeasurement("the ball's spin for each turn of psi with the hoop held", {"spin": 0.01}),
    FurtherMeasurement("Ro/Rb", {"Ro/Rb": 0.02}),
    FurtherMeasurement("Ro/Rb and Ro-Rb", {"Ro/Rb": 0.02, "Ro-Rb": 0.006}),
    FurtherMeasurement("Ro/Rb and Ih from a hoop-only experiment", {"Ro/Rb": 0.02, "Ih": 0.005}),
    FurtherMeasurement("Ro/Rb and the ball's mass", {"Ro/Rb": 0.02, "mb": 0.005}),
    FurtherMeasurement("Ro/Rb and the ball's mass and diameter (mb, Ib)", {"Ro/Rb": 0.02, "mb": 0.005, "Ib": 0.01}),
    FurtherMeasurement(
        "Ro/Rb, Ro-Rb and the ball's mass and diameter", {"Ro/Rb": 0.02, "Ro-Rb": 0.006, "mb": 0.005, "Ib": 0.01}
    ),
    FurtherMeasurement("Ro/Rb and the ball's spin", {"Ro/Rb": 0.02, "spin": 0.01}),
)


class Predicted(NamedTuple):
    """A figure under both kinematics with the same parameters, and how well the recordings know it."""

    rolling: float
    published: float
    measured: float
    standard_error: float

    @property
    def difference_in_errors(self) -> float:
        """|rolling - published| in standard errors."""
        return abs(self.rolling - self.published) / self.standard_error


def minimum_chi2(
    kind: str, e: Mapping[str, float], c: Array, start: Mapping[str, float], known: Sequence[Known]
) -> float:
    return physical_from_entries(kind, e, start, covariance=c, known=known, starts=STARTS).chi2


def separating(
    covariance: Array, truth: Mapping[str, float], candidates: Sequence[FurtherMeasurement] = CANDIDATES
) -> dict[str, float]:
    """Expected evidence for rolling if `truth` rolls and a candidate is measured, with entries known this well."""
    e = entries_of("rolling", truth)
    out = {}
    for one in candidates:
        known = [Known(name, quantity("rolling", name, truth), sd) for name, sd in one.quantities.items()]
        out[one.words] = minimum_chi2("published", e, covariance, truth, known)
    return out


def predicted_figures(e: Mapping[str, float], c: Array, p: Mapping[str, float]) -> dict[str, Predicted]:
    """L2/L1 and K2 of the same parameters under both kinematics, against the fitted ones."""
    by = {kind: entries_of(kind, p) for kind in KINEMATICS}
    l1, l2, k2 = (ENTRIES.index(name) for name in ("L1", "L2", "K2"))
    ratio = e["L2"] / e["L1"]
    # var(L2/L1) = r^2 (var L2/L2^2 + var L1/L1^2 - 2 cov/(L1 L2))
    relative = c[l2, l2] / e["L2"] ** 2 + c[l1, l1] / e["L1"] ** 2 - 2 * c[l1, l2] / (e["L1"] * e["L2"])
    r, q = by["rolling"], by["published"]
    return {
        "L2/L1": Predicted(r["L2"] / r["L1"], q["L2"] / q["L1"], ratio, abs(ratio) * float(np.sqrt(relative))),
        "K2": Predicted(r["K2"], q["K2"], e["K2"], float(np.sqrt(c[k2, k2]))),
    }


def predicted_words(name: str, one: Predicted) -> str:
    return (
        f"{name} with the same parameters: rolling {one.rolling:.4g}, published {one.published:.4g}, "
        f"fitted {one.measured:.4g} +-{one.standard_error:.2g}; the kinematics differ by "
        f"{one.difference_in_errors:.1f} standard errors."
    )


def separating_words(expected: Mapping[str, float]) -> str:
    enough = {name: value for name, value in expected.items() if value > DECISIVE}
    if not enough:
        name, value = max(expected.items(), key=lambda item: item[1])
        return f"No single measurement would decide with these recordings; the best is {name} (evidence {value:.1f})."
    first = [f"{name} ({value:.0f})" for name, value in enough.items()]
    return (
        f"Measuring would separate them (expected evidence): {'; '.join(first)}. Ro/Rb must be among it: without, "
        "nothing else separates them, however exactly it is measured."
    )
