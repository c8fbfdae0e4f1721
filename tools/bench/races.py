"""Races of operators: disarm, stop and SIGTERM win over every arm, whoever sends what in which order.

    python tools/bench/races.py [--races 5000] [--sequences 5000] [--real 200] [--seed 0] [--workers 2] [--json FILE]

Three operators send arm, disarm, stop, clear and reference within a few ticks of each other, while board, line, camera
and host fail; the last race of each run is ended by SIGTERM. `--races` are played in virtual time with the whole
daemon on the rig, `--real` over the unix socket, zenoh and signals against daemons on the machine's clock,
`--sequences` on the tick alone (the property test of harness/sequences.py). Judged by the board's log of torque and
the recorded modes. Exit code 1 when the rule is broken.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

# one thread of linear algebra a process; before numpy is loaded
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

from hypothesis import HealthCheck  # noqa: E402
from processes import cores, progress  # noqa: E402
from racing import live  # noqa: E402
from racing.judge import Outcome  # noqa: E402
from racing.live import Answered  # noqa: E402
from racing.lockstep import run  # noqa: E402
from racing.script import ARMS_ITSELF, SIGTERM  # noqa: E402

RACES_PER_RUN = 10
RUNS_PER_WORKER = 50  # then a fresh process: a daemon's run leaves what it froze behind
QUIET = (HealthCheck.too_slow,)
MODES = {ARMS_ITSELF: "DISARMED"}  # by how a race begins, where that is no mode
SHOWN = 20  # broken races told in full


def played(seed: int, races: int, workers: int) -> list[Outcome]:
    """So many races in virtual time, on so many processes."""
    outcomes: list[Outcome] = []
    runs = list(enumerate(_counts(races)))
    share = RUNS_PER_WORKER * workers
    for first in range(0, len(runs), share):
        # A pool for each share: one that replaces its workers by itself may stand still for good (Python 3.11).
        with ProcessPoolExecutor(workers) as pool:
            waiting = [pool.submit(run, seed + index, count) for index, count in runs[first : first + share]]
            for done in as_completed(waiting):
                outcomes += done.result()
                progress(f"{len(outcomes)} of {races} races in virtual time")
    progress("")
    return sorted(outcomes, key=lambda outcome: outcome.seed)


def raced(seed: int, races: int, workers: int) -> tuple[list[Outcome], list[Answered]]:
    """So many races on the machine's clock, a daemon a run."""
    outcomes: list[Outcome] = []
    answers: list[Answered] = []
    with ProcessPoolExecutor(workers) as pool:
        waiting = [pool.submit(live.run, seed + index, count) for index, count in enumerate(_counts(races))]
        for done in as_completed(waiting):
            run_outcomes, run_answers = done.result()
            outcomes += run_outcomes
            answers += run_answers
            progress(f"{len(outcomes)} of {races} races over real transports")
    progress("")
    return sorted(outcomes, key=lambda outcome: outcome.seed), answers


def _counts(races: int) -> list[int]:
    """Races by run."""
    return [RACES_PER_RUN] * (races // RACES_PER_RUN) + ([races % RACES_PER_RUN] if races % RACES_PER_RUN else [])


def show(title: str, outcomes: Sequence[Outcome], took_s: float) -> None:
    """The table of one kind of races, and what broke the rule."""
    print(f"\n{title}")
    head = (
        "races",
        "as said",
        "commands",
        "arms",
        "obeyed",
        "revoked",
        "disarm",
        "stop",
        SIGTERM,
        "faults",
        "left on",
        "broken",
    )
    print(f"{'begins':<20}" + "".join(f"{name:>9}" for name in head))
    for begins in dict.fromkeys(sorted(outcome.begins for outcome in outcomes)):
        print(_row(begins, [outcome for outcome in outcomes if outcome.begins == begins]))
    print(_row("all", outcomes))
    broken = [(outcome, text) for outcome in outcomes for text in outcome.wrong]
    for outcome, text in broken[:SHOWN]:
        print(f"BROKEN: seed {outcome.seed}, {outcome.begins}: {text}")
    verdict = f"{len(broken)} times broken" if broken else "the rule holds"
    print(f"{len(outcomes)} races, {verdict}, {took_s:.0f} s")


def _row(name: str, outcomes: Sequence[Outcome]) -> str:
    sent = sum((outcome.sent for outcome in outcomes), Counter[str]())
    figures: Iterable[int] = (
        len(outcomes),
        sum(outcome.mode == MODES.get(outcome.begins, outcome.begins.split(",")[0]) for outcome in outcomes),
        sent.total(),
        sent["arm"],
        sum(outcome.obeyed for outcome in outcomes),
        sum(outcome.revoked for outcome in outcomes),
        sent["disarm"],
        sent["stop"],
        sent[SIGTERM],
        sum(outcome.faults for outcome in outcomes),
        sum(outcome.left_on for outcome in outcomes),
        sum(bool(outcome.wrong) for outcome in outcomes),
    )
    return f"{name:<20}" + "".join(f"{figure:>9}" for figure in figures)


def tried(sequences: int, seed: int) -> bool:
    """The property test with so many sequences; whether the rule holds."""
    import hypothesis
    from harness.sequences import SEQUENCE, broken

    count, begun = 0, time.monotonic()

    @hypothesis.seed(seed)
    @hypothesis.settings(max_examples=sequences, deadline=None, database=None, suppress_health_check=QUIET)
    @hypothesis.given(SEQUENCE)
    def holds(sequence: list[tuple[str, int]]) -> None:
        nonlocal count
        count += 1
        if count % 50 == 0:
            progress(f"{count} of {sequences} random sequences on the tick alone")
        assert broken(sequence) == []

    try:
        holds()
        verdict = "the rule holds"
    except AssertionError as error:
        verdict = f"BROKEN: {error}"
    progress("")
    print(f"\n{count} random sequences on the tick alone, {verdict}, {time.monotonic() - begun:.0f} s")
    return verdict == "the rule holds"


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--races", type=int, default=5000, help="races in virtual time")
    parser.add_argument("--sequences", type=int, default=0, help="random sequences on the tick alone")
    parser.add_argument("--real", type=int, default=0, help="races over real transports")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=cores())
    parser.add_argument("--json", type=Path, help="write every race to this file")
    options = parser.parse_args()
    parts: dict[str, list[Outcome]] = {}
    fine = True
    if options.sequences:
        fine = tried(options.sequences, options.seed)
    if options.races:
        begun = time.monotonic()
        title = "virtual time, the whole daemon on the rig"
        parts[title] = played(options.seed, options.races, options.workers)
        show(title, parts[title], time.monotonic() - begun)
    if options.real:
        begun = time.monotonic()
        title = "the machine's clock, real transports"
        parts[title], answers = raced(options.seed, options.real, options.workers)
        show(title, parts[title], time.monotonic() - begun)
        print("\n".join(live.counted(answers)))
    if options.json:
        options.json.write_text(json.dumps({k: [o._asdict() for o in v] for k, v in parts.items()}, indent=1))
    return int(not fine or any(outcome.wrong for outcomes in parts.values() for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
