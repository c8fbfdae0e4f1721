"""The numbers printed in the thesis (CTU in Prague, 2023), and whether they agree with each other.

Rules of this file: printed numbers only; everything said about them is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from hoopd.plants.hoop.fitting.entry_constraints import reproduces
from hoopd.plants.hoop.fitting.physical_parameters import PhysicalFit, physical_from_entries

ENTRIES_PRINTED: Mapping[str, float] = MappingProxyType(
    {
        "J11": -0.4818896328354544,
        "J12": 0.06769766279210704,
        "K1": -5.119508012862879,
        "L1": 586.3694971455833,
        "J21": -0.0032686776857956444,
        "J22": -0.33509889971201284,
        "K2": -73.63359905056758,
        "L2": 210.1200001949957,
    }
)
TABLE_3_1: Mapping[str, float] = MappingProxyType(
    {
        "mb": 0.0608,
        "Ro": 0.0957,
        "Rb": 0.0104,
        "g": 9.81,
        "Ib": 2.4963218878738077e-6,
        "Ih": 1.5000089046344925e-3,
        "bb": 2.5737738382893808e-6,
        "bh": 7.499999947648515e-3,
    }
)


def table_words() -> list[str]:
    """Table 3.1 of the thesis against its entries, through its own kinematics."""
    return [f"Table 3.1 of the thesis: {words}" for words in reproduces("published", TABLE_3_1, ENTRIES_PRINTED)]


def second_step(kinematics: str = "published", fixed: tuple[str, ...] = ("mb", "Ro", "Rb")) -> PhysicalFit:
    """The thesis's second step done to the end: its entries to positive parameters, weighed and measured ones held."""
    return physical_from_entries(kinematics, ENTRIES_PRINTED, TABLE_3_1, fixed=fixed)
