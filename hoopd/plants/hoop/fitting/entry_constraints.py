"""Whether eight entries can come from physical parameters at all: the two constraints, their errors, in words.

Rules of this file: it judges numbers that others printed or fitted; the constraints are those of `entries`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.hoop.entries import ENTRIES, combinations_from, constraint_misfit, entries_of
from hoopd.plants.hoop.fitting.physical_parameters import LARGE_RELATIVE, entry_weight

Array = NDArray[np.float64]

# Standard errors beyond which fitted entries break a constraint.
BROKEN = 3.0


def reproduces(kinematics: str, parameters: Mapping[str, float], entries: Mapping[str, float]) -> list[str]:
    """Sentences on whether published parameters give published entries."""
    found = entries_of(kinematics, parameters)
    wrong = [n for n in ENTRIES if abs(found[n] - entries[n]) > LARGE_RELATIVE * entry_weight(n, entries)]
    if not wrong:
        return [f"The parameters give the entries through the {kinematics} kinematics."]
    pairs = ", ".join(f"{name} {found[name]:.3g} instead of {entries[name]:.3g}" for name in wrong)
    return [
        f"The parameters do not reproduce the entries through the {kinematics} kinematics: {pairs}.",
        *constraint_words(entries),
    ]


def constraint_sd(entries: Mapping[str, float], covariance: Array) -> dict[str, float]:
    """Standard deviations of the two misfits for a covariance (8, 8) of `ENTRIES`, first order."""
    columns = []
    for name in ENTRIES:
        # all misfits are smooth on the scale of an entry
        step = 1e-5 * max(abs(entries[name]), 1e-6)
        up, down = (constraint_misfit({**entries, name: entries[name] + sign * step}) for sign in (1, -1))
        columns.append([(up[one] - down[one]) / (2 * step) for one in up])
    slope = np.array(columns).T
    variance = np.diag(slope @ covariance @ slope.T)
    return {name: math.sqrt(max(float(v), 0.0)) for name, v in zip(constraint_misfit(entries), variance, strict=True)}


def constraint_words(entries: Mapping[str, float], covariance: Array | None = None) -> list[str]:
    """Whether any parameters can give the entries, under either kinematics."""
    misfit = constraint_misfit(entries)
    if covariance is not None:
        return _uncertain_constraints(entries, misfit, constraint_sd(entries, covariance))
    large = {n: m for n, m in misfit.items() if abs(m) > LARGE_RELATIVE * entry_weight(n, entries)}
    words = []
    if large:
        pairs = " and ".join(f"{n} would be {entries[n] - m:.3f} instead of {entries[n]:.3f}" for n, m in large.items())
        words.append(f"No parameters under either kinematics give these entries: from the other six, {pairs}.")
    positive = {n: v for n, v in combinations_from(entries).items() if n != "M12"}
    negative = [f"{name} = {value:.3g}" for name, value in positive.items() if value < 0]
    if negative:
        words.append(f"They demand a negative {', '.join(negative)}.")
    return words


def _uncertain_constraints(
    entries: Mapping[str, float], misfit: Mapping[str, float], sd: Mapping[str, float]
) -> list[str]:
    pairs = " and ".join(
        f"{n} {entries[n]:.3f} (the other six demand {entries[n] - m:.3f} +-{sd[n]:.2g})" for n, m in misfit.items()
    )
    if all(abs(m) <= BROKEN * sd[n] for n, m in misfit.items()):
        return [f"Within their errors the entries keep the two constraints of any parameters: {pairs}."]
    return [f"No parameters under either kinematics give these entries: {pairs}; a force is missing from the model."]
