"""Run the tests: side by side where the clock does not count, then one after the other where it does.

    python tools/suite.py [--proof] [pytest's arguments]

The first pass takes all tests without the marker `realtime` on one process more than we may use cores, because some of
them mostly wait; the second those with it, alone on the machine. Both always run. What the clock judged too late in the
first pass is asked again after them, alone. The last line adds all up; the exit code is 0 only if all passed. A pass
whose tests were all deselected is no failure, unless both were. Tests with the marker `proof` (statistics over many
seeds) are left out; `--proof` runs these, and nothing else.
"""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

MOST_PROCESSES = 8  # of up to half a gigabyte each
CPU_MAX = Path("/sys/fs/cgroup/cpu.max")
NO_TESTS_COLLECTED = 5
LATE = "HOOPD_TESTS_LATE"  # a file that tests/conftest.py fills
COUNT = re.compile(r"(\d+) (passed|failed|skipped|error)")


def processes(cpu_max: Path = CPU_MAX) -> int:
    """As many as cores that we may use: a container may have two of a machine's sixty-four."""
    cores = min(len(os.sched_getaffinity(0)), MOST_PROCESSES)
    with contextlib.suppress(OSError, ValueError):  # none, or "max": no quota
        quota_us, period_us = map(int, cpu_max.read_text(encoding="ascii").split())
        cores = min(cores, max(1, round(quota_us / period_us)))
    return cores


def environment(late: Path | None = None) -> dict[str, str]:
    """Ours, with compiled modules kept: rewritten assertions take ten seconds of every process that starts anew."""
    ours = {name: value for name, value in os.environ.items() if name not in ("PYTHONDONTWRITEBYTECODE", LATE)}
    return {**ours, LATE: str(late)} if late else ours


def run(arguments: Sequence[str], late: Path | None = None) -> tuple[int, Counter[str]]:
    """One call of pytest, printed as it comes: its exit code, and the counts of its closing line.

    `late`: a file for the names of tests that were late, and are no failures yet.
    """
    command = [sys.executable, "-m", "pytest", "-q", *arguments]
    counts: Counter[str] = Counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment(late)) as process:
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
    side_by_side, alone = passes(proof="--proof" in arguments)
    with tempfile.TemporaryDirectory(prefix="hoopd-suite-") as folder:
        late = Path(folder) / "late.txt"
        results = [run([*side_by_side, *more], late), run([*alone, *more])]
        again = sorted({*late.read_text(encoding="utf-8").splitlines()}) if late.exists() else []
    results += [run(again)] if again else []
    total = sum((counts for _, counts in results), Counter())
    total["skipped"] -= len(again)  # so they were counted when they were put off
    print(f"{time.monotonic() - start:.0f} s")
    print(f"{total['passed']} passed, {total['failed'] + total['error']} failed, {total['skipped']} skipped")
    codes = [code for code, _ in results]
    if all(code == NO_TESTS_COLLECTED for code in codes):
        return NO_TESTS_COLLECTED
    return next((code for code in codes if code not in (0, NO_TESTS_COLLECTED)), 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
