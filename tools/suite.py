"""Run the tests: side by side where the clock does not count, then one after the other where it does.

    python tools/suite.py [--proof] [pytest's arguments]

The first pass takes all tests without the marker `realtime` on one process more than we may use cores, because some of
them mostly wait; the second those with it, alone on the machine. Both always run. The last line adds them up; the exit
code is 0 only if both passed. A pass whose tests were all deselected is no failure, unless both were. Tests with the
marker `proof` (statistics over many seeds) are left out; `--proof` runs these, and nothing else.
"""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

MOST_PROCESSES = 8  # of up to half a gigabyte each
CPU_MAX = Path("/sys/fs/cgroup/cpu.max")
NO_TESTS_COLLECTED = 5
COUNT = re.compile(r"(\d+) (passed|failed|skipped|error)")


def processes(cpu_max: Path = CPU_MAX) -> int:
    """As many as cores that we may use: a container may have two of a machine's sixty-four."""
    cores = min(len(os.sched_getaffinity(0)), MOST_PROCESSES)
    with contextlib.suppress(OSError, ValueError):  # none, or "max": no quota
        quota_us, period_us = map(int, cpu_max.read_text(encoding="ascii").split())
        cores = min(cores, max(1, round(quota_us / period_us)))
    return cores


def environment() -> dict[str, str]:
    """Ours, with compiled modules kept: rewritten assertions take ten seconds of every process that starts anew."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def run(arguments: Sequence[str]) -> tuple[int, Counter[str]]:
    """One call of pytest, printed as it comes: its exit code, and the counts of its closing line."""
    command = [sys.executable, "-m", "pytest", "-q", *arguments]
    counts: Counter[str] = Counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment()) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            if found := COUNT.findall(line):
                counts = Counter({what: int(number) for number, what in found})
    return process.returncode, counts


def passes(*, proof: bool) -> tuple[list[str], list[str]]:
    """The arguments of both calls. Work is stolen: the last file of one process would leave the others idle."""
    kind = "proof" if proof else "not proof"
    side_by_side = ["-m", f"not realtime and {kind}", "-n", str(processes() + 1), "--dist", "worksteal"]
    return side_by_side, ["-m", f"realtime and {kind}"]


def main(arguments: Sequence[str]) -> int:
    start = time.monotonic()
    more = [one for one in arguments if one != "--proof"]
    results = [run([*chosen, *more]) for chosen in passes(proof="--proof" in arguments)]
    total = sum((counts for _, counts in results), Counter())
    print(f"{time.monotonic() - start:.0f} s")
    print(f"{total['passed']} passed, {total['failed'] + total['error']} failed, {total['skipped']} skipped")
    codes = [code for code, _ in results]
    if all(code == NO_TESTS_COLLECTED for code in codes):
        return NO_TESTS_COLLECTED
    return next((code for code in codes if code not in (0, NO_TESTS_COLLECTED)), 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
