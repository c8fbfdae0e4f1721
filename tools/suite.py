"""Run the tests: side by side where the clock does not count, then one after the other where it does.

    python tools/suite.py [pytest's arguments]

The first pass takes all tests without the marker `realtime` on as many processes as there are cores, a file at a time;
the second those with it, alone on the machine. Both always run. The last line adds them up; the exit code is 0 only if
both passed. A pass whose tests were all deselected is no failure, unless both were.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence

PASSES = (
    ["-m", "not realtime", "-n", str(os.cpu_count() or 1), "--dist", "loadfile"],
    ["-m", "realtime"],
)
NO_TESTS_COLLECTED = 5
COUNT = re.compile(r"(\d+) (passed|failed|skipped|error)")


def run(arguments: Sequence[str]) -> tuple[int, Counter[str]]:
    """One call of pytest, printed as it comes: its exit code, and the counts of its closing line."""
    command = [sys.executable, "-m", "pytest", "-q", *arguments]
    counts: Counter[str] = Counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            if found := COUNT.findall(line):
                counts = Counter({what: int(number) for number, what in found})
    return process.returncode, counts


def main(arguments: Sequence[str]) -> int:
    results = [run([*chosen, *arguments]) for chosen in PASSES]
    total = sum((counts for _, counts in results), Counter())
    print(f"{total['passed']} passed, {total['failed'] + total['error']} failed, {total['skipped']} skipped")
    codes = [code for code, _ in results]
    if all(code == NO_TESTS_COLLECTED for code in codes):
        return NO_TESTS_COLLECTED
    return next((code for code in codes if code not in (0, NO_TESTS_COLLECTED)), 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
