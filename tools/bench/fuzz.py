"""Bad input of every kind: one line and exit code 2, within bounds; never a traceback, never all the memory.

    python tools/bench/fuzz.py [--cases 20000] [--processes 500] [--seed 0] [--workers 2] [--json FILE]
    python tools/bench/fuzz.py [...] --kinds "plant file" columns             # these kinds alone: other cases
    python tools/bench/fuzz.py --case 1234 | --process 17 [--keep FOLDER]     # one of them again, with its traceback

Sound files of every kind are spoiled by bits, words, trees and from within their containers; configuration keys and
commands' options come from the program's own types. `--cases` run in worker processes with a limit on memory and an
alarm, `--processes` as programs of their own. Refused input is one line, at most 300 MB and 5 s of the processor.
Exit code 1 on anything unforeseen or beyond the bounds.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import multiprocessing
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

# one thread of linear algebra a process; before numpy is loaded
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

import hoopd.commands.cli  # noqa: E402  (first: it sets what OpenCV may take)

from fuzzing import cases, inprocess, outcome, sound, whole  # noqa: E402  # isort: skip
from fuzzing.outcome import Outcome  # noqa: E402  # isort: skip
from processes import cores, progress  # noqa: E402  # isort: skip

SHOWN = 40  # findings told in full
CASES_PER_WORKER = 250  # then a fresh process: what cases left behind does not add up
PATIENCE_S = 120.0  # of a machine under load, for a case that does not even answer its alarm


class Worker:
    """A process that tries cases, and another one when it ended."""

    def __init__(self, seed: str, sounds: Path, kinds: tuple[str, ...]) -> None:
        self._about, self._tried = (seed, sounds, kinds), 0
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["fuzzing.warmed"])
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=inprocess.serve, args=(theirs, *self._about), daemon=True)
        self._process.start()
        theirs.close()
        self._pipe.recv()  # it is warm
        self._tried = 0

    def attempt(self, number: int) -> Outcome:
        """One case, whatever it does to the process."""
        if self._tried >= CASES_PER_WORKER:
            self.close()
            self._start()
        self._tried += 1
        try:
            self._pipe.send(number)
            if self._pipe.poll(PATIENCE_S):
                found: Outcome = self._pipe.recv()
                return found
            why = "hangs, and answers no alarm"
        except (EOFError, OSError):
            self._process.join(10)
            why = f"ended the process with exit code {self._process.exitcode}"
        self._process.kill()
        self._process.join()
        self._start()
        return Outcome(number, "(dead)", outcome.BEYOND, 0.0, 0.0, why)

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(OSError):
            self._pipe.send(None)
        self._process.join(5)
        self._process.kill()
        self._process.join()


def tried_inside(
    seed: str, sounds: Path, kinds: tuple[str, ...], numbers: range, workers: int, minutes: float
) -> list[Outcome]:
    """Cases in worker processes."""
    own = threading.local()
    made: list[Worker] = []

    def attempt(number: int) -> Outcome:
        if not hasattr(own, "worker"):
            own.worker = Worker(seed, sounds, kinds)
            made.append(own.worker)
        found: Outcome = own.worker.attempt(number)
        return found

    try:
        return _counted(attempt, numbers, workers, "cases", minutes)
    finally:
        for worker in made:
            worker.close()


def _counted(
    attempt: Callable[[int], Outcome], numbers: range, workers: int, what: str, minutes: float
) -> list[Outcome]:
    outcomes: list[Outcome] = []
    end = time.monotonic() + 60.0 * minutes
    with ThreadPoolExecutor(workers) as pool:
        for found in pool.map(lambda number: attempt(number) if time.monotonic() < end else None, numbers):
            if found is None:
                continue
            outcomes.append(found)
            if found.verdict in (outcome.UNFORESEEN, outcome.BEYOND):
                print(
                    f"{what} {found.number} ({found.kind}) {found.verdict}: {found.told}", file=sys.stderr, flush=True
                )
            if len(outcomes) % 20 == 0:
                progress(f"{len(outcomes)} of {len(numbers)} {what}")
    progress("")
    return outcomes


def show(title: str, outcomes: list[Outcome], took_s: float) -> None:
    """The table by kind, and what was found."""
    print(f"\n{title}")
    verdicts = (outcome.REFUSED, outcome.ACCEPTED, outcome.UNFORESEEN, outcome.BEYOND)
    print(
        f"{'kind':<18}{'cases':>8}" + "".join(f"{name:>12}" for name in verdicts) + f"{'worst s':>10}{'worst MB':>10}"
    )
    for kind in [*dict.fromkeys(sorted(one.kind for one in outcomes)), "all"]:
        rows = [one for one in outcomes if kind in (one.kind, "all")]
        counts = [sum(one.verdict == verdict for one in rows) for verdict in verdicts]
        judged = [one for one in rows if one.verdict != outcome.ACCEPTED] or rows
        worst = f"{max(one.seconds for one in judged):>10.2f}{max(one.megabytes for one in judged):>10.0f}"
        print(f"{kind:<18}{len(rows):>8}" + "".join(f"{count:>12}" for count in counts) + worst)
    for one in wrong(outcomes)[:SHOWN]:
        print(f"{one.verdict.upper()}: {one.number} ({one.kind}): {one.told}")
    print(f"{len(outcomes)} cases, {len(wrong(outcomes))} unforeseen or beyond the bounds, {took_s:.0f} s")


def wrong(outcomes: list[Outcome]) -> list[Outcome]:
    """What should not have come."""
    return [one for one in outcomes if one.verdict in (outcome.UNFORESEEN, outcome.BEYOND)]


@contextlib.contextmanager
def sound_files() -> Iterator[Path]:
    """A folder with a sound file of every kind."""
    with tempfile.TemporaryDirectory(prefix="hoopd-fuzz-sound-") as folder:
        sound.make(Path(folder))
        yield Path(folder)


def again(options: argparse.Namespace, sounds: Path) -> int:
    """One case, told in full: its files stay in a folder, its traceback comes out."""
    whole_process = options.process is not None
    number = options.process if whole_process else options.case
    folder = options.keep or Path(tempfile.mkdtemp(prefix="hoopd-fuzz-case-"))
    folder.mkdir(parents=True, exist_ok=True)
    case = cases.make(str(options.seed), number, sounds, folder, whole=whole_process, kinds=tuple(options.kinds))
    print(f"{case.kind}, in {folder}: hoopd {' '.join(case.arguments)[:2000]}")
    if whole_process:
        print(whole.try_case(str(options.seed), number, sounds, tuple(options.kinds)))
        return 0
    os.chdir(folder)
    hoopd.commands.cli.app(case.arguments, standalone_mode=False)
    return 0


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=20_000, help="cases in worker processes")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--processes", type=int, default=500, help="cases as programs of their own")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="of either part at most: fewer cases then")
    parser.add_argument("--kinds", nargs="*", choices=tuple(cases.SHARES), default=tuple(cases.SHARES), metavar="KIND")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=cores())
    parser.add_argument("--case", type=int, help="try this case again")
    parser.add_argument("--process", type=int, help="try this case as a program again")
    parser.add_argument("--keep", type=Path, help="where the files of --case and --process go")
    parser.add_argument("--json", type=Path, help="write every outcome to this file")
    options = parser.parse_args()
    parts: dict[str, list[Outcome]] = {}
    with sound_files() as sounds:
        if options.case is not None or options.process is not None:
            return again(options, sounds)
        if options.cases:
            begun, title = time.monotonic(), "in worker processes (MB: added by the case)"
            numbers = range(options.first, options.first + options.cases)
            parts[title] = tried_inside(
                str(options.seed), sounds, tuple(options.kinds), numbers, options.workers, options.minutes
            )
            show(title, parts[title], time.monotonic() - begun)
        if options.processes:
            begun, title = time.monotonic(), "as programs of their own (MB: all of it)"

            def attempt(number: int) -> Outcome:
                return whole.try_case(str(options.seed), number, sounds, tuple(options.kinds))

            parts[title] = _counted(attempt, range(options.processes), options.workers, "programs", options.minutes)
            show(title, parts[title], time.monotonic() - begun)
    if options.json:
        options.json.write_text(json.dumps({title: [one._asdict() for one in all_] for title, all_ in parts.items()}))
    return int(any(wrong(outcomes) for outcomes in parts.values()))


if __name__ == "__main__":
    sys.exit(main())
