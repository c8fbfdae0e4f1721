"""Who watches an alternating run of a daemon: its ticks and events go to a comparison, what that wants to the daemon.

Rules of this file: one thread that only looks and one that only asks, so that a file that is being loaded holds up no
tick; a run that nobody attends, or whose daemon is silent, is over: the trial then goes back by itself.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from math import isfinite, nan
from typing import Any, Protocol

from hoopd.core.modes import Mode
from hoopd.core.succession import ALIVE
from hoopd.dashboard.device import Seen, ShownDevice
from hoopd.design.comparison import WantedCommand
from hoopd.design.yardstick import TickSample
from hoopd.shell.operator import CommandError

LOOK_S = 0.04
ROWS = 250  # five seconds
SILENCE_S = 3.0
END_S = 5.0  # for the last orders
LAST_S = 20.0  # and for a candidate that is still being loaded
CHANNELS = ("u", "dtheta", "psi", "psi_t", "reference")

# The daemon's answer to an order; CommandError when it refuses or none answers.
Send = Callable[[WantedCommand], Mapping[str, Any]]


class SupervisedRun(Protocol):
    """What looks at every tick of a daemon and says what it is to be told."""

    @property
    def over(self) -> bool:
        """Nothing more is wanted but the last orders."""
        ...

    @property
    def settled(self) -> bool:
        """The last orders were given."""
        ...

    def put(self, sample: TickSample) -> tuple[WantedCommand, ...]:
        """One tick; what is to be commanded now."""
        ...

    def note(self, event: str, fields: Mapping[str, Any]) -> None:
        """One fact that the daemon tells."""
        ...

    def refuse(self, order: WantedCommand, reason: str) -> None:
        """An order was not obeyed."""
        ...

    def stop(self, reason: str) -> None:
        """End it from outside."""
        ...


class ComparisonSupervisor:
    """One supervised run of a device, from its start to its end."""

    def __init__(
        self,
        comparison: SupervisedRun,
        device: ShownDevice,
        send: Send,
        attended: Callable[[], str] = lambda: "",
    ) -> None:
        """`attended`: why the run has to end, because nobody watches it any more; empty while somebody does."""
        self.comparison = comparison
        self.error: Exception | None = None  # what ended it early: for whoever waits
        self._device, self._send, self._attended = device, send, attended
        self._seen = Seen(row=device.history.count)
        device.news(self._seen, 0)  # what was before is no news
        self._run, self._heard = device.run, time.monotonic()
        self._names: list[str] = device.history.names
        self._orders: queue.Queue[WantedCommand | None] = queue.Queue()
        self._refused: queue.SimpleQueue[tuple[WantedCommand, str]] = queue.SimpleQueue()
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._look, self._ask)]

    def start(self) -> None:
        """Begin; returns at once."""
        for thread in self._threads:
            thread.start()

    @property
    def alive(self) -> bool:
        """It goes on, or brings the accepted law back."""
        return any(thread.is_alive() for thread in self._threads)

    def join(self, timeout_s: float | None = None) -> None:
        """Wait for its end."""
        for thread in self._threads:
            thread.join(timeout_s)

    def _look(self) -> None:
        try:
            self._follow()
        except Exception as error:  # whatever is on trial goes back: nobody says any more that it is watched
            self.error = error
        finally:
            self._orders.put(None)

    def _follow(self) -> None:
        end = None
        while end is None or time.monotonic() < end:
            if why := self._wrong():
                self.comparison.stop(why)
                if self._is_gone:
                    break
            while not self._refused.empty():
                self.comparison.refuse(*self._refused.get())
            for order in self._news():
                self._orders.put(order)
            if self.comparison.settled:
                break
            if self.comparison.over and end is None:
                end = time.monotonic() + LAST_S
            time.sleep(LOOK_S)

    def _ask(self) -> None:
        end = None
        while (order := self._orders.get()) is not None:
            if self.comparison.over:
                end = end or time.monotonic() + END_S
                if order.name == ALIVE or time.monotonic() > end:
                    continue
            try:
                self._send(order)
            except CommandError as error:
                self._refused.put((order, str(error)))
            except Exception as error:  # of a connection that went meanwhile
                self._refused.put((order, f"{order.name}: no answer ({type(error).__name__})"))

    @property
    def _is_gone(self) -> bool:
        """Nobody is there whom an order could reach."""
        return self._device.run != self._run or time.monotonic() - self._heard > SILENCE_S

    def _wrong(self) -> str:
        if self._device.run != self._run:
            return "the daemon was started again"
        if self._is_gone:
            return f"the daemon was silent for {SILENCE_S:g} s"
        return self._attended()

    def _news(self) -> Iterator[WantedCommand]:
        """What the comparison wants after what came since the last look, in the order of run time."""
        news = self._device.news(self._seen, ROWS)
        self._names = news.get("names", self._names)
        modes = news.get("words", {}).get("mode", [])
        rows = [dict(zip(self._names, row, strict=False)) for row in news.get("rows", [])]
        if rows:
            self._heard = time.monotonic()
        events = [one for one in news.get("events", []) if isinstance(one.get("fields"), dict)]
        times = [(_number(row.get("t")), 0, row) for row in rows]
        times += [(_number(one.get("t")), 1, one) for one in events]
        for _, kind, one in sorted(times, key=lambda entry: entry[:2]):
            if kind:
                self.comparison.note(str(one.get("event")), one["fields"])
            else:
                yield from self.comparison.put(sample_of(one, modes))


def sample_of(row: Mapping[str, float], modes: list[str]) -> TickSample:
    """A row of a device's history as a sample; `modes`: texts of its channel `mode`."""
    mode = _number(row.get("mode"))
    running = isfinite(mode) and int(mode) < len(modes) and modes[int(mode)] == Mode.RUNNING
    return TickSample(_number(row.get("t")), running, *(_number(row.get(name)) for name in CHANNELS))


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else nan
