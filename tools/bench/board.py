"""The simulated board in real time: `python tools/bench/board.py [--seconds 10] [--plant MODULE:CALLABLE] [--fifo]`.

Asks at 50 Hz over the pseudo-terminal and prints the round trip (the wire alone is 2.431 ms), the share of a core that
the board's process needs, and how far the published plant state lags the clock.
"""

from __future__ import annotations

import argparse
import os
import select
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])

from hoopd.core.frames import DEFAULT_LAYOUT, Decoder, encode_request  # noqa: E402
from hoopd.sim.boardprocess import ProcessConfig, start  # noqa: E402
from hoopd.sim.statering import StateRingReader  # noqa: E402
from hoopd.sim.torque_log import read  # noqa: E402

RIG_PLANT = "hoopd.sim.plant:make_plant"
RIG_ARGUMENTS = {
    "structure": "rolling",
    "parameters": {
        "mb": 0.0608,
        "Ro": 0.0957,
        "Rb": 0.0104,
        "Ib": 3.679e-6,
        "Ih": 1.518e-3,
        "bb": 2.6e-6,
        "bh": 7e-4,
        "g": 9.81,
    },
    "x0": [0.0, 0.0, 0.4, 0.0],
}


class FreeWheel:
    """A free inertia: what the process costs without a real plant."""

    def __init__(self) -> None:
        self.t = self.theta = self.dtheta = 0.0

    def advance(self, t: float, torque_nm: float) -> None:
        step = max(t - self.t, 0.0)
        self.theta, self.dtheta, self.t = self.theta + self.dtheta * step, self.dtheta + 500.0 * torque_nm * step, t

    def sample(self) -> tuple[float, float, float]:
        return self.theta, self.dtheta, float("nan")

    @property
    def state(self) -> tuple[float, float, float, float]:
        return self.theta, self.dtheta, 0.0, 0.0


def ask_at_50_hz(link: Path, ring: Path, seconds: float) -> tuple[list[float], list[float], int]:
    """Round trips and lags in s, and the number of missing answers."""
    port, decoder, reader = (
        os.open(link, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK),
        Decoder(DEFAULT_LAYOUT),
        StateRingReader(ring),
    )
    trips, lags, missing, begin = [], [], 0, time.monotonic()
    for k in range(int(seconds * 50)):
        time.sleep(max(begin + 0.02 * k - time.monotonic(), 0.0))
        asked = time.monotonic()
        latest = reader.latest()
        if latest:
            lags.append(asked - latest.t)
        os.write(port, encode_request(DEFAULT_LAYOUT, k, True, k == 0, 0.01 * (-1) ** k))
        answers = []
        while not answers and time.monotonic() < asked + 0.019:
            if select.select([port], [], [], 0.005)[0]:
                answers = decoder.feed(os.read(port, 100))
        trips.append(time.monotonic() - asked)
        missing += not answers
    os.close(port)
    return trips, lags, missing


def show(name: str, values: list[float]) -> None:
    p50, p99, top = 1e3 * np.percentile(values, [50, 99, 100])
    print(f"{name:<24} p50 {p50:.3f} ms  p99 {p99:.3f} ms  max {top:.3f} ms")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--plant", default="", help="package.module:callable; default: a free wheel")
    parser.add_argument("--rig", action="store_true", help="the rig's own plant: the rolling model")
    parser.add_argument("--fifo", type=int, default=0, metavar="N", help="real-time priority of the board")
    options = parser.parse_args()
    sys.path.insert(0, str(Path(__file__).parent))
    os.environ["PYTHONPATH"] += os.pathsep + str(Path(__file__).parent)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        name, arguments = (RIG_PLANT, RIG_ARGUMENTS) if options.rig else (options.plant or "board:FreeWheel", {})
        config = ProcessConfig(name, str(folder / "torque.jsonl"), arguments, state_ring=str(folder / "ring"))
        process = start(folder / "port", config, fifo=options.fifo)
        meter = psutil.Process(process.pid)
        before = sum(meter.cpu_times()[:2])
        trips, lags, missing = ask_at_50_hz(folder / "port", folder / "ring", options.seconds)
        used_s = sum(meter.cpu_times()[:2]) - before
        assert process.stdin is not None
        process.stdin.close()
        process.wait(5.0)
        log = read(folder / "torque.jsonl")
    show("round trip", trips)
    show("lag of the plant state", lags)
    print(f"{'answers missing':<24} {missing} of {len(trips)}")
    print(f"{'board process':<24} {100 * used_s / options.seconds:.1f} % of a core")
    print(f"{'torque log':<24} {len(log)} rows, {log.reasons()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
