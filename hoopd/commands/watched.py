"""What a person who watches a daemon is shown of it: its newest numbers, rates, faults, and whether it is there.

Rules of this file: from messages to numbers; nothing is printed and nothing is waited for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from hoopd.dashboard.device import Seen, ShownDevice

# A tick comes every 20 ms, a status every second: what is silent for longer is not there, or not reachable.
SILENT_S: Final = 2.0
ROWS: Final = 100
NAN: Final = math.nan
OFF: Final = ("DISARMED", "FAULT")


@dataclass
class WatchedDaemon:
    """One daemon over time."""

    name: str = ""
    alive: bool = False
    run: str = ""
    runs: int = 0
    age_s: float = math.inf  # of the newest message
    numbers: dict[str, float] = field(default_factory=dict)  # newest known value of each channel
    mode: str = ""
    status: Mapping[str, Any] = field(default_factory=dict)
    pictures_per_s: float = NAN
    picture_age_s: float = NAN

    def __post_init__(self) -> None:
        """Nothing has been seen yet."""
        self._seen = Seen()
        self._names: list[str] = []
        self._counted: tuple[float, float] | None = None  # time and pictures of the status before
        self._before_s = 0.0  # what was heard up to then is of a session that is gone

    @property
    def there(self) -> bool:
        """It is alive and speaks."""
        return self.alive and self.age_s < SILENT_S

    def update(self, device: ShownDevice, now_s: float) -> None:
        """Take what is new of the device; `now_s` is the wall clock."""
        heard_s = device.heard_s  # before the news: what comes in between is of the next look
        told = device.news(self._seen, ROWS)
        if "state" in told:
            self._state(told["state"])
        if not self.alive:
            self._before_s = heard_s
        self.name, self.age_s = device.name, now_s - heard_s if heard_s > self._before_s else math.inf
        self._names = told.get("names", self._names)
        for row in told.get("rows", ()):
            self._row(dict(zip(self._names, row, strict=False)), told["words"])

    def _state(self, state: Mapping[str, Any]) -> None:
        self.alive = state["alive"]
        if state["run"] != self.run:
            self.run, self.runs, self._counted = state["run"], state["runs"], None
            self.numbers, self.pictures_per_s, self.picture_age_s = {}, NAN, NAN
        self.status = state["status"]
        self._count_pictures()

    def _row(self, row: Mapping[str, float], words: Mapping[str, list[str]]) -> None:
        self.numbers |= {name: value for name, value in row.items() if math.isfinite(value)}
        if math.isfinite(place := row.get("mode", NAN)):
            self.mode = words["mode"][int(place)]
        if math.isfinite(taken := row.get("psi_t", NAN)):
            self.picture_age_s = row.get("t", NAN) - taken

    def _count_pictures(self) -> None:
        """Pictures since the status before, over the time since then."""
        t, camera = self.status.get("t"), self.status.get("camera")
        if not isinstance(t, int | float) or not isinstance(camera, Mapping):
            return
        frames = camera.get("frames")
        if not isinstance(frames, int | float):
            return
        if self._counted is not None and t > self._counted[0]:
            self.pictures_per_s = (frames - self._counted[1]) / (t - self._counted[0])
        if self._counted is None or t > self._counted[0]:
            self._counted = (t, frames)

    def number(self, name: str) -> float:
        """The newest value of a channel, or of the status; NaN when there is none."""
        value = self.numbers.get(name, self.status.get(name))
        return float(value) if isinstance(value, int | float) else NAN

    @property
    def faults(self) -> list[tuple[str, str, str]]:
        """Of every active fault its name, what it means, and what clears it."""
        causes = self.status.get("causes")
        known = causes if isinstance(causes, Mapping) else {}
        rows = [(str(name), known.get(name)) for name in _list(self.status.get("faults"))]
        told = [(name, row if isinstance(row, Mapping) else {}) for name, row in rows]
        return [(name, str(row.get("meaning", "")), str(row.get("clears", ""))) for name, row in told]

    @property
    def arming(self) -> str:
        """Whether it can be armed, in words; empty where it is, or where the daemon does not say."""
        told = self.status.get("arming")
        if self.mode not in OFF or not isinstance(told, str):
            return ""
        return "it can be armed" if told == "possible" else f"in the way of arming: {told}"

    def deviation(self, place: int) -> float:
        """Standard deviation of an estimated state."""
        told = _list(self.status.get("deviation"))
        return float(told[place]) if place < len(told) and isinstance(told[place], int | float) else NAN

    def record(self) -> dict[str, Any]:
        """All of it for a program."""
        numbers = {name: value for name, value in self.numbers.items() if name not in ("mode", "wall")}
        fields = {"device": self.name, "alive": self.there, "run": self.run, "mode": self.mode}
        return {**fields, "numbers": numbers, "status": dict(self.status)}


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
