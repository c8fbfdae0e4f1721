"""Hours beside a load: is the daemon on time, and if not, who kept it? Every missed tick gets an owner.

    python tools/bench/soak.py [--minutes 40] [--load 8] [--nice 0] [--ordinary] [--direct] [--bound 0] [--json FILE]

Runs `hoopd --sim` in real time, as the service does (FIFO 50, memory locked; `--ordinary`: without), beside so many
processes that want a core each at this niceness. Two observers with FIFO 90 watch: the witness (witness.py), which sees
a core stand still, and a follower of the kernel's accounts of the loop's thread (soaking/follower.py): what it ran,
and how long it could have run and did not. The rule by which missed ticks and executions above 20 ms go to rig,
machine or daemon stands in soaking/attribution.py. Whatever else this machine does adds to the load. Exit code 1 when
more ticks than `--bound` are the daemon's.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import processes
from processes import HERE, ROOT

sys.path.insert(0, str(ROOT))

from realtime import quantiles
from rich.console import Console
from rich.table import Table
from soaking import accounts, attribution
from soaking.accounts import Accounts
from soaking.attribution import OWNERS, Long, Missed, Span, split

from hoopd.core.records import TickRecord
from hoopd.recording.mcap import read_run
from hoopd.shell.loop import COLLECT_EVERY
from hoopd.shell.service import granted_realtime

PERIOD_S = 0.02
LONG_S = 0.02
SHOWN = 12  # rows of each list; the counts are of all
MOST_MINUTES = 240.0  # the follower keeps its rows in memory: 22 kB/s
ALONE_S = 4.0  # before the load begins: imports, the first pictures, the first arm
ARMED_EVERY_S = 10.0
PATIENCE_S = 120.0  # an ordinary process beside the load takes long to end
ERRORS = "errors.log"


class Soak(NamedTuple):
    """What one run gave."""

    granted: str
    summary: dict[str, Any]
    faults: dict[str, int]  # after the first arm: before it the rig still starts, beside the load
    ticks: list[TickRecord]
    accounts: Accounts
    missed: list[Missed]
    long: list[Long]
    unwatched: int  # ticks missed before the follower looked
    steal_share: float  # of all cores' time, as the hypervisor reports it
    others_share: float  # of all cores' time: neither daemon, rig nor idle


def soak(seconds: float, load: int, nice: int, *, fifo: bool, direct: bool) -> Soak:
    """Run it to its end and judge it."""
    with tempfile.TemporaryDirectory(prefix="hoopd-soak-") as name:
        folder = Path(name)
        with processes.witness(folder / "witness.json"):
            before = processor_times()
            granted = _run(folder, seconds, processes.busy_processes(load, nice), fifo=fifo, direct=direct)
            spent = Counter(processor_times())
            spent.subtract(before)
        return judge(folder, granted, spent)


def _run(folder: Path, seconds: float, load: AbstractContextManager[None], *, fifo: bool, direct: bool) -> str:
    """The daemon with its follower, after a few seconds with the load; what the kernel granted the loop."""
    command = processes.daemon_command(
        seconds,
        *("--record", str(folder), "--json", str(folder / "summary.json"), "--set", f"sim.directory={folder}"),
        *("--set", f"sim.commands={operator(seconds)}"),
        *(("--camera", "direct") if direct else ()),
        fifo=fifo,
    )
    errors = folder / ERRORS
    with errors.open("wb") as log, processes.daemon(command, log) as child, following(child.pid, folder / "accounts"):
        granted = _granted(child, min(ALONE_S, seconds / 2))
        with load:
            processes.wait_for(child, seconds, PATIENCE_S)
    if child.returncode:
        raise RuntimeError(f"the daemon ended with code {child.returncode}: {errors.read_text()[-500:]}")
    return granted


def operator(seconds: float) -> str:
    """One who clears what a load did to the rig, and arms again: a soak in FAULT would show little."""
    times = range(round(ARMED_EVERY_S), int(seconds - ARMED_EVERY_S), round(ARMED_EVERY_S))
    commands = [f"{{at_s: {t}, name: clear}}, {{at_s: {t + 1}, name: arm}}" for t in times]
    return f"[{', '.join(commands)}]"


@contextmanager
def following(pid: int, out: Path) -> Iterator[None]:
    """The follower of this process; its file is there after the block."""
    command = [sys.executable, "-S", str(HERE / "soaking" / "follower.py"), str(pid), str(out)]
    with processes.process(command, stdin=subprocess.PIPE):
        yield


def _granted(child: subprocess.Popen[bytes], after_s: float) -> str:
    try:
        child.wait(after_s)  # chrt has become the daemon by then
    except subprocess.TimeoutExpired:
        facts = granted_realtime(child.pid)
        return f"{facts['policy']} {facts['priority']}, memory {'locked' if facts['locked_bytes'] else 'not locked'}"
    return "ended early"


def processor_times() -> dict[str, float]:
    """Time of all cores since the boot, by kind (proc(5), /proc/stat), in ticks of the kernel's clock."""
    words = Path("/proc/stat").read_text(encoding="ascii").splitlines()[0].split()[1:]
    names = ("user", "nice", "system", "idle", "iowait", "irq", "softirq", "steal")
    return dict(zip(names, map(float, words), strict=False))


def judge(folder: Path, granted: str, spent: Counter[str]) -> Soak:
    """Every gap and every long execution with its parts."""
    summary = json.loads((folder / "summary.json").read_text())
    watchers = json.loads((folder / "witness.json").read_text())["watchers"]
    kept = accounts.read(folder / "accounts", watchers)
    # The first tick comes whenever start-up is done, not at its deadline.
    paths = sorted(folder.glob("run-*.mcap"))
    ticks = [tick for path in paths for tick in read_run(path, ("tick",)).ticks][1:]
    start, watched_from = float(summary["start_monotonic_s"]), kept.span[0]
    watched = [tick for tick in ticks if start + tick.t >= watched_from]
    everything = sum(spent.values()) or 1.0
    begin, end = kept.span
    mine = kept.grown("loop_run_s", begin, end) + kept.grown("helpers_run_s", begin, end)
    mine += kept.grown("rig_run_s", begin, end)
    busy = everything - spent["idle"] - spent["iowait"]
    return Soak(
        granted=granted,
        summary=summary,
        faults=faults_once_armed(folder / ERRORS),
        ticks=watched,
        accounts=kept,
        missed=find_missed(watched, start, kept),
        long=find_long(watched, start, kept),
        unwatched=sum(b.id - a.id - 1 for a, b in itertools.pairwise(ticks) if start + a.t < watched_from),
        steal_share=spent["steal"] / everything,
        others_share=max(0.0, busy / everything - mine / ((end - begin) * processes.cores())),
    )


def faults_once_armed(log: Path) -> dict[str, int]:
    """Fault -> times, of the daemon's log from its first RUNNING on."""
    facts = [json.loads(line) for line in log.read_text().splitlines() if line.startswith("{")]
    armed = itertools.dropwhile(lambda fact: fact.get("mode") != "RUNNING", facts)
    return dict(Counter(fact["fault"] for fact in armed if fact["event"] == "fault"))


def find_missed(ticks: list[TickRecord], start: float, kept: Accounts) -> list[Missed]:
    """Where the tick's number jumps; `start`: monotonic time of run time zero."""
    return [
        Missed(a.t, b.id - a.id - 1, split(kept, _late_span(a, b, start)), a.id % COLLECT_EVERY == 0)
        for a, b in itertools.pairwise(ticks)
        if b.id > a.id + 1
    ]


def _late_span(a: TickRecord, b: TickRecord, start: float) -> Span:
    """From a tick to the next that came; asleep was right only after its frame was written and before the deadline."""
    deadline = (a.id + 1) * PERIOD_S
    overrun = a.t + a.execution_s > deadline
    return Span(start + a.t, start + (a.t if overrun else deadline), start + b.t)


def find_long(ticks: list[TickRecord], start: float, kept: Accounts) -> list[Long]:
    """Executions (slots taken to frame written) above the limit."""
    spans = [(tick, start + tick.t) for tick in ticks if tick.execution_s > LONG_S]
    return [Long(tick.t, tick.execution_s, split(kept, Span(t, t, t + tick.execution_s))) for tick, t in spans]


def shares(missed: Iterable[Missed]) -> dict[str, int]:
    """Owner -> missed ticks."""
    counts = dict.fromkeys(OWNERS, 0)
    for gap in missed:
        for owner, count in gap.shares(PERIOD_S).items():
            counts[owner] += count
    return counts


def figures(found: Soak) -> dict[str, Any]:
    """Everything that is printed, by name."""
    counts, owners = shares(found.missed), Counter(item.parts.owner for item in found.long)
    faults = ", ".join(f"{name} x{count}" for name, count in found.faults.items())
    return {
        "loop": found.granted,
        "ticks": len(found.ticks),
        "missed": sum(counts.values()),
        **{f"missed, {owner}'s": counts[owner] for owner in OWNERS},
        "missed as the daemon counted": found.summary["missed"],
        "missed before anybody watched": found.unwatched,
        "longest gap, ticks": max((gap.count for gap in found.missed), default=0),
        "executions above 20 ms": len(found.long),
        **{f"executions above 20 ms, {owner}'s": owners[owner] for owner in OWNERS},
        "lateness ms, p50 / p99 / max": quantiles([tick.lateness_s for tick in found.ticks]),
        "execution ms, p50 / p99 / max": quantiles([tick.execution_s for tick in found.ticks]),
        "RUNNING, s": found.summary["running_s"],
        "faults once armed": faults or "none",
        "cores stood still, % of the run": 100.0 * found.accounts.still_s(*found.accounts.span) / _length(found),
        "hypervisor took, % of the cores": 100.0 * found.steal_share,
        "others took, % of the cores": 100.0 * found.others_share,
    }


def _length(found: Soak) -> float:
    begin, end = found.accounts.span
    return end - begin


PARTS = ("still", "waited", "rig", "timer", "interpreter_waited", "interpreter", "fetching", "asleep", "work")


def show(found: Soak, title: str) -> None:
    """The figures, then the worst gaps and executions part by part."""
    table = Table("", "", title=title)
    for name, value in figures(found).items():
        table.add_row(name, shown(value))
    console = Console(width=None if sys.stdout.isatty() else 160)
    console.print(table)
    gaps = sorted(found.missed, key=lambda gap: -gap.count)
    console.print(
        part_table(
            f"gaps: the longest of {len(gaps)}, parts in ms",
            [(f"{gap.t:.2f}", f"{gap.count} missed{', gc' * gap.collection}", gap.parts) for gap in gaps[:SHOWN]],
        )
    )
    longest = sorted(found.long, key=lambda item: -item.seconds)
    console.print(
        part_table(
            f"executions above 20 ms: the longest of {len(longest)}, parts in ms",
            [(f"{item.t:.2f}", f"{1e3 * item.seconds:.1f} ms", item.parts) for item in longest[:SHOWN]],
        )
    )


def part_table(title: str, rows: list[tuple[str, str, attribution.Parts]]) -> Table:
    """Rows of parts in ms."""
    names = (name.replace("_", " ") for name in PARTS)
    table = Table("at s", "what", "owner", *names, "asleep in call", "page faults", title=title)
    for t, what, parts in rows:
        faults = f"{parts.faults_minor} + {parts.faults_disk}"
        table.add_row(
            t, what, parts.owner, *(f"{1e3 * getattr(parts, name):.1f}" for name in PARTS), parts.calls, faults
        )
    return table


def shown(value: Any) -> str:
    """A figure for the table."""
    if isinstance(value, tuple):
        return " / ".join(f"{part:.3f}" for part in value)
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def main() -> int:
    """Run, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=40.0)
    parser.add_argument("--load", type=int, default=8, help="processes that want a core each")
    parser.add_argument("--nice", type=int, default=0, help="their niceness, 0 to 19")
    parser.add_argument("--ordinary", action="store_true", help="the daemon without real-time priority")
    parser.add_argument("--direct", action="store_true", help="without pictures")
    parser.add_argument("--bound", type=int, default=0, help="missed ticks that may be the daemon's")
    parser.add_argument("--json", type=Path, help="also write the figures here")
    options = parser.parse_args()
    if not 0.0 < options.minutes <= MOST_MINUTES:
        parser.error(f"--minutes: above 0, up to {MOST_MINUTES:g}")
    fifo = not options.ordinary and processes.fifo_granted()
    if not fifo and not options.ordinary:
        print("FIFO priority is not granted here: the daemon runs without, and so do both observers")
    found = soak(60.0 * options.minutes, options.load, options.nice, fifo=fifo, direct=options.direct)
    load = f"{options.load} busy processes (nice {options.nice})"
    show(found, f"{options.minutes:g} min beside {load}, {processes.cores()} cores")
    if options.json:
        options.json.write_text(json.dumps(figures(found), indent=2))
    daemons = shares(found.missed)["daemon"]
    held = daemons <= options.bound
    print(f"{'ok' if held else 'FAILED'}: {daemons} missed ticks are the daemon's, bound {options.bound}")
    return int(not held)


if __name__ == "__main__":
    sys.exit(main())
