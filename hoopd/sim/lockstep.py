"""The rig in virtual time: board, wire and camera driven by one queue of events, as fast as the machine can.

Rules of this file: no clock, no thread, no process; the same seed and configuration give the same bytes; the order
of events is their time, then the order in which they were made.
"""

from __future__ import annotations

import asyncio
import heapq
from collections import deque
from collections.abc import Callable
from typing import Protocol

from hoopd.core.records import CameraSample, DriverSample, LinkCounts, TorqueCommand
from hoopd.sim import lies
from hoopd.sim.faults import FaultScript
from hoopd.sim.watchers import Watcher
from hoopd.sim.wiredboard import WiredBoard

# Ticks whose true state is remembered: half a second.
REMEMBERED = 25
# Ticks between two looks at signals; virtual time never really sleeps.
YIELD_EVERY = 50


class HostCodec(Protocol):
    """The host's side of the line (`hoopd.shell.link.Codec`)."""

    def feed(self, t: float, data: bytes) -> None: ...

    def request(self, t: float, command: TorqueCommand) -> bytes: ...

    def take(self, t: float, *, lost: bool) -> tuple[DriverSample | None, LinkCounts]: ...


class TruthSink(Protocol):
    """Takes the plant's true state (`hoopd.sim.truth`)."""

    def __call__(self, t: float, state: tuple[float, float, float, float], distance: float, /) -> None: ...


class MovedPlant(Protocol):
    """What the rig looks at (`hoopd.sim.plant`); states in rad and rad/s."""

    @property
    def state(self) -> tuple[float, float, float, float]: ...

    @property
    def distance(self) -> float: ...

    @property
    def shown(self) -> tuple[float, float, float, float]: ...

    @property
    def shown_distance(self) -> float: ...


class LockstepRig:
    """Clock, drive and camera of a loop that runs in virtual time."""

    def __init__(
        self,
        plant: MovedPlant,
        board: WiredBoard,
        codec: HostCodec,
        watcher: Watcher,
        script: FaultScript,
        *,
        period_s: float,
        frame_s: float,
        phase_s: float,
        delay_s: float,
        truth: TruthSink | None = None,
    ) -> None:
        """`truth` gets the plant's state at every tick."""
        self._truth = truth
        self._plant, self._board, self._codec, self._watcher = plant, board, codec, watcher
        self._script, self._period_s, self._delay_s = script, period_s, delay_s
        self._frame_s, self._phase_s = frame_s, phase_s
        self._now = 0.0
        self._psi: deque[tuple[float, float]] = deque(maxlen=REMEMBERED)  # time, true angle
        self._ticks = self._frames = self._made = 0
        self._events: list[tuple[float, int, Callable[[float], None]]] = []
        self._sample: CameraSample | None = None
        self._last_picture_t = 0.0
        self._past = lies.Past()
        self._at(phase_s, self._expose)

    # --- the loop's timer ---

    async def wait(self) -> int:
        """Advance to the next deadline."""
        self._ticks += 1
        self._run_until(self._ticks * self._period_s)
        state = self._plant.state
        self._psi.append((self._now, state[2]))
        if self._truth is not None:
            self._truth(self._now, state, self._plant.distance)
        if self._ticks % YIELD_EVERY == 0:
            await asyncio.sleep(0)
        return 1

    def open(self) -> None:
        """Nothing to open."""

    def now(self) -> float:
        """Virtual run time in s."""
        return self._now

    def close(self) -> None:
        """Nothing to free."""

    def true_psi(self, t: float) -> float | None:
        """The plant's ball angle in rad at the tick at `t`; None when that is too long ago."""
        return next((psi for at, psi in reversed(self._psi) if abs(at - t) < 0.5 * self._period_s), None)

    # --- the loop's drive ---

    def take(self) -> tuple[DriverSample | None, LinkCounts]:
        """Newest answer and what else came since the last tick."""
        return self._codec.take(self._now, lost=False)

    def write(self, command: TorqueCommand) -> None:
        """Put one request on the wire."""
        self._board.write(self._now, self._codec.request(self._now, command))

    # --- the loop's camera ---

    def take_sample(self) -> CameraSample | None:
        """Newest sample since the last tick."""
        sample, self._sample = self._sample, None
        return sample

    def picture_age(self) -> float:
        """Seconds since a picture arrived."""
        return self._now - self._last_picture_t

    def finish(self, t: float) -> None:
        """Let the rig go on without the host, for what is still on the wire and for the board's time-out."""
        self._run_until(self._now + t)

    # --- events ---

    def _at(self, t: float, what: Callable[[float], None]) -> None:
        self._made += 1
        heapq.heappush(self._events, (t, self._made, what))

    def _run_until(self, t: float) -> None:
        while self._events and self._events[0][0] <= t:
            self._now, _, what = heapq.heappop(self._events)
            what(self._now)
        self._now = t
        self._board.advance(t)
        for arrival, data in self._board.arrived(t):
            self._codec.feed(arrival, data)

    def _expose(self, now: float) -> None:
        self._frames += 1
        self._at(self._frames * self._frame_s + self._phase_s, self._expose)
        self._board.advance(now)
        self._past.add(now, self._plant.shown)
        distance = self._plant.shown_distance
        if self._script.active(now, "camera_stall"):
            return
        shown = self._past.at(now - lies.age_s(self._script, now))
        sample = self._watcher.see(self._frames, now, shown, distance)
        late = self._script.active(now, "late_pictures")
        delay = self._delay_s + (float(late["delay_s"]) if late else 0.0)
        self._at(now + delay, lambda at: self._deliver(at, sample))

    def _deliver(self, now: float, sample: CameraSample) -> None:
        self._sample = sample._replace(t_arrival=now)
        self._last_picture_t = now


class LockstepEye:
    """The camera side of a lock-step rig."""

    def __init__(self, rig: LockstepRig, stall_s: float) -> None:
        self._rig, self._stall_s = rig, stall_s

    def take(self) -> CameraSample | None:
        """Newest sample since the last tick."""
        return self._rig.take_sample()

    @property
    def stalled(self) -> bool:
        """No picture for longer than the back end tolerates."""
        return self._rig.picture_age() > self._stall_s
