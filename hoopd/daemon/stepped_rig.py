"""The daemon's own loop on the rig in lock-step, one tick at a time: an agent outside of it is the control law.

The loop waits for its timer as it always does; here the timer waits for the agent.

Rules of this file: board, wire, camera, filter, modes, faults and limits are those of `hoopd --sim --speed max`; what
the agent asks for passes all of them. Nothing is recorded and nothing is sent.
"""

from __future__ import annotations

from collections.abc import Coroutine, Generator
from contextlib import ExitStack
from dataclasses import replace
from types import coroutine
from typing import Any

from hoopd.core.controllers import Log, Measurement
from hoopd.core.modes import Mode
from hoopd.core.records import TickRecord
from hoopd.core.succession import EXPERIMENT
from hoopd.daemon.build import Texts, build_tick
from hoopd.daemon.world import lockstep, read_layout
from hoopd.shell.config import Config
from hoopd.shell.loop import Loop, Timer

# The board enables its drive and the filter finds the ball within half a second.
START_TICKS = 150
# Hands let the ball go when the drive gives its first torque: this one, where the agent begins with none.
RELEASE_NM = 1e-4


class AgentLaw:
    """A law whose torque is told from outside; rows that its task would raise are suspended, as a plan's are."""

    def __init__(self, suspended: tuple[str, ...]) -> None:
        self.torque_nm = 0.0
        self.suspended = suspended
        self.released = False

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        """The agent's torque."""
        first, self.released = not self.released, True
        return RELEASE_NM if first and self.torque_nm == 0.0 else self.torque_nm, {}

    def reset(self) -> None:
        """Nothing is kept."""

    def tune(self, key: str, value: float) -> bool:
        """Nothing has a name."""
        return False


# What the loop hands out when it is the agent's turn; whatever else it hands out is none.
TURN = object()


@coroutine
def _turn() -> Generator[object, None, None]:
    """The agent's turn."""
    yield TURN


class _AgentsTimer:
    """The rig's timer, which lets the agent have its turn before every tick."""

    def __init__(self, timer: Timer) -> None:
        self._timer = timer

    async def wait(self) -> int:
        """The agent's turn, then the next deadline."""
        await _turn()
        return await self._timer.wait()

    def now(self) -> float:
        """Run time in s."""
        return self._timer.now()


class SteppedRig:
    """One run, from the arm on."""

    def __init__(self, config: Config, texts: Texts, plant: dict[str, Any], seed: int, suspended: tuple[str, ...]):
        """`plant`: of `sim.parts.plant_arguments`; RuntimeError when the rig does not come to act."""
        self._stack = ExitStack()
        layout = read_layout(config, None)
        world = self._stack.enter_context(lockstep(config, layout, plant, seed, direct=True))
        assert world.plant is not None
        self.plant, self.law = world.plant, AgentLaw(suspended)
        self.tick = build_tick(config, texts)
        self._install()
        self._loop = Loop(
            self.tick, _AgentsTimer(world.timer), world.drive, world.eye, sinks=(), auto_arm=True, collect=False
        )
        self._run: Coroutine[Any, Any, None] = self._loop.run()
        self._to_turn()
        self._start()

    def _install(self) -> None:
        succession = self.tick.succession
        succession.acting = succession.accepted = replace(succession.acting, law=self.law, fed=False)
        succession.purpose = EXPERIMENT  # whose law may tell which rows it would raise by itself

    def _start(self) -> None:
        for _ in range(START_TICKS):
            self._to_turn()
            if self.acts:
                return
        raise RuntimeError(f"the rig did not come to act: {', '.join(self.tick.faults) or self.tick.mode}")

    @property
    def acts(self) -> bool:
        """Whether the agent's torque reaches the drive."""
        return self.tick.mode is Mode.RUNNING

    @property
    def record(self) -> TickRecord:
        """Of the last tick."""
        assert self._loop.record is not None
        return self._loop.record

    @property
    def seen_rad(self) -> float:
        """The ball's angle in the newest picture; NaN without a picture or a ball in it."""
        return self.record.psi

    def play(self, torque_nm: float) -> None:
        """One tick with the agent's torque."""
        self.law.torque_nm = torque_nm
        self._to_turn()

    def _to_turn(self) -> None:
        """Let the loop go on until the agent has its next turn."""
        while self._run.send(None) is not TURN:
            pass

    def close(self) -> None:
        """Switch the drive off and take the rig away."""
        self._run.close()
        self._stack.close()
