"""Which parameters of the hoop a fit moves, on which scale, and what is believed of them before any data.

Rules of this file: tables; no data here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hoopd.plants.fits.free_parameters import Prior, Scale
from hoopd.plants.hoop.parameters import PARAMETER_UNITS

# What runs of each kind can say anything about; the rest keeps its value.
ENTRIES = {
    "both": ("J11", "J12", "K1", "L1", "J21", "J22", "K2", "L2"),
    "hoop": ("J11", "L1"),
    "ball": ("J22", "K2"),
}
PHYSICAL = {
    "both": ("mb", "Ro", "Rb", "Ib", "Ih", "bb", "bh"),
    "hoop": ("Ih", "bh"),
    "ball": ("mb", "Ro", "Rb", "Ib", "bb"),
}
# Relative standard deviations of the logarithm before any data: a laboratory weighs and measures, and an inertia or
# a friction is known by its order of magnitude.
PRIOR = {"mb": 0.5, "Ro": 0.2, "Rb": 0.2, "Ib": 1.0, "Ih": 1.0, "bb": 2.0, "bh": 2.0}


def determined_names(structure: str, movings: Sequence[str], *, driven: bool = True) -> tuple[str, ...]:
    """Parameters on which runs of these kinds bear, in the structure's order; `driven`: some run has a torque."""
    table = ENTRIES if structure == "entries" else PHYSICAL
    some = {name for moving in movings for name in table[moving]}
    if not driven and structure == "entries":
        some -= {"L1", "L2"}  # what a torque does is not seen where there is none
    return tuple(name for name in PARAMETER_UNITS[structure] if name in some)


def scale_of(structure: str, names: Sequence[str], values: Mapping[str, float]) -> Scale:
    """Scale around nominal values."""
    positive = [structure != "entries" or name in ("mb", "Ro", "Rb", "g", "L1") for name in names]
    return Scale(tuple(names), np.array([values[name] for name in names], dtype=float), np.array(positive, dtype=bool))


def default_priors(structure: str, names: Sequence[str], values: Mapping[str, float]) -> dict[str, Prior]:
    """Wide beliefs for physical parameters, none for entries."""
    if structure == "entries":
        return {}
    return {name: Prior(values[name], PRIOR[name]) for name in names if name in PRIOR}
