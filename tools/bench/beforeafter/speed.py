"""How long two checkouts take for the same work, in turns: lock-step, a tick, a fit, a diagnosis.

Rules of this file: every measurement is a fresh process; the recording that both read is made once, by the earlier one;
all of this is one thread of arithmetic, so the processor's time is its duration on a free core and is what is judged;
the clock's, in which a busy machine is inside, stands beside it.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from beforeafter import ratios, trees

RECORDING = "before.mcap"
PROBE = Path(__file__).with_name("tickprobe.py")
KEPT = trees.ROOT / "tests" / "data" / "before_the_move"
REPLAYED = ("02-pid-thesis.mcap", "07-late-pictures.mcap")
QUIET = ("--set", "telemetry.enabled=false", "--set", "commands.enabled=false", "--set", "log.level=error")
RIG = ("--sim", "--speed", "max", "--camera", "direct", *QUIET)
Say = Callable[[str], None]


class Taken(NamedTuple):
    """What one process took."""

    clock_s: float
    cpu_s: float


class Compared(NamedTuple):
    """One kind of work: medians of both by the processor's time, and the ratio after / before."""

    name: str
    before_s: float
    after_s: float
    cpu: ratios.Ratio
    clock: ratios.Ratio


def prepare(tree: Path, work: Path) -> None:
    """The recording for fit and diagnosis: an experiment of 20 s on a rig with dry friction."""
    hidden = "sim.effects=[{name: hoop.coulomb_friction, parameters: {Fc: 0.006}}]"
    trees.hoopd(
        tree, ["experiment", "prbs", *RIG, "--set", hidden, "--seed", "5", "--out", str(work / RECORDING)], work
    )


def lockstep(tree: Path, work: Path) -> Taken:
    """A minute of the daemon in virtual time; the loop alone, start-up left out."""
    out = work / "summary.json"
    trees.hoopd(tree, [*RIG, "--duration", "60", "--record", str(_emptied(work / "runs")), "--json", str(out)], work)
    summary = json.loads(out.read_text())
    return Taken(summary["seconds"] / summary["real_time_factor"], summary["cpu_s"])


def tick(tree: Path, work: Path) -> Taken:
    """Median of `Tick.step` over recorded inputs that both replay to the same bits."""
    out = work / "tick.json"
    trees.python(tree, [str(PROBE), str(out), *(str(KEPT / name) for name in REPLAYED)], work)
    found = json.loads(out.read_text())
    return Taken(found["clock_s"], found["cpu_s"])


def fit(tree: Path, work: Path) -> Taken:
    """`hoopd fit`, the whole process."""
    return Taken(*trees.hoopd(tree, ["fit", RECORDING, "--json", "fit.json"], work))


def diagnosis(tree: Path, work: Path) -> Taken:
    """`hoopd diagnose`, the whole process."""
    return Taken(*trees.hoopd(tree, ["diagnose", RECORDING, "--no-free-run", "--json", "diagnosis.json"], work))


WORK: Mapping[str, Callable[[Path, Path], Taken]] = {
    "lockstep": lockstep,
    "tick": tick,
    "fit": fit,
    "diagnosis": diagnosis,
}


def compare(before: Path, after: Path, name: str, pairs: int, work: Path, say: Say) -> Compared:
    """`pairs` times before, after, before, after; one of each first that does not count (files in memory, bytecode)."""
    measured: list[tuple[Taken, Taken]] = []
    for turn in range(pairs + 1):
        say(f"{name}, pair {turn} of {pairs}")
        pair = (WORK[name](before, work), WORK[name](after, work))
        measured += [pair] if turn else []
    old, new = zip(*measured, strict=True)
    cpu = ratios.paired([one.cpu_s for one in old], [one.cpu_s for one in new])
    clock = ratios.paired([one.clock_s for one in old], [one.clock_s for one in new])
    before_s, after_s = (statistics.median(one.cpu_s for one in side) for side in (old, new))
    return Compared(name, before_s, after_s, cpu, clock)


def _emptied(folder: Path) -> Path:
    """A folder without the runs of before."""
    folder.mkdir(exist_ok=True)
    for path in folder.glob("run-*.mcap"):
        path.unlink()
    return folder
