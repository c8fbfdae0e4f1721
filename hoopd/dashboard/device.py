"""One device as the page knows it: its rows, its newest status, its latest events, and whether it is there.

Rules of this file: a connection's thread fills it and the server reads it, so that every call takes the lock; a message
that is not understood is counted and changes nothing.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import msgspec

from hoopd.core.modes import Mode, mode_words
from hoopd.dashboard.history import WORD_CHARACTERS, History, Numbers

EVENTS = 200  # kept: what happened in the last minutes of a bad day
FAULTS = 8  # that are named behind a mode
MESSAGE_BYTES = 65536  # more than a daemon of ours would send
STEP_S = 2.0  # a run time that disagrees with the wall clock by more: a clock that was set, and no burst


@dataclass
class Seen:
    """How far one reader has come."""

    row: int = 0
    event: int = 0
    version: int = -1
    channels: int = 0


class ModeCauses(NamedTuple):
    """Faults that led to a mode, by the newest message that told of them: the event of the change, or a status."""

    mode: str = ""  # empty when nothing told it
    names: Sequence[str] = ()


@dataclass
class ShownDevice:
    """What is known of one device."""

    name: str  # as in its keys
    endpoint: str  # of the daemon that told of it
    alive: bool = False
    run: str = ""  # name of the run, which a restart changes
    runs: int = 0  # that were seen
    bad: int = 0  # messages that were not understood
    status: Mapping[str, Any] = field(default_factory=dict)
    heard_s: float = 0.0  # wall clock of the newest message
    history: History = field(default_factory=History)

    def __post_init__(self) -> None:
        """Nothing has come yet."""
        self._lock = threading.Lock()
        self._offset_s: float | None = None
        self._newest_s = 0.0
        self._events: deque[tuple[int, dict[str, Any]]] = deque(maxlen=EVENTS)
        self._event_count = 0
        self._version = 0
        self._causes = ModeCauses()

    @property
    def identity(self) -> str:
        """What tells it from every other on the page."""
        return f"{self.name}@{self.endpoint}"

    @property
    def mode(self) -> str:
        """Of its newest tick; empty when none has come."""
        with self._lock:
            return self.history.word("mode")

    @property
    def mode_words(self) -> str:
        """Its mode with the faults behind it, as a refusal names it."""
        with self._lock:
            mode, causes = self.history.word("mode"), self._causes
        named = causes.names if causes.mode in ("", mode) else ()
        return mode_words(mode or "unknown", named)

    def presence(self, alive: bool) -> None:
        """Its session is there, or gone."""
        with self._lock:
            if alive != self.alive:
                self.alive, self._version = alive, self._version + 1

    def take(self, kind: str, payload: bytes, run: str, now_s: float | None = None) -> None:
        """One message, `tick`, `event` or `status`; `now_s` is the wall clock."""
        now = time.time() if now_s is None else now_s
        message = _decoded(payload)
        with self._lock:
            if message is None:
                self.bad += 1
                return
            self._follow(run)
            self.heard_s = now
            if kind == "tick":
                self.history.append(self._wall(now, message.get("t")), message)
            elif kind == "status":
                self.status, self._version = message, self._version + 1
                self._led(message)
            elif kind == "event":
                self._event_count += 1
                self._events.append((self._event_count, {**message, "wall": now}))
                self._changed(message)

    def news(self, seen: Seen, at_most: int) -> dict[str, Any]:
        """What a reader has not seen yet, and note that it has now; empty when there is nothing."""
        with self._lock:
            told: dict[str, Any] = {}
            if seen.version != self._version:
                told["state"], seen.version = self._state(), self._version
            names = self.history.names
            if seen.channels != len(names):
                told["names"], seen.channels = names, len(names)
            if seen.row < self.history.count:
                told["first"], told["rows"] = self.history.since(seen.row, at_most)
                told["words"] = self.history.words
                seen.row = self.history.count
            events = [event for number, event in self._events if number > seen.event]
            if events:
                told["events"], seen.event = events, self._event_count
            return told

    def events_since(self, wall_s: float) -> list[dict[str, Any]]:
        """What happened from a moment on, oldest first."""
        with self._lock:
            return [event for _, event in self._events if event["wall"] >= wall_s]

    def columns(self, names: Sequence[str]) -> dict[str, Numbers]:
        """Numbers of these channels, oldest first; NaN where one was never told."""
        with self._lock:
            return self.history.columns(names)

    def packed(self) -> bytes:
        """Its history for a browser."""
        with self._lock:
            return self.history.packed()

    def _state(self) -> dict[str, Any]:
        fields = {"name": self.name, "endpoint": self.endpoint, "alive": self.alive, "run": self.run}
        return {**fields, "runs": self.runs, "status": self.status, "because": self._causes._asdict()}

    def _changed(self, message: Mapping[str, Any]) -> None:
        """Another mode, as soon as its event tells it: a status comes once a second."""
        fields = message.get("fields")
        if message.get("event") == "mode" and isinstance(fields, dict):
            self._led(fields, self._causes.names if fields.get("was") == Mode.STOPPING else ())
            self._version += 1

    def _led(self, told: Mapping[str, Any], before: Sequence[str] = ()) -> None:
        """Faults that led to a mode, after those of the stop that came before it; who names no mode means the last."""
        if "because" in told:
            names = [*dict.fromkeys((*before, *fault_names(told["because"])))]
            self._causes = ModeCauses(str(told.get("mode") or self._causes.mode), names[:FAULTS])

    def _follow(self, run: str) -> None:
        """Another run than before: its times begin anew."""
        if run != self.run or not self.runs:
            self.run, self.runs, self._offset_s = run, self.runs + 1, None
            self.status, self._causes, self._version = {}, ModeCauses(), self._version + 1

    def _wall(self, now_s: float, t: Any) -> float:
        """The wall clock of a row, by its own run time, so that what comes in a burst is not drawn as one."""
        if not isinstance(t, int | float):
            return now_s
        if self._offset_s is None or abs(now_s - t - self._offset_s) > STEP_S:
            self._offset_s = now_s - t
        self._newest_s = max(self._newest_s, t + self._offset_s)  # a clock that is set back draws no line backwards
        return self._newest_s


def fault_names(told: Any) -> list[str]:
    """Names that a device told, as far as they are some."""
    return [str(name)[:WORD_CHARACTERS] for name in told[:FAULTS]] if isinstance(told, list) else []


def _decoded(payload: bytes) -> dict[str, Any] | None:
    if len(payload) > MESSAGE_BYTES:
        return None
    try:
        message = msgspec.json.decode(payload)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
    return message if isinstance(message, dict) else None
