"""The loop: order of a tick, the end of a run, and that zero torque is the last word."""

from __future__ import annotations

import ast
import asyncio
import inspect
from collections.abc import Callable
from typing import Any

import pytest

from hoopd.core.modes import Mode
from hoopd.core.records import CameraSample, Command, DriverSample, Inputs, LinkCounts, TickRecord, TorqueCommand
from hoopd.core.tick import Note, Tick
from hoopd.daemon.build import build_tick, read_texts
from hoopd.shell import loop as module
from hoopd.shell.config import load
from hoopd.shell.loop import Loop

PERIOD = 0.02


class FakeWorld:
    """Timer, drive and camera that are always well; every method may be told to fail."""

    stalled = False

    def __init__(self, expirations: Callable[[int], int] = lambda k: 1) -> None:
        self.k = self.waits = 0
        self.expirations = expirations
        self.written: list[TorqueCommand] = []
        self.order: list[str] = []
        self.fail_at = 10**9

    async def wait(self) -> int:
        self.waits += 1
        count = self.expirations(self.waits)
        self.k += count
        await asyncio.sleep(0)
        if self.waits >= self.fail_at:
            raise RuntimeError("the timer broke")
        return count

    def now(self) -> float:
        return self.k * PERIOD

    def open(self) -> None:
        self.order.append("open")

    def take(self) -> Any:
        raise NotImplementedError

    def write(self, command: TorqueCommand) -> None:
        self.order.append("write")
        self.written.append(command)

    def close(self) -> None: ...


class Drive:
    def __init__(self, world: FakeWorld) -> None:
        self.world, self.open, self.write = world, world.open, world.write

    def take(self) -> tuple[DriverSample | None, LinkCounts]:
        self.world.order.append("take")
        status = 1 if self.world.written and self.world.written[-1].enable else 0
        t = self.world.now() - 0.0193
        return DriverSample(t, 0, status, 0, 0.0, 0.0, 0.0, int(1e3 * t) % 65536), LinkCounts(good=1)


class Eye:
    stalled = False

    def __init__(self, world: FakeWorld) -> None:
        self.world = world

    def take(self) -> CameraSample:
        t = self.world.now()
        return CameraSample(self.world.k, t - 0.05, t - 0.01, 0.0, 1.0, 240.0, 422.0)


class Sink:
    trouble = False

    def __init__(self, world: FakeWorld) -> None:
        self.world, self.records, self.notes = world, [], []  # type: ignore[var-annotated]

    def put(self, record: TickRecord, inputs: Inputs) -> None:
        self.world.order.append("put")
        self.records.append(record)

    def note(self, t: float, note: Note) -> None:
        self.notes.append(note)


def make_tick() -> Tick:
    config = load(None, sim=True, overrides=[])
    return build_tick(config, read_texts(config, None))


def make_loop(world: FakeWorld, **options: Any) -> tuple[Loop, Sink]:
    sink = Sink(world)
    return Loop(make_tick(), world, Drive(world), Eye(world), sinks=(sink,), **options), sink


def test_a_tick_writes_its_torque_before_anything_else_is_done() -> None:
    world = FakeWorld()
    loop, _ = make_loop(world, duration_s=0.2)
    asyncio.run(loop.run())
    assert world.order[:4] == ["open", "take", "write", "put"]


def test_there_is_one_await_in_the_loop_and_it_is_the_sleep() -> None:
    tree = ast.parse(inspect.getsource(module))
    awaits = [ast.unparse(node.value) for node in ast.walk(tree) if isinstance(node, ast.Await)]
    assert awaits == ["self.timer.wait()"]


def test_missed_expirations_are_a_gap_in_the_ids() -> None:
    world = FakeWorld(lambda k: 4 if k == 10 else 1)
    loop, sink = make_loop(world, duration_s=0.6)
    asyncio.run(loop.run())
    ids = [record.id for record in sink.records]
    assert ids[8:11] == [9, 13, 14]
    assert loop.statistics.missed == 3


def test_it_arms_by_itself_once_and_stops_in_order() -> None:
    world = FakeWorld()
    loop, sink = make_loop(world, duration_s=3.0, auto_arm=True)
    asyncio.run(loop.run())
    modes = [record.mode for record in sink.records]
    assert Mode.RUNNING in modes
    assert modes[-1] == Mode.DISARMED
    assert [note.fields["command"] for note in sink.notes if note.name == "operator"] == ["arm", "stop"]


@pytest.mark.parametrize("way", ["error", "cancel", "sink"])
def test_whatever_ends_the_loop_the_last_frame_has_no_torque(way: str) -> None:
    world = FakeWorld()
    loop, sink = make_loop(world, auto_arm=True, sources=(lambda t: (Command("reference", 0.3),) if t > 2 else (),))

    def boom(record: TickRecord, inputs: Inputs) -> None:
        if record.t > 3.0:
            raise OSError("a sink failed")

    if way == "error":
        world.fail_at = 150
    elif way == "sink":
        sink.put = boom  # type: ignore[method-assign]

    async def run() -> None:
        task = asyncio.create_task(loop.run())
        if way == "cancel":
            for _ in range(500):
                await asyncio.sleep(0)
            task.cancel()
        await task

    with pytest.raises((RuntimeError, asyncio.CancelledError, OSError)):
        asyncio.run(run())
    assert any(command.torque_nm for command in world.written)
    assert all(command[1:] == (False, False, 0.0) for command in world.written[-3:])  # one may be lost on the wire


def test_asked_twice_the_drive_goes_off_at_once() -> None:
    world = FakeWorld()
    loop, sink = make_loop(world, auto_arm=True)

    def source(t: float) -> tuple[Command, ...]:
        if t > 2.0 and loop._stop_since is None:
            loop.request_stop()
            loop.request_stop()
        return ()

    loop.sources = (source,)
    asyncio.run(loop.run())
    commands = [note.fields["command"] for note in sink.notes if note.name == "operator"]
    assert commands == ["arm", "stop", "disarm"]
    assert world.written[-1].enable is False
