"""What a candidate does beside what decides: a word for each figure that got surely worse.

Rules of this file: reads a result as it was told, and judges by its intervals alone; nothing here changes a verdict.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# By its place in a result: what it is called, and its unit.
FIGURES: Mapping[str, tuple[str, str]] = {
    "ball_rms_rad": ("The ball's error", "rad rms"),
    "cost": ("The cost of the design, which charges torque and speeds,", "a tick"),
    "torque_at_rest_nm": ("The torque at rest", "N m rms"),
}
# Of what decides, in a result.
DECIDES = {"ball": "ball_rms_rad", "cost": "cost"}


def side_effects(result: Mapping[str, Any]) -> list[str]:
    """Sentences about figures that do not decide and whose interval lies above zero.

    Parameters
    ----------
    result : mapping
        Of `ControllerComparison.result`: figures with `change_percent` and `interval_percent` (%).

    Returns
    -------
    list of str
        Empty where nothing got surely worse.

    Examples
    --------
    >>> cost = {"accepted": 1.0, "candidate": 1.05, "change_percent": 5.0, "interval_percent": [2.0, 8.0]}
    >>> side_effects({"judged_by": "ball", "cost": cost})
    ['The cost of the design, which charges torque and speeds, rose: 1.05 a tick instead of 1 (+5 %, +2 to +8 %).']
    """
    told = [(key, one) for key in FIGURES if (one := result.get(key)) and key != DECIDES[result["judged_by"]]]
    return [_sentence(key, one) for key, one in told if (one["interval_percent"][0] or 0.0) > 0.0]


def _sentence(key: str, one: Mapping[str, Any]) -> str:
    (name, unit), (low, high) = FIGURES[key], one["interval_percent"]
    interval = f"{_percent(low)} to {_percent(high)} %" if high is not None else f"at least {_percent(low)} %"
    values = f"{one['candidate']:.3g} {unit} instead of {one['accepted']:.3g}"
    mean = "" if one["change_percent"] is None else f"{_percent(one['change_percent'])} %, "
    return f"{name} rose: {values} ({mean}{interval})."


def _percent(value: float) -> str:
    return f"+{value:.3g}" if value < 1000.0 else f"+{value:.0f}"
