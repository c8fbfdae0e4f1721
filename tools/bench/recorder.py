"""What recording and telemetry cost: time per put in the tick, per row written, and bytes per hour.

python tools/bench/recorder.py [--rows 30000]
"""

from __future__ import annotations

import argparse
import gc
import math
import random
import socket
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np

from hoopd.core.records import CameraSample, DriverSample, Inputs, LinkCounts, TickRecord
from hoopd.recording import mcap
from hoopd.shell.commands import Gate, Ranges
from hoopd.shell.recorder import Recorder
from hoopd.shell.run_files import Limits
from hoopd.shell.telemetry import Telemetry, TelemetrySettings

TICK_S = 0.02
ROWS_PER_HOUR = 3600.0 / TICK_S
Row = tuple[TickRecord, Inputs]


def rows(count: int) -> list[Row]:
    """A run with noise in every digit, as a real one has: compression must not flatter."""
    noise = random.Random(1)
    made = []
    for k in range(count):
        t = k * TICK_S + noise.gauss(0.0, 5e-5)
        psi, theta, speed = (
            0.4 * math.sin(t) + noise.gauss(0.0, 2e-3),
            3.0 * t + noise.gauss(0.0, 1e-4),
            noise.gauss(3, 0.05),
        )
        theta, speed, current = (float(np.float32(x)) for x in (theta, speed, noise.gauss(0.2, 0.01)))
        camera = CameraSample(k, t - 0.05, t - 0.01, psi, 0.9, 240 + 200 * math.sin(psi), 240 + 200 * math.cos(psi))
        driver = DriverSample(t - 0.019, k % 256, 1, 0, theta, speed, current, k * 20 % 65536)
        late, busy = abs(noise.gauss(1e-4, 5e-5)), abs(noise.gauss(6e-4, 1e-4))
        torque, state = noise.gauss(0.0, 0.1), (theta, speed, psi, noise.gauss(0.0, 0.1))
        done = TickRecord(
            t, k, "RUNNING", torque, theta, speed, current, psi, t - 0.019, t - 0.05, state, 0.0, 1, 0, late, busy
        )
        made.append((done, Inputs(k, t, camera, driver, LinkCounts(1), (), late, busy, False, 0)))
    return made


def show(what: str, times_s: list[float]) -> None:
    """Percentiles of one cost."""
    p50, p99 = np.percentile(times_s, [50, 99]) * 1e6
    print(f"{what:<44} p50 {p50:6.2f} us   p99 {p99:6.2f} us   max {max(times_s) * 1e6:8.1f} us")


def timed(call: object, arguments: list[tuple[object, ...]], pause_s: float) -> list[float]:
    """Duration of each call, with a pause between."""
    spent = []
    for item in arguments:
        begin = time.perf_counter()
        call(*item)  # type: ignore[operator]
        spent.append(time.perf_counter() - begin)
        time.sleep(pause_s)
    return spent


def bench_put(folder: Path, made: list[Row]) -> None:
    """Cost in the tick, beside the writing and publishing threads."""
    recorder = Recorder(folder, mcap.Header("bench"), limits=Limits(10**9, 0))
    show("recorder put, in the tick", timed(recorder.put, list(made), 0.001))
    recorder.close(10.0)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    telemetry = Telemetry(TelemetrySettings(endpoint=endpoint), Gate(Ranges()))
    telemetry.start()
    time.sleep(0.2)
    show("telemetry put, in the tick", timed(telemetry.put, [(row[0],) for row in made], 0.001))
    telemetry.close(10.0)
    print(f"{'':<44} {telemetry.counts}")


def bench_write(folder: Path, made: list[Row]) -> None:
    """Cost of a row in the writer's thread, bytes and memory per hour."""
    with (folder / "write.mcap").open("wb", buffering=0) as file:
        writer = mcap.Writer(file, mcap.Header("bench"), sync=False)
        show("row written (both channels, chunks included)", timed(writer.add, list(made), 0.0))
        gc.collect()
        size = writer.size
        writer.finish()
    print(f"{'bytes per hour':<44} {size / len(made) * ROWS_PER_HOUR / 1e6:6.1f} MB")
    with (folder / "memory.mcap").open("wb", buffering=0) as file:
        writer = mcap.Writer(file, mcap.Header("bench"), sync=False)
        half = len(made) // 2
        for row in made[:half]:
            writer.add(*row)
        gc.collect()
        tracemalloc.start()
        for row in made[half:]:
            writer.add(*row)
        gc.collect()
        grown, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    print(f"{'memory per hour (the index)':<44} {grown / half * ROWS_PER_HOUR / 1e6:6.1f} MB")


def bench_read(folder: Path, count: int) -> None:
    """Time to read back."""
    for name, read in (("read", mcap.read), ("read_run", mcap.read_run)):
        begin = time.perf_counter()
        read(folder / "write.mcap")
        spent_s = time.perf_counter() - begin
        print(f"{name + ', an hour of ticks':<44} {spent_s / count * ROWS_PER_HOUR:6.2f} s")


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rows", type=int, default=30000)
    count = parser.parse_args().rows
    made = rows(count)
    with tempfile.TemporaryDirectory() as name:
        bench_put(Path(name), made[: min(count, 3000)])
        bench_write(Path(name), made)
        bench_read(Path(name), count)


if __name__ == "__main__":
    main()
