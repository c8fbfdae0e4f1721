"""Attacks from the same machine: what each costs the loop, the daemon's memory and an operator who wants to disarm.

    python tools/bench/attacks.py [--only NAME ...] [--seconds 5] [--peers 2] [--json FILE]

For every row a daemon controls the simulated rig on the machine's clock, is left alone for `--seconds`, then attacked
for as long by so many processes; meanwhile an operator sets the reference twice a second through the command socket,
and disarms at the end. Missed ticks are counted from the recording; those beside a gap of the witness's own clock are
the machine's. Exit code 1 when the loop missed a tick of its own, the daemon grew by more than 64 MB, or a disarm was
not obeyed within a second.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

from attacking.attacks import ATTACKS  # noqa: E402
from harness.realrun import ENVIRONMENT, Daemon, fifo_granted, gaps_in, zero_of  # noqa: E402
from harness.runs import Run  # noqa: E402
from harness.witness import Witness  # noqa: E402
from processes import process, progress  # noqa: E402

from hoopd.shell.operator import CommandError  # noqa: E402

ALONE = "nobody"
GROWTH_BYTES, OBEYED_S = 64 * 10**6, 1.0
ASK_EVERY_S = 0.5
BESIDE_S = 0.2  # a gap of the machine so long before a tick may have delayed it
REFERENCE = [{"at_s": 1.8, "name": "reference", "value": 0.1}]  # keeps the motor busy
WRAPPER = "import sys; from attacking.attacks import ATTACKS; ATTACKS[sys.argv[1]](sys.argv[2], sys.argv[3])"


class Row(NamedTuple):
    """What an attack cost."""

    attack: str
    missed: int  # ticks, those of the machine left out
    missed_machine: int
    lateness_ms: float  # 99.9 % of ticks
    execution_ms: float  # the same
    grown_bytes: int
    descriptors: int  # most of the daemon
    answer_ms: float  # the slowest answer to an operator
    unanswered: int  # of the operator's references
    disarmed_ms: float  # until the answer; inf when none came

    @property
    def fine(self) -> bool:
        """The loop held, in its bounds, and obeyed."""
        return self.missed == 0 and self.grown_bytes <= GROWTH_BYTES and self.disarmed_ms <= OBEYED_S * 1e3


class Watch:
    """The most memory and descriptors that the daemon had, looked for fifty times a second."""

    def __init__(self, pid: int) -> None:
        self._process, self._done = psutil.Process(pid), threading.Event()
        self.memory = self.descriptors = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._done.wait(0.02):
            try:
                self.memory = max(self.memory, self._process.memory_info().rss)
                self.descriptors = max(self.descriptors, self._process.num_fds())
            except psutil.Error:
                return

    def close(self) -> None:
        """Look no more."""
        self._done.set()
        self._thread.join()


@contextmanager
def attacked(name: str, daemon: Daemon, peers: int) -> Iterator[None]:
    """So many processes of an attack, ended with the block."""
    command = [sys.executable, "-c", WRAPPER, name, daemon.endpoint, str(daemon.socket)]
    environment = {**ENVIRONMENT, "PYTHONPATH": f"{ENVIRONMENT['PYTHONPATH']}:{ROOT / 'tools' / 'bench'}"}
    quiet = {"stderr": subprocess.DEVNULL, "env": environment}
    with ExitStack() as stack:
        for _ in range(peers if name in ATTACKS else 0):
            stack.enter_context(process(command, **quiet))
        yield


def tried(name: str, seconds: float, peers: int) -> Row:
    """One daemon, one attack."""
    with tempfile.TemporaryDirectory(prefix="hoopd-attack-") as scratch, ExitStack() as stack:
        folder = Path(scratch)
        witness = stack.enter_context(Witness(folder / "gaps.txt"))
        daemon = stack.enter_context(Daemon(folder, fifo=fifo_granted(), commands=REFERENCE))
        daemon.wait_running()
        before = psutil.Process(daemon.process.pid).memory_info().rss
        time.sleep(seconds)
        watch, start, answers = Watch(daemon.process.pid), time.monotonic(), []
        with attacked(name, daemon, peers):
            while time.monotonic() < start + seconds:
                answers.append(_answered(daemon, "reference", value=0.1))
                time.sleep(ASK_EVERY_S)
            stop = time.monotonic()
            disarmed_s = _answered(daemon, "disarm")
        watch.close()
        daemon.stop()
        run = daemon.result()
        zero = zero_of(run)
        alone, machine = _missed(run, witness, start, stop, zero)
        ticks = [tick for tick in run.ticks if start - zero <= tick.t <= stop - zero]
    answered = [s for s in answers if s < float("inf")]
    return Row(
        name,
        alone,
        machine,
        1e3 * float(np.quantile([tick.lateness_s for tick in ticks], 0.999)),
        1e3 * float(np.quantile([tick.execution_s for tick in ticks], 0.999)),
        max(0, watch.memory - before),
        watch.descriptors,
        1e3 * max(answered, default=float("inf")),
        len(answers) - len(answered),
        1e3 * disarmed_s,
    )


def _missed(run: Run, witness: Witness, start: float, stop: float, zero: float) -> tuple[int, int]:
    """Missed ticks of the loop and of the machine."""
    gaps = gaps_in(run, start - zero, stop - zero)
    machine = [n for t, n in gaps if witness.gaps(zero + t - BESIDE_S, zero + t)]
    return sum(n for _, n in gaps) - sum(machine), sum(machine)


def _answered(daemon: Daemon, name: str, **fields: float) -> float:
    """Seconds until a command was obeyed; inf when it was not."""
    begun = time.monotonic()
    try:
        daemon.command(name, **fields)
    except CommandError:
        return float("inf")
    return time.monotonic() - begun


def show(rows: list[Row]) -> None:
    """The table."""
    head = ("missed", "machine's", "late ms", "exec ms", "grown MB", "descr.", "answer ms", "without", "disarm ms")
    print(f"\n{'attack':<18}" + "".join(f"{name:>11}" for name in head))
    for row in rows:
        _, missed, machine, late, execution, grown, descriptors, answer, without, disarmed = row
        cells = (missed, machine, f"{late:.2f}", f"{execution:.2f}", f"{grown / 1e6:.1f}", descriptors)
        cells += (f"{answer:.0f}", without, f"{disarmed:.0f}")
        print(f"{row.attack:<18}" + "".join(f"{cell:>11}" for cell in cells) + ("" if row.fine else "   FAILED"))


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=list(ATTACKS), metavar="NAME", help="these attacks")
    parser.add_argument("--seconds", type=float, default=5.0, help="of each attack")
    parser.add_argument("--peers", type=int, default=2, help="processes that attack")
    parser.add_argument("--json", type=Path, help="write every row to this file")
    options = parser.parse_args()
    rows = []
    for name in (ALONE, *(options.only or ATTACKS)):
        progress(f"{name}: {len(rows) + 1} of {1 + len(options.only or ATTACKS)}")
        rows.append(tried(name, options.seconds, options.peers))
    progress("")
    show(rows)
    if options.json:
        options.json.write_text(json.dumps([row._asdict() for row in rows], indent=1))
    return int(not all(row.fine for row in rows))


if __name__ == "__main__":
    sys.exit(main())
