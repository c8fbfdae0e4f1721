"""Rows of the fault table that cannot judge at a slow tick or with such a camera, and why.

The checks of encoder and pictures compare neighbouring samples, and begin anew after a gap. At a tick as long as such a
gap they begin anew for ever; where ticks or pictures give a window too few samples the window is never judged. A camera
that gives more pictures than there are ticks leaves gaps, too: the noise of six pictures in a row is never seen.

Rules of this file: constants of the checks in, names out.
"""

from __future__ import annotations

from math import isfinite, nan

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
# Pictures in a row that leave time to judge six of them.
FEWEST_IN_A_ROW = 2 * len(picturechecks.ORDER)


def rows_off(period_s: float, picture_s: float = nan) -> dict[str, str]:
    """Rows that a tick of this period, s, leaves without judgement, and those that a picture every `picture_s` does,
    each with the reason; NaN: of the camera nothing is known."""
    off = {
        name: f"loop.period_s is {period_s:g}, it judges up to {longest_s:g}"
        for name, longest_s in LONGEST_TICK_S.items()
        if period_s > longest_s
    }
    if not isfinite(picture_s) or picture_s <= 0.0:
        return off
    rate = f"the camera gives {1.0 / picture_s:.0f} pictures a second"
    longest_s = LONGEST_TICK_S["ball_unresponsive"]
    if picture_s > longest_s:
        off.setdefault("ball_unresponsive", f"{rate}, it judges from {1.0 / longest_s:.0f} on")
    if period_s * (1.0 - 1.0 / FEWEST_IN_A_ROW) > picture_s:
        off["angle_noiseless"] = f"{rate}, more than there are ticks"
    return off
