"""What the board does to a demanded torque by its own contract, as the configuration of a recording tells it.

Rules of this file: a recording in, numbers out; what no configuration tells limits nothing.
"""

from __future__ import annotations

import re
from math import inf

from hoopd.recording.recording import Recording

# Of the board's section (docs/reference/board.md); every configuration is written by the daemon, a key a line.
_SLEW = re.compile(r"^ +slew_nm_per_ms: ([0-9.e+-]+)$", re.MULTILINE)


def torque_slew(recording: Recording) -> float:
    """How fast the board lets the torque change, N m/s; infinite where no board is told of."""
    found = _SLEW.search(recording.config)
    return 1e3 * float(found[1]) if found else inf
