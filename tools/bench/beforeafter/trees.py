"""The command line of any checkout, in a fresh process.

Rules of this file: the checkout is told by its folder and stands first on the path; one thread of linear algebra;
nothing is measured but the duration and the processor's time of the process.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[3]
LIMIT_S = 1200.0
TAIL_CHARS = 1000


class Ended(NamedTuple):
    """A process that ended well."""

    seconds: float
    cpu_s: float


class ToolError(Exception):
    """A process that failed: one line for who asked."""


def hoopd(tree: Path, arguments: Sequence[str], cwd: Path) -> Ended:
    """`hoopd ARGUMENTS` of a checkout; ToolError when it fails."""
    return python(tree, ["-m", "hoopd", *arguments], cwd)


def python(tree: Path, arguments: Sequence[str], cwd: Path) -> Ended:
    """The interpreter of this bench with a checkout's packages; ToolError when it fails."""
    ones = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    environment = {**os.environ, **ones, "PYTHONPATH": str(tree.resolve())}
    begun, cpu_s = time.perf_counter(), _children_s()
    try:
        done = subprocess.run(
            [sys.executable, *arguments], cwd=cwd, env=environment, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, timeout=LIMIT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ToolError(f"{' '.join(arguments)}: not done after {LIMIT_S:g} s") from None
    if done.returncode:
        raise ToolError(f"{' '.join(arguments)}: exit code {done.returncode}: {done.stderr[-TAIL_CHARS:]}")
    return Ended(time.perf_counter() - begun, _children_s() - cpu_s)


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
