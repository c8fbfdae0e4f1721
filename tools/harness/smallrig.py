"""A tick with a board and a camera of a few lines: all is well until something is told to go wrong.

Rules of this file: no clock, no bytes; the board latches its time-out and its faults as docs/reference/board.md asks; a
call is one tick.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cache
from math import isnan, nan, sin

import numpy as np

from hoopd.core.controllers import Log, Measurement
from hoopd.core.frames import ERROR_OVERCURRENT, STATUS_ENABLED, STATUS_FAULT, STATUS_TIMEOUT
from hoopd.core.installed import Filter, Installed
from hoopd.core.limits import Limiter
from hoopd.core.records import CameraSample, Command, DriverSample, Estimate, Inputs, LinkCounts, TorqueCommand
from hoopd.core.tick import Note, Output, Tick
from hoopd.core.ticksettings import TickSettings
from hoopd.shell.config import load

PERIOD_S = 0.02
INERTIA_KG_M2 = 1.5e-3
TIMEOUT_TICKS = 5
TORQUE_LIMIT_NM = 0.7
HEALTHY_TICKS = 60  # a second of good answers, and a little


class Told:
    """An estimator that is told the truth."""

    def __init__(self) -> None:
        self.theta = self.dtheta = 0.0

    def update(
        self,
        t: float,
        torque_previous: float,
        t_applied: float,
        driver: DriverSample | None,
        camera: CameraSample | None,
        *,
        held: bool,
        unmodelled: float = 0.0,
        may_fly: bool = False,
    ) -> Estimate:
        if driver is not None:
            self.theta, self.dtheta = driver.theta, driver.dtheta
        psi = nan if camera is None else camera.psi
        state = np.array([self.theta, self.dtheta, 0.0 if isnan(psi) else psi, 0.0])
        return Estimate(state, True, psi, 0.0, not isnan(psi), 1.0)

    def reset(self) -> None: ...


class Spin:
    """A law that keeps the hoop turning, so that there is something to brake."""

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        return 0.02 * (20.0 - measurement.x[1]), {}

    def reset(self) -> None: ...

    def tune(self, key: str, value: float) -> bool:
        return False


class Board:
    """Latches what it finds wrong, obeys what it hears."""

    def __init__(self) -> None:
        self.enabled = self.timed_out = self.fault = self.condition = False
        self.torque_nm = self.theta = self.dtheta = 0.0
        self.deaf = self.ms = 0

    def hear(self, command: TorqueCommand | None) -> None:
        """One tick's request, or none; then 20 ms pass."""
        self.deaf = 0 if command is not None else self.deaf + 1
        if self.deaf >= TIMEOUT_TICKS:
            self.timed_out = True
        if command is not None and command.clear_fault:
            self.timed_out, self.fault = False, self.condition
            self.enabled = False
        elif command is not None:
            self.enabled, self.torque_nm = command.enable, command.torque_nm
        self.fault = self.fault or self.condition
        if self.timed_out or self.fault:
            self.enabled = False
        self.torque_nm = self.torque_nm if self.enabled else 0.0
        speed = self.dtheta + self.torque_nm / INERTIA_KG_M2 * PERIOD_S - 0.002 * self.dtheta
        self.theta += 0.5 * (self.dtheta + speed) * PERIOD_S
        self.dtheta, self.ms = speed, (self.ms + 20) % 65536

    def restart(self) -> None:
        """As after a power cut."""
        self.enabled = self.timed_out = self.fault = False
        self.torque_nm, self.ms = 0.0, 0

    def answer(self, t: float, constant_nm_per_a: float) -> DriverSample:
        status = STATUS_ENABLED * self.enabled | STATUS_TIMEOUT * self.timed_out | STATUS_FAULT * self.fault
        errors = ERROR_OVERCURRENT if self.condition else 0
        current = self.torque_nm / constant_nm_per_a if constant_nm_per_a else 0.0
        return DriverSample(t, 0, status, errors, self.theta, self.dtheta, current, self.ms)


class SmallRig:
    """Tick, board, camera; `silent`, `dark`, `blind`, `late`: ticks to come without answer, ball, picture, in time."""

    def __init__(self) -> None:
        faults = load(None, sim=True, overrides=[]).faults
        limiter = Limiter(TORQUE_LIMIT_NM, TORQUE_LIMIT_NM)
        self.tick = Tick(TickSettings(), faults, Told(), Spin(), limiter, make=self._make)
        self.loadable: dict[str, Callable[[Filter], Installed]] = {}  # what may be loaded, by the text that brings it
        self.board, self.k = Board(), 0
        self.silent = self.dark = self.blind = self.late = 0
        self._constant = faults.torque_constant_nm_per_a
        self.notes: list[Note] = []

    @property
    def mode(self) -> str:
        return str(self.tick.mode)

    def step(self, *commands: str | Command) -> Output:
        """One tick with these commands."""
        self.k += 1
        t = self.k * PERIOD_S
        driver = None if self.silent else self.board.answer(t - 0.019, self._constant)
        output = self.tick.step(
            Inputs(
                id=self.k,
                t=t,
                camera=None if self.blind else self._picture(t),
                driver=driver,
                link=LinkCounts(good=int(driver is not None)),
                commands=tuple(Command(one) if isinstance(one, str) else one for one in commands),
                lateness_s=PERIOD_S if self.late else 1e-4,
                execution_s=5e-4,
                camera_stalled=False,
                trouble=0,
            )
        )
        self.board.hear(None if self.silent else output.command)
        for name in ("silent", "dark", "blind", "late"):
            setattr(self, name, max(0, getattr(self, name) - 1))
        self.notes.extend(output.notes)
        return output

    def run(self, ticks: int) -> list[str]:
        """Ticks without a command; their modes."""
        return [self.step().record.mode for _ in range(ticks)]

    def stall(self, ticks: int) -> None:
        """The host misses so many ticks; the board waits for it."""
        self.k += ticks
        for _ in range(ticks):
            self.board.hear(None)

    def refused(self) -> list[tuple[str, str]]:
        """What was refused so far, and why."""
        return [(n.fields["command"], n.fields["reason"]) for n in self.notes if n.name == "command_refused"]

    def _make(self, text: str, running: Filter) -> Installed:
        return self.loadable[text](running)

    def _picture(self, t: float) -> CameraSample:
        psi = nan if self.dark else 0.002 * sin(2.4 * self.k * self.k)
        return CameraSample(self.k, t - 0.05, t - 0.005, psi, 0.0 if self.dark else 1.0, 240.0, 422.0)


@cache
def _healthy() -> SmallRig:
    rig = SmallRig()
    rig.run(HEALTHY_TICKS)
    return rig


def healthy() -> SmallRig:
    """A rig that can be armed at once."""
    return copy.deepcopy(_healthy())


def running() -> SmallRig:
    """A rig that controls and whose hoop turns."""
    rig = healthy()
    rig.step("arm")
    assert rig.run(60)[-1] == "RUNNING"
    return rig
