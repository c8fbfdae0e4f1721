"""Columns that the daemon records in every tick: the recording's form when no other plant is named.

Rules of this file: tables of names only; what the columns mean stands in `hoopd.recording.schemas`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

# Input and channels -> unit, in the order of the record.
INPUTS: Mapping[str, str] = MappingProxyType({"u": "N m"})
CHANNELS: Mapping[str, str] = MappingProxyType({"theta": "rad", "dtheta": "rad/s", "current": "A", "psi": "rad"})
# Channel -> column of its sample times: the board samples three of them at once.
TIMES: Mapping[str, str] = MappingProxyType({"theta": "y_t", "dtheta": "y_t", "current": "y_t", "psi": "psi_t"})
BOARD_TIMES = "y_t"
UNITS: Mapping[str, str] = MappingProxyType(
    {"t": "s", **INPUTS, **CHANNELS, **dict.fromkeys(dict.fromkeys(TIMES.values()), "s")}
)
# The order of CSV and MATLAB files, as the thesis keeps them; HDF5 files may hold a fourth state.
FILE_ORDER = ("u", "theta", "dtheta", "psi")
FOURTH_STATE = "dpsi"
# Where a sensor's angle comes round: the board wraps its angle at +-512 turns.
PERIODS_RAD: Mapping[str, float] = MappingProxyType({"theta": 1024.0 * 2 * math.pi, "psi": 2 * math.pi})
