"""The tick's clock: no drift, nothing missed in silence, safe against cancellation."""

from __future__ import annotations

import asyncio
import os
import time

import pytest
from harness.timing import on_the_clock

from hoopd.shell import clock
from hoopd.shell.clock import TickTimer, wall_zero_ns

PERIOD_S = 0.02


@pytest.fixture(params=["libc", "os"])
def maker(request, monkeypatch):
    """Both ways of making the descriptor, where Python has both."""
    if request.param == "os" and not hasattr(os, "timerfd_create"):
        pytest.skip("os.timerfd_create needs Python 3.13")
    way = clock._create_by_libc if request.param == "libc" else clock._create_by_os
    monkeypatch.setattr(clock, "_create_timer", way)


def test_one_second_of_ticks_does_not_drift(maker):
    async def run() -> tuple[int, int, int]:
        with TickTimer(PERIOD_S) as timer:
            ticks = 0
            while ticks < 50:
                ticks += await timer.wait()
            before = int(timer.now() / PERIOD_S)
            ticks += timer.expirations()
            return before, ticks, int(timer.now() / PERIOD_S)

    before, ticks, after = asyncio.run(run())
    assert before <= ticks <= after  # exact, however late this machine may have been


def test_missed_expirations_are_counted(maker):
    async def run() -> list[int]:
        with TickTimer(PERIOD_S) as timer:
            first = await timer.wait()
            time.sleep(4.5 * PERIOD_S)
            second = await timer.wait()
            return [first, second, round(timer.now() / PERIOD_S)]

    first, second, now = asyncio.run(run())
    assert second >= 4
    assert first + second <= now + 1


def test_expirations_never_blocks_and_resets_the_count():
    with TickTimer(0.01) as timer:
        assert timer.expirations() == 0
        time.sleep(0.035)
        assert timer.expirations() >= 3
        assert timer.expirations() in (0, 1)


def test_deadlines_are_multiples_of_the_period_after_start():
    start = time.monotonic() - 1.0
    with TickTimer(PERIOD_S, start) as timer:
        assert timer.deadline(50) == 1.0
        with on_the_clock():
            assert timer.now() == pytest.approx(time.monotonic() - start, abs=0.05)
        assert timer.expirations() >= 50  # a start in the past: the missed ones are counted


def test_run_time_zero_by_the_wall_clock():
    before = time.time_ns()
    with TickTimer(PERIOD_S, start=time.monotonic() - 3600.0) as timer:
        zero_ns = wall_zero_ns(timer.now)
    assert before - 10**9 < zero_ns + 3600 * 10**9 < time.time_ns() + 10**9


def test_cancelled_wait_leaves_its_count_to_the_next():
    async def run() -> int:
        with TickTimer(PERIOD_S) as timer:
            task = asyncio.ensure_future(timer.wait())
            await asyncio.sleep(0)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            await asyncio.sleep(2.2 * PERIOD_S)  # the reader goes on counting
            return await asyncio.wait_for(timer.wait(), 1.0)

    assert asyncio.run(run()) >= 2


def test_cancelled_after_the_expiry_keeps_the_count():
    async def run() -> int:
        with TickTimer(10.0) as timer:
            task = asyncio.ensure_future(timer.wait())
            await asyncio.sleep(0)
            timer._pending = 3
            timer._wake()
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            return await asyncio.wait_for(timer.wait(), 1.0)

    assert asyncio.run(run()) == 3


def test_other_descriptors_get_their_turn_when_ticks_are_late():
    async def run() -> bool:
        reader, writer = os.pipe()
        seen = []
        asyncio.get_running_loop().add_reader(reader, lambda: seen.append(os.read(reader, 1)))
        with TickTimer(0.001) as timer:
            await timer.wait()
            os.write(writer, b"x")
            for _ in range(3):
                time.sleep(0.003)
                await timer.wait()
        asyncio.get_running_loop().remove_reader(reader)
        os.close(reader)
        os.close(writer)
        return bool(seen)

    assert asyncio.run(run())


def test_second_waiter_is_refused():
    async def run() -> None:
        with TickTimer(10.0) as timer:
            task = asyncio.ensure_future(timer.wait())
            await asyncio.sleep(0)
            with pytest.raises(RuntimeError, match="another task"):
                await timer.wait()
            task.cancel()

    asyncio.run(run())


def test_close_frees_the_descriptor_and_cancels_the_waiter():
    async def run() -> int:
        timer = TickTimer(10.0)
        fd = timer.fileno()
        task = asyncio.ensure_future(timer.wait())
        await asyncio.sleep(0)
        timer.close()
        timer.close()
        with pytest.raises(asyncio.CancelledError):
            await task
        return fd

    fd = asyncio.run(run())
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(fd)


def test_period_must_be_positive():
    with pytest.raises(ValueError, match="positive"):
        TickTimer(0.0)
