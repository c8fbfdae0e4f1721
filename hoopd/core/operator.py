"""What operators ask for: the commands of one tick, and the arm or clear that waits for the board, as events.

Rules of this file: a command of `REVOKING` takes back every arm and clear, whether it waits or came in the same tick,
before or after, and every change of the controller that came in the same tick; no order and no number of operators
changes that. Each refusal is one note with command and reason.
"""

from __future__ import annotations

from math import isfinite
from typing import Any, Protocol

from hoopd.core.health import Health
from hoopd.core.modes import ENERGISED, REVOKING, Event, Mode, mode_words
from hoopd.core.records import Command
from hoopd.core.succession import NAMES as CHANGES, TRIAL, Succession

# What the board itself has latched goes only by a clearing request, so that an arm may wait this long for it.
WISH_TICKS = 10
BOARD_LATCHES = frozenset({"board_fault", "board_timeout", "board_reset"})
# From here on only what switches off is obeyed.
SHUTDOWN = "shutdown"
ENDING = "the daemon is ending"
ON_TRIAL = "a controller is on trial, which references judge"
NO_SPEED = "the law in force regulates the ball's angle and follows no hoop speed"
# A hand that drives the hoop says so ten times a second; when it is silent for so long, the hoop is driven no more.
HAND_S = 0.3
SPEED = "speed"
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
        self.speed = 0.0  # rad/s, of the hoop; 0: no hand drives it
        self._speed_until = 0.0  # s, run time: silence ends it then
        self._wish, self._patience = "", 0
        self._ending = False

    @property
    def waits(self) -> bool:
        """An arm or a clear waits for what the board has latched."""
        return bool(self._wish)

    def take(self, commands: tuple[Command, ...], mode: Mode, t: float) -> frozenset[Event]:
        """What this tick's commands and the waiting one mean in this mode."""
        if abs(self.speed) > 0.0 and t >= self._speed_until:
            self.speed = 0.0
            self._tell("speed_ended", "warning", reason=f"the hand was silent for {HAND_S:g} s")
        revoking = list(dict.fromkeys(command.name for command in commands if command.name in REVOKING))
        for command in commands:
            if command.name == SPEED:
                self._take_speed(command.value, mode, t)
            elif command.name == "reference":
                self._set_reference(command.value, mode)
            elif command.name not in CHANGES:
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

    def _set_reference(self, value: float, mode: Mode) -> None:
        if not isfinite(value):
            self._refuse("reference", "not a finite number")
            return
        if mode not in ENERGISED:  # an arm, whoever gives it, begins at the bottom
            self._refuse("reference", mode_words(mode, self._health.halting()))
            return
        self.reference = min(self._limit_rad, max(-self._limit_rad, value))
        self._tell("reference", "info", reference=self.reference)

    @property
    def speed_limit(self) -> float:
        """The fastest hoop, rad/s, that the acting law can be asked for; 0: it follows no speed."""
        return self._succession.speed_limit

    def release(self) -> None:
        """No hand drives the hoop any more, and none is needed."""
        self.speed = 0.0

    def _take_speed(self, value: float, mode: Mode, t: float) -> None:
        limit = self.speed_limit
        if not isfinite(value):
            self._refuse(SPEED, "not a finite number")
        elif value == 0.0:
            self._drive(0.0)
        elif mode is not Mode.RUNNING:
            self._refuse(SPEED, mode_words(mode, self._health.halting()))
        elif self._succession.purpose == TRIAL:
            self._refuse(SPEED, ON_TRIAL)
        elif limit == 0.0:
            self._refuse(SPEED, NO_SPEED)
        else:
            self._speed_until = t + HAND_S
            self._drive(min(limit, max(-limit, value)))

    def _drive(self, speed: float) -> None:
        """Beginning and end are worth a line; what lies between stands in the recorded commands."""
        level = "debug" if (abs(speed) > 0.0) == (abs(self.speed) > 0.0) else "info"
        self.speed = speed
        self._tell(SPEED, level, speed=speed)

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
            self._refuse_wish(mode_words(mode, self._health.halting()))
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
