"""The loop: at every deadline take the slots, decide, write the torque, hand the record on, sleep.

Rules of this file: one await, the sleep; the torque frame goes out before anything else is done with a tick;
whatever ends the loop, a frame with zero torque and the drive off is the last that it writes.
"""

from __future__ import annotations

import gc
from collections import deque
from collections.abc import Callable
from typing import Protocol

from hoopd.core.modes import ENERGISED, REVOKING, Mode
from hoopd.core.operator import SHUTDOWN
from hoopd.core.records import CameraSample, Command, DriverSample, Inputs, LinkCounts, TickRecord, TorqueCommand
from hoopd.core.tick import Note, Output, Tick
from hoopd.shell.statistics import RunStatistics

# Young objects that survive a tick are few; a collection after five seconds costs well below a millisecond once
# everything made at start-up is frozen.
COLLECT_EVERY = 250
# A controlled stop takes at most one second (`TickSettings.stopping_s`); then the drive is simply switched off.
STOP_PATIENCE_S = 1.5
# Frames with the drive off before the loop may end: one may be lost.
FAREWELL_TICKS = 3


class Timer(Protocol):
    """Where ticks come from."""

    async def wait(self) -> int:
        """Sleep until the next deadline; how many have passed (1 when none was missed)."""
        ...

    def now(self) -> float:
        """Run time in s."""
        ...


class Drive(Protocol):
    """The line to the driver board, as the loop sees it."""

    def open(self) -> None: ...

    def take(self) -> tuple[DriverSample | None, LinkCounts]: ...

    def write(self, command: TorqueCommand) -> None: ...


class Eye(Protocol):
    """The camera, as the loop sees it."""

    def take(self) -> CameraSample | None: ...

    @property
    def stalled(self) -> bool: ...


class Sink(Protocol):
    """Whoever wants the record of every tick: recorder, telemetry, status line."""

    def put(self, record: TickRecord, inputs: Inputs) -> None: ...

    def note(self, t: float, note: Note) -> None: ...

    @property
    def trouble(self) -> bool: ...


class Loop:
    """Runs a `Tick` against a drive and a camera."""

    def __init__(
        self,
        tick: Tick,
        timer: Timer,
        drive: Drive,
        eye: Eye,
        *,
        sinks: tuple[Sink, ...],
        troubles: tuple[Callable[[], bool], ...] = (),
        sources: tuple[Callable[[float], tuple[Command, ...]], ...] = (),
        beat: Callable[[float], None] = lambda t: None,
        auto_arm: bool = False,
        duration_s: float | None = None,
        collect: bool = True,
    ) -> None:
        self.tick, self.timer, self.drive, self.eye = tick, timer, drive, eye
        self.sinks, self.sources, self.troubles, self.beat = sinks, sources, troubles, beat
        self.statistics = RunStatistics(tick.settings.period_s)
        self.record: TickRecord | None = None
        self._own: deque[Command] = deque()
        self._auto_arm, self._duration_s, self._collect = auto_arm, duration_s, collect
        self._id = 0
        self._execution_s = 0.0
        self._stop_since: float | None = None
        self._idle_ticks = 0

    def request_stop(self) -> None:
        """End the run: a controlled stop first; asked twice, the drive goes off at once."""
        if self._stop_since is None:
            self._stop_since = self.timer.now()
            self._own.append(Command(SHUTDOWN))
        else:
            self._own.append(Command("disarm"))

    async def run(self) -> None:
        """Tick until the run ends."""
        self.drive.open()
        try:
            while not self._finished():
                self._id += await self.timer.wait()
                self._tick()
        except BaseException:
            for _ in range(FAREWELL_TICKS - 1):  # no orderly end has said it before
                self._switch_off()
            raise
        finally:
            self._switch_off()

    def _switch_off(self) -> None:
        self.drive.write(TorqueCommand(self.tick.next_seq(), False, False, 0.0))

    def _tick(self) -> None:
        inputs = self._take_inputs()
        output = self.tick.step(inputs)
        self.drive.write(output.command)
        self._execution_s = self.timer.now() - inputs.t
        self._hand_on(inputs, output)
        self.beat(inputs.t)
        self._idle_ticks = 0 if self.tick.mode in ENERGISED else self._idle_ticks + 1
        if self._collect and self._id % COLLECT_EVERY == 0:
            gc.collect()

    def _take_inputs(self) -> Inputs:
        t = self.timer.now()
        driver, link = self.drive.take()
        return Inputs(
            id=self._id,
            t=t,
            camera=self.eye.take(),
            driver=driver,
            link=link,
            commands=self._commands(t),
            lateness_s=t - self._id * self.tick.settings.period_s,
            execution_s=self._execution_s,
            camera_stalled=self.eye.stalled,
            trouble=sum(1 << bit for bit, troubled in enumerate(self.troubles) if troubled()),
        )

    def _commands(self, t: float) -> tuple[Command, ...]:
        if self._duration_s is not None and t >= self._duration_s and self._stop_since is None:
            self.request_stop()
        if self._stop_since is not None and t - self._stop_since > STOP_PATIENCE_S and not self._own:
            self._own.append(Command("disarm"))
        commands = list(self._own)
        self._own.clear()
        for source in self.sources:
            commands.extend(source(t))
        return (*self._armed_by_itself(commands), *commands)

    def _armed_by_itself(self, commands: list[Command]) -> tuple[Command, ...]:
        """The automatic arm, once; whoever switches off or arms before takes it back for good."""
        if self.tick.mode is not Mode.DISARMED or any(command.name in REVOKING for command in commands):
            self._auto_arm = False
        if not (self._auto_arm and self.tick.armable):
            return ()
        self._auto_arm = False
        return (Command("arm"),)

    def _hand_on(self, inputs: Inputs, output: Output) -> None:
        self.record = output.record._replace(execution_s=self._execution_s)
        for sink in self.sinks:
            sink.put(self.record, inputs)
            for note in output.notes:
                sink.note(inputs.t, note)
        self.statistics.add(inputs.id, inputs.t, inputs.lateness_s, self._execution_s)

    def _finished(self) -> bool:
        return self._stop_since is not None and self._idle_ticks >= FAREWELL_TICKS
