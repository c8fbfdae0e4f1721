"""The rule of disarm, stop and shutdown, as a judge of its own: commands and modes of one tick after the other.

Rules of this file: it shares no code with the daemon and knows nothing of how a tick decides; what is wrong is told in
words, one line each, and nothing is said while all is well.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

OFF = ("DISARMED", "FAULT")
ON = ("READY", "RUNNING", "STOPPING")
REVOKING = ("disarm", "stop", "shutdown")
PATIENCE_TICKS = 10  # an arm may wait so long for what the board has latched
STOPPING_TICKS = 50 + 2  # a second, and the ticks at its ends


@dataclass
class Referee:
    """Follows one run from its first tick on."""

    mode: str = "DISARMED"
    tick: int = 0
    wrong: list[str] = field(default_factory=list)
    _armed_at: int | None = None  # the arm that may still energise
    _ended: bool = False
    _stopping: int = 0

    def look(self, commands: Collection[str], mode: str, torque_nm: float = 0.0, enabled: bool | None = None) -> None:
        """Judge one tick: its commands in any order, its mode at the end, and what it asked of the board."""
        before, self.mode, self.tick = self.mode, mode, self.tick + 1
        self._switched_off(commands, before)
        self._switched_on(commands, before)
        self._stopping = self._stopping + 1 if mode == "STOPPING" else 0
        self._demand(self._stopping <= STOPPING_TICKS, "brakes for ever")
        self._demand(torque_nm == 0.0 or mode in ("RUNNING", "STOPPING"), f"{torque_nm} N m in {mode}")
        self._demand(enabled is None or enabled == (mode in ON), f"enable is {enabled} in {mode}")

    def _switched_off(self, commands: Collection[str], before: str) -> None:
        if "disarm" in commands:
            self._demand(self.mode in OFF, f"a disarm in {before} ends its tick in {self.mode}")
        if "stop" in commands or "shutdown" in commands:
            allowed = (*OFF, "STOPPING") if before in ("RUNNING", "STOPPING") else OFF
            self._demand(self.mode in allowed, f"a stop in {before} ends its tick in {self.mode}")

    def _switched_on(self, commands: Collection[str], before: str) -> None:
        """An arm is good for a tick, or a short wait, that nobody revoked; it is used up by what it energises."""
        self._ended = self._ended or "shutdown" in commands
        if before in ON or self._ended or any(name in REVOKING for name in commands):
            self._armed_at = None
        elif "arm" in commands:
            self._armed_at = self.tick
        elif "clear" in commands:
            self._armed_at = None
        if before not in ON and self.mode in ON:
            waited = None if self._armed_at is None else self.tick - self._armed_at
            self._demand(waited is not None, f"{before} became {self.mode} without an arm")
            self._demand(waited is None or waited <= PATIENCE_TICKS, f"{self.mode} {waited} ticks after its arm")
            self._demand(self.mode == "READY", f"{before} became {self.mode} at once")

    def _demand(self, fine: bool, what: str) -> None:
        if not fine:
            self.wrong.append(f"tick {self.tick}: {what}")
