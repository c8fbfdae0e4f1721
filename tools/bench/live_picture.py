"""What does the live picture cost the tick? `python tools/bench/live_picture.py --seconds 10`.

Runs the rig in real time with pictures and follows its ticks. In one run nobody looks, somebody looks at both views,
and so on in turns; prints execution and lateness of the ticks of each kind, and pictures a second. Exit code 1 when
pictures come faster than ten a second, or when somebody looks and none come; times are the machine's, too, and are
not judged.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import processes
import zenoh

from hoopd.shell.session import connecting

START_S = 8.0  # until the rig controls
TURNS = 6
RING = 200
MOST_HZ = 10.0
KEYS = ("hoopd/hoop/picture/camera", "hoopd/hoop/picture/threshold")


@dataclass
class Kind:
    """Ticks of all turns of a kind."""

    execution_ms: list[float] = field(default_factory=list)
    lateness_ms: list[float] = field(default_factory=list)
    pictures: int = 0
    seconds: float = 0.0


def follow(ticks: Any, lookers: Sequence[Any], kind: Kind, seconds: float) -> None:
    """Take what comes for a while."""
    began = time.monotonic()
    while time.monotonic() - began < seconds:
        time.sleep(0.05)
        while sample := ticks.try_recv():
            row = json.loads(sample.payload.to_bytes())
            kind.execution_ms.append(1e3 * row["execution_s"])
            kind.lateness_ms.append(1e3 * row["lateness_s"])
        for looker in lookers:
            while looker.try_recv():
                kind.pictures += 1
    kind.seconds += time.monotonic() - began


def measure(endpoint: str, seconds: float) -> tuple[Kind, Kind]:
    """Ticks while nobody looks, and while somebody does."""
    alone, looked = Kind(), Kind()
    ring = zenoh.handlers.RingChannel
    with zenoh.open(connecting(endpoint, {}, 5.0)) as session:
        ticks = session.declare_subscriber("hoopd/hoop/tick", ring(RING))
        for turn in range(TURNS):
            with contextlib.ExitStack() as stack:
                keys = KEYS if turn % 2 else ()
                lookers = [stack.enter_context(session.declare_subscriber(key, ring(RING))) for key in keys]
                follow(ticks, lookers, looked if turn % 2 else alone, seconds)
    return alone, looked


def shown(name: str, kind: Kind) -> str:
    """A row of the table."""
    figures = [f"{np.percentile(of, q):9.3f}" for of in (kind.execution_ms, kind.lateness_ms) for q in (50, 99)]
    rate_hz = kind.pictures / kind.seconds / len(KEYS)
    return f"{name:>14} {len(kind.execution_ms):6} {' '.join(figures)} {rate_hz:8.1f}"


def main() -> int:
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each turn")
    seconds = parser.parse_args().seconds
    command = processes.daemon_command(START_S + 10.0 + TURNS * (seconds + 1.0))
    endpoint = next(part.partition("=")[2] for part in command if part.startswith("telemetry.endpoint="))
    with processes.daemon(command):
        time.sleep(START_S)
        alone, looked = measure(endpoint, seconds)
    print(f"{'':>14} {'ticks':>6} {'execution p50, p99 ms':>19} {'lateness p50, p99 ms':>19} {'/s':>6}")
    print(shown("nobody looks", alone))
    print(shown("both views", looked))
    rate_hz = looked.pictures / looked.seconds / len(KEYS)
    fine = 0.0 < rate_hz <= MOST_HZ
    print("every bound holds" if fine else f"{rate_hz:.1f} pictures a second")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
