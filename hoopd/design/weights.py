"""What deviations cost: the weights of the quadratic design, which a comparison of two laws is judged by, too.

Rules of this file: numbers alone; nothing heavy is imported, so that what runs beside a daemon may use them.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Weights:
    """Deviations that cost the same (Bryson's rule): each squared is one unit of cost a tick.

    The default is from a search over 81 combinations (`tools/bench/lqg.py --search`): all settle in time; this one
    has, with psi three ticks old, more than 60 degrees and 90 ms to spare, the third of the torque noise of the
    stiffest, and keeps the hoop below 0.5 rad/s under one degree of zero-angle error.
    """

    dtheta_rad_s: float = 6.0
    psi_rad: float = 0.2
    dpsi_rad_s: float = 1.2
    torque_nm: float = 0.05
