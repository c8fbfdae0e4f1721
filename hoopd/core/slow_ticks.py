"""Rows of the fault table that cannot judge at a slow tick, and why.

The checks of encoder and pictures compare neighbouring samples, and begin anew after a gap. At a tick as long as such a
gap they begin anew for ever; at a tick that gives a window too few samples the window is never judged.

Rules of this file: constants of the checks in, names out.
"""

from __future__ import annotations

from hoopd.core import encoderchecks, picturechecks
from hoopd.core.ballresponse import FEWEST_SAMPLES, WINDOW_S

# Ticks and answers come a little late or early: a tick of so much of a gap is told as one.
OF_A_GAP = 0.9
# Row -> the longest tick at which it judges, s.
LONGEST_TICK_S = {
    **dict.fromkeys(
        ("speed_implausible", "hoop_innovation", "torque_without_motion"), OF_A_GAP * encoderchecks.LONGEST_GAP_S
    ),
    "angle_stuck": OF_A_GAP * picturechecks.LONGEST_GAP_S,
    "ball_unresponsive": WINDOW_S / FEWEST_SAMPLES,
}


def rows_off(period_s: float) -> dict[str, str]:
    """Rows that a tick of this period leaves without judgement, each with the reason."""
    return {
        name: f"loop.period_s is {period_s:g}, it judges up to {longest_s:g}"
        for name, longest_s in LONGEST_TICK_S.items()
        if period_s > longest_s
    }
