"""What operators ask for: the commands of one tick, and the arm or clear that waits for the board, as events.

Rules of this file: a command of `REVOKING` takes back every arm and clear, whether it waits or came in the same tick,
before or after, and every change of the controller that came in the same tick; no order and no number of operators
changes that. Each refusal is one note with command and reason.
"""

from __future__ import annotations

from math import isfinite
from typing import Any, Protocol

from hoopd.core.health import Health
from hoopd.core.modes import ENERGISED, REVOKING, Event, Mode
from hoopd.core.records import Command
from hoopd.core.succession import NAMES as CHANGES
from hoopd.core.succession import Succession

# What the board itself has latched goes only by a clearing request, so that an arm may wait this long for it.
WISH_TICKS = 10
BOARD_LATCHES = frozenset({"board_fault", "board_timeout", "board_reset"})
# From here on only what switches off is obeyed.
SHUTDOWN = "shutdown"
ENDING = "the daemon is ending"
FOLLOWED = "followed by "  # arm or clear: the one that counts, because it came later


class Tell(Protocol):
    """Takes one fact worth a line in the log."""

    def __call__(self, name: str, level: str, **fields: Any) -> None: ...


class Operator:
    """Everybody who may command, as one: reference, tuning, the controller, and the wish to arm or to clear."""

    def __init__(self, health: Health, succession: Succession, reference_limit_rad: float, tell: Tell) -> None:
        self._health, self._succession, self._tell = health, succession, tell
        self._limit_rad = reference_limit_rad
        self.reference = 0.0  # rad
        self._wish, self._patience = "", 0
        self._ending = False

    @property
    def waits(self) -> bool:
        """An arm or a clear waits for what the board has latched."""
        return bool(self._wish)

    def take(self, commands: tuple[Command, ...], mode: Mode, t: float) -> frozenset[Event]:
        """What this tick's commands and the waiting one mean in this mode."""
        revoking = list(dict.fromkeys(command.name for command in commands if command.name in REVOKING))
        for command in commands:
            if command.name not in CHANGES:
                self._take(command)
            elif revoking:
                self._refuse(command.name, f"revoked by {revoking[0]}")
            else:
                self._succession.take(command, mode, t)
        if revoking:
            self._refuse_wish(f"revoked by {revoking[0]}")
            return frozenset(REVOKING[name] for name in revoking)
        event = self._acknowledged(mode)
        return frozenset() if event is None else frozenset({event})

    def _take(self, command: Command) -> None:
        if command.name in REVOKING:
            self._ending = self._ending or command.name == SHUTDOWN
            self._tell("operator", "info", command=str(REVOKING[command.name]))
        elif command.name in ("arm", "clear"):
            self._take_wish(command.name)
        elif command.name == "reference":
            self._set_reference(command.value)
        elif command.name == "tune":
            self._tune(command)
        else:
            self._refuse(command.name, "not known here")

    def _take_wish(self, name: str) -> None:
        if self._wish != name:
            self._refuse_wish(FOLLOWED + name)
        self._wish, self._patience = name, WISH_TICKS

    def _refuse_wish(self, reason: str) -> None:
        if self._wish:
            self._refuse(self._wish, reason)
        self._wish = ""

    def _refuse(self, command: str, reason: str) -> None:
        self._tell("command_refused", "warning", command=command, reason=reason)

    def _set_reference(self, value: float) -> None:
        if not isfinite(value):
            self._refuse("reference", "not a finite number")
            return
        self.reference = min(self._limit_rad, max(-self._limit_rad, value))
        self._tell("reference", "info", reference=self.reference)

    def _tune(self, command: Command) -> None:
        try:
            done = isfinite(command.value) and self._succession.tune(command.key, command.value)
        except Exception:  # a user's own law may have nothing to tune
            done = False
        if done:
            self._tell("tuned", "info", key=command.key, value=command.value)
        else:
            self._refuse("tune", f"no tunable {command.key!r}")

    def _acknowledged(self, mode: Mode) -> Event | None:
        """The wish to arm or to clear, once nothing forbids it; what the board latched is cleared meanwhile."""
        if self._wish and mode in ENERGISED:
            self._refuse_wish(f"the mode is {mode}")
        if self._wish == "arm" and self._ending:
            self._refuse_wish(ENDING)
        if not self._wish:
            return None
        arms = self._wish == "arm"
        hindrances = self._health.arming_hindrances() if arms else self._health.hindrances()
        if hindrances and self._patience > 0 and set(hindrances) <= BOARD_LATCHES:
            self._patience -= 1
            return None
        if hindrances:
            self._refuse_wish(", ".join(hindrances))
            return None
        name, self._wish = self._wish, ""
        self._health.acknowledge()
        if name == "arm":
            self._health.begin()
            if off := self._health.too_slow_for:
                self._tell("rows_off", "warning", rows="; ".join(f"{row}: {why}" for row, why in off.items()))
        self._tell("operator", "info", command=name)
        return Event(name)
