"""How long a tick takes: `tickprobe.py OUT.json RECORDING...`, with the packages of whichever checkout is on the path.

Every recording is replayed several times; each call of `Tick.step` is timed, its result compared by the replay itself.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

from hoopd.core.tick import Tick

try:
    from hoopd.daemon.replay import replay
except ImportError:  # a checkout from before the rooms
    from hoopd.replay import replay  # type: ignore[no-redef]

ROUNDS = 10


def main(out: str, *recordings: str) -> None:
    """Medians over all steps, by the clock and by the processor's time."""
    spent: list[tuple[int, int]] = []
    step = Tick.step

    def timed(self: Tick, inputs: Any) -> Any:
        clock, cpu = time.perf_counter_ns(), time.thread_time_ns()
        result = step(self, inputs)
        spent.append((time.perf_counter_ns() - clock, time.thread_time_ns() - cpu))
        return result

    Tick.step = timed  # type: ignore[method-assign]
    for path in recordings * ROUNDS:
        if not replay(Path(path))["equal"]:
            raise SystemExit(f"{path}: does not replay to the same bits")
    clock_s, cpu_s = (1e-9 * statistics.median(times) for times in zip(*spent, strict=True))
    Path(out).write_text(json.dumps({"clock_s": clock_s, "cpu_s": cpu_s, "steps": len(spent)}))


if __name__ == "__main__":
    main(*sys.argv[1:])
