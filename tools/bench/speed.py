"""How fast is lock-step? `python tools/bench/speed.py [--runs 5] [--seconds 60] [--against FOLDER]`.

Runs `--speed max` with the ball's angle directly and with pictures, several times in turn, each in a fresh process with
a recording, and prints the real-time factors (virtual seconds per second of the loop, start-up left out), by the clock
and by the processor's time (nearer to what the clock would show without other work on the machine). `--against` names
another checkout, which takes its turns with this one: the same machine at the same time. Bounds: the median is at least
50 with angles (aim 100) and 5 with pictures; exit code 1 below. `--profile` shows where a direct run's time goes.
"""

from __future__ import annotations

import argparse
import cProfile
import hashlib
import json
import math
import pstats
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import processes
from processes import ROOT

sys.path.insert(0, str(ROOT))

from rich.console import Console
from rich.table import Table

LEAST = {"direct": 50.0, "pictures": 5.0}
AIM = {"direct": 100.0, "pictures": 5.0}
PICTURES_SHARE = 0.2  # of the virtual seconds: a picture costs ten times what an angle does
SHOWN_SPOTS = 25


class Run(NamedTuple):
    """One run's result."""

    factor: float
    cpu_factor: float  # per second of the processor's time; NaN from a daemon that does not tell it
    recording: str  # SHA-256: the same bytes from the same seed


def run(root: Path, kind: str, seconds: float) -> Run:
    """One lock-step run of the tree `root`."""
    with tempfile.TemporaryDirectory(prefix="hoopd-bench-") as name:
        folder = Path(name)
        direct = ("--camera", "direct") if kind == "direct" else ()
        out = folder / "summary.json"
        command = processes.daemon_command(
            seconds, "--speed", "max", "--record", name, "--json", str(out), *direct, "--set", "log.level=error"
        )
        command = _without_endpoint(command)  # a random port would change the recorded configuration
        with processes.daemon(command, root=root) as child:
            child.wait()
        if child.returncode:
            raise RuntimeError(f"the daemon of {root} ended with code {child.returncode}")
        parts = sorted(folder.glob("run-*.mcap"))
        digest = hashlib.sha256(b"".join(path.read_bytes() for path in parts)).hexdigest()
        summary = json.loads(out.read_text())
        cpu_factor = summary["seconds"] / summary["cpu_s"] if "cpu_s" in summary else math.nan
        return Run(summary["real_time_factor"], cpu_factor, digest)


def _without_endpoint(command: list[str]) -> list[str]:
    place = next(i for i, part in enumerate(command) if part.startswith("telemetry.endpoint="))
    return command[: place - 1] + command[place + 1 :]


def measure(roots: list[Path], kinds: list[str], seconds: float, runs: int) -> dict[tuple[str, Path], list[Run]]:
    """All runs, taken in turns, so that a slow minute of the machine falls on all alike."""
    found: dict[tuple[str, Path], list[Run]] = {(kind, root): [] for kind in kinds for root in roots}
    for turn in range(runs):
        for (kind, root), results in found.items():
            processes.progress(f"run {turn + 1} of {runs}, {kind}")
            share = 1.0 if kind == "direct" else PICTURES_SHARE
            results.append(run(root, kind, max(1.0, share * seconds)))
    processes.progress("")
    return found


def show(found: dict[tuple[str, Path], list[Run]], names: dict[Path, str]) -> None:
    """Factors of all runs side by side."""
    table = Table(title="times real time, fresh process each, recorded")
    for head in (
        "camera",
        "tree",
        "median",
        "lowest",
        "highest",
        "median by CPU",
        "runs",
        "at least",
        "aim",
        "recording",
    ):
        table.add_column(head)
    for (kind, root), runs in found.items():
        factors = [one.factor for one in runs]
        by_cpu = statistics.median(one.cpu_factor for one in runs)
        figures = (statistics.median(factors), min(factors), max(factors), by_cpu)
        digests = {one.recording for one in runs}
        recording = digests.pop()[:12] if len(digests) == 1 else "DIFFERENT from run to run"
        bounds = (f"{LEAST[kind]:.0f}", f"{AIM[kind]:.0f}")
        table.add_row(kind, names[root], *(f"{value:.1f}" for value in figures), str(len(runs)), *bounds, recording)
    Console(width=None if sys.stdout.isatty() else 120).print(table)


def profile(seconds: float) -> None:
    """Where the time of a direct run goes, by cProfile (which itself costs about the same again)."""
    from hoopd.daemon.app import Options, run_daemon

    profiler = cProfile.Profile()
    with tempfile.TemporaryDirectory(prefix="hoopd-bench-") as name:
        options = Options(True, None, ("log.level=error",), seconds, Path(name), 0, "max", True)
        profiler.runcall(run_daemon, options)
    for order in ("tottime", "cumulative"):
        pstats.Stats(profiler).strip_dirs().sort_stats(order).print_stats(SHOWN_SPOTS)


def main() -> int:
    """Measure and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=60.0, help="virtual seconds of a direct run")
    parser.add_argument("--against", type=Path, help="another checkout to take turns with")
    parser.add_argument("--only", choices=tuple(LEAST), help="one of the two")
    parser.add_argument("--profile", action="store_true", help="profile one direct run instead")
    options = parser.parse_args()
    if options.profile:
        profile(options.seconds)
        return 0
    names: dict[Path, str] = {options.against.resolve(): "the other"} if options.against else {}
    names[ROOT] = "this"
    kinds = [options.only] if options.only else list(LEAST)
    found = measure(list(names), kinds, options.seconds, options.runs)
    show(found, names)
    return int(_failed(found))


def _failed(found: dict[tuple[str, Path], list[Run]]) -> bool:
    own: list[tuple[str, Any]] = [(kind, runs) for (kind, root), runs in found.items() if root == ROOT]
    slow = [kind for kind, runs in own if statistics.median(one.factor for one in runs) < LEAST[kind]]
    for kind in slow:
        print(f"FAILED {kind}: the median is below {LEAST[kind]:.0f} times real time")
    return bool(slow)


if __name__ == "__main__":
    sys.exit(main())
