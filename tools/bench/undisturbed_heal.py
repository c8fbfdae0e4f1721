"""Does a healing disturb control? `python tools/bench/undisturbed_heal.py --seconds 20 --turns 6`.

Runs the rig in real time, with the real-time priority that the unit grants, its references moved every three seconds,
and in turns of one run beside it

    heal    `hoopd heal` with a diagnosis of the newest 20 s, from the moment on in which that runs
    dummy   as much work that has nothing to do with it: a process that burns the processor time which the healing
            itself took in the turn before, and one that takes what nobody else wants, as its diagnosis does

Prints execution and lateness of the ticks of each, p50 and p99, and the ratios. Exit code 1 when a ratio is above 1.1,
or when there was nothing to compare: no diagnosis ran.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import processes
import psutil
import zenoh
from undisturbed import (
    HIDDEN,
    SETTLE_S,
    START_S,
    Beside,
    beside_dummy,
    ended,
    figures,
    follow,
    judged,
    used,
)

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from harness.healed_rig import controllers_of  # noqa: E402

from hoopd.shell.session import connecting  # noqa: E402

WINDOW_S, STEP_S = 20.0, 3.0
BEGIN_S = 240.0  # until a diagnosis runs: imports and a cut at low priority on a busy machine
MOVES = (0.1, -0.1, 0.05, -0.05)


class NothingBeganError(Exception):
    """No diagnosis ran within the time there was."""


def line_of(folder: Path, out: Path, endpoint: str) -> list[str]:
    """A healing that looks at once."""
    words = ["heal", "--recordings", str(folder), "--controllers", str(folder / "controllers"), "--connect", endpoint]
    words += ["--window", f"{WINDOW_S:g}", "--every", "1", "--out", str(out)]
    return [sys.executable, "-m", "hoopd", *words, "--set", f"commands.socket={folder / 'hoop.sock'}"]


def diagnosis_of(tree: psutil.Process) -> psutil.Process | None:
    """The diagnosis that it has begun, while it runs."""
    for one in tree.children(recursive=True):
        try:
            if "diagnose" in one.cmdline():
                return one
        except psutil.Error:
            continue
    return None


def beside_heal(
    session: zenoh.Session, kind: Beside, seconds: float, line: list[str], said: Path
) -> tuple[float, dict[str, float]]:
    """One turn beside a healing that diagnoses; cores that it took itself, and what shows that it worked.

    `said`: where its words go.
    """
    with said.open("wb") as log, processes.process(line, stdout=log, stderr=log, start_new_session=True) as child:
        tree = psutil.Process(child.pid)
        end = time.monotonic() + BEGIN_S
        while (job := diagnosis_of(tree)) is None:
            if time.monotonic() > end or child.poll() is not None:
                told = said.read_text("utf-8", "replace").strip().splitlines()
                raise NothingBeganError(f"no diagnosis within {BEGIN_S:g} s ({'; '.join(told[-3:])})")
            time.sleep(0.2)
        time.sleep(SETTLE_S)
        own = psutil.Process(child.pid)
        began, own_s, job_s = time.monotonic(), sum(own.cpu_times()[:2]), used(job)
        follow(session, kind, seconds)
        elapsed = time.monotonic() - began
        cores = (sum(own.cpu_times()[:2]) - own_s) / elapsed
        running = float(job.is_running() and job.status() != psutil.STATUS_ZOMBIE)
        worked = {"diagnoses running": running, "the diagnosis's share of a core, percent": _share(job, job_s, elapsed)}
        ended(child)
    return cores, worked


def _share(job: psutil.Process, before_s: float, elapsed: float) -> float:
    return round(100.0 * (used(job) - before_s) / elapsed, 1)


def measure(folder: Path, seconds: float, turns: int) -> tuple[Beside, Beside, dict[str, float]]:
    """All turns of one run."""
    heal, dummy = Beside(), Beside()
    length = START_S + WINDOW_S + turns * (seconds + 15.0) + (turns + 1) // 2 * BEGIN_S
    moves = (f"{{at_s: {STEP_S * k:g}, name: reference, value: {MOVES[k % len(MOVES)]}}}"
             for k in range(1, int(length / STEP_S)))  # fmt: skip
    sets = (
        HIDDEN, f"sim.commands=[{', '.join(moves)}]", f"commands.socket={folder / 'hoop.sock'}",
        f"control.file={controllers_of(folder) / 'lqg.yaml'}",
    )  # fmt: skip
    words = [word for one in sets for word in ("--set", one)]
    command = processes.daemon_command(
        length, "--camera", "direct", "--record", str(folder), *words, fifo=processes.fifo_granted()
    )
    endpoint = next(part.partition("=")[2] for part in command if part.startswith("telemetry.endpoint="))
    with processes.daemon(command):
        time.sleep(START_S + WINDOW_S)
        with zenoh.open(connecting(endpoint, {}, 5.0)) as session:
            cores, worked = 0.0, dict[str, float]()
            for turn in range(turns):
                if turn % 2:
                    beside_dummy(session, dummy, seconds, cores)
                else:
                    line = line_of(folder, folder / f"healed_{turn}", endpoint)
                    cores, worked = beside_heal(session, heal, seconds, line, folder / f"heal_{turn}.log")
                    print(f"turn {turn + 1}: the healing itself took {cores:.2f} cores; {worked}", flush=True)
    return heal, dummy, worked


def main() -> int:
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each turn")
    parser.add_argument("--turns", type=int, default=6, help="an even number")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        try:
            heal, dummy, worked = measure(Path(name), options.seconds, options.turns)
        except NothingBeganError as error:
            print(f"it does not hold: {error}")
            return 1
    print(f"{'beside':>8} {'ticks':>6} {'execution p50, p99 ms':>22} {'lateness p50, p99 ms':>22}")
    for label, kind in (("heal", heal), ("dummy", dummy)):
        print(f"{label:>8} {len(kind.execution_ms):6} " + " ".join(f"{one:10.3f}" for one in figures(kind)))
    ratios = [a / b for a, b in zip(figures(heal), figures(dummy), strict=True)]
    print(f"{'ratio':>8} {'':6} " + " ".join(f"{one:10.2f}" for one in ratios))
    wrong = judged(heal, dummy, worked, processes.fifo_granted())
    print("every bound holds" if not wrong else f"it does not hold: {', '.join(wrong)}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
