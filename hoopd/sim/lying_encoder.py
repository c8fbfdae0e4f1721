"""An encoder that lies: the hoop turns as it does, the answers tell another motion of it.

Rules of this file: a lie begins at the value of the last answer that told the truth, so that none begins with a jump of
the angle; the truth is followed over the wrap of the board's count; nothing here knows bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, Protocol

from hoopd.core.frames import THETA_WRAP_RAD


class Report(NamedTuple):
    """What an encoder says; `t` in s, theta in rad without the wrap."""

    t: float
    theta: float
    dtheta: float


class Lie(Protocol):
    """A fault of the script that is active: its numbers by name."""

    def __getitem__(self, name: str, /) -> Any: ...


def frozen(lie: Lie, start: Report, true: Report) -> Report:
    """The angle is held, the speed is zero."""
    return Report(true.t, start.theta, 0.0)


def coasting(lie: Lie, start: Report, true: Report) -> Report:
    """The speed is held, the angle goes on with it."""
    return Report(true.t, start.theta + start.dtheta * (true.t - start.t), start.dtheta)


def scaled(lie: Lie, start: Report, true: Report) -> Report:
    """What the hoop turns from the beginning on, and its speed, are multiplied."""
    factor = float(lie["factor"])
    return Report(true.t, start.theta + factor * (true.theta - start.theta), factor * true.dtheta)


LIES: Final[Mapping[str, Callable[[Lie, Report, Report], Report]]] = {
    "encoder_frozen": frozen,
    "encoder_coasts": coasting,
    "encoder_scale": scaled,
}


class LyingEncoder:
    """Turns true answers into those of the script's encoder faults, in the order of `LIES`."""

    def __init__(self, active: Callable[[float, str], Lie | None]) -> None:
        """`active`: the fault of a kind that holds at a run time (`FaultScript.active`)."""
        self._active = active
        self._true: Report | None = None
        self._starts: dict[str, Report] = {}

    def report(self, t: float, theta: float, dtheta: float) -> tuple[float, float]:
        """Angle (wrapped) and speed that the answer at `t` carries when these are true."""
        before = self._true or Report(t, theta, dtheta)
        # theta without the wrap: the turn count nearest to the last one
        turned = (theta - before.theta + THETA_WRAP_RAD) % (2 * THETA_WRAP_RAD) - THETA_WRAP_RAD
        told = true = Report(t, before.theta + turned, dtheta)
        self._true = true
        for kind, tell in LIES.items():
            lie = self._active(t, kind)
            if lie is None:
                self._starts.pop(kind, None)
            else:
                told = tell(lie, self._starts.setdefault(kind, before), told)
        if told is true:
            return theta, dtheta
        return (told.theta + THETA_WRAP_RAD) % (2 * THETA_WRAP_RAD) - THETA_WRAP_RAD, told.dtheta
