"""False alarms: hours in which nothing is broken, on rigs that are not as the model says.

    python tools/bench/false_alarms.py [--minutes 120] [--seed 0] [--workers N] [--only EFFECT ...] [--json FILE]

Ten rigs, whose parameters are off in random directions, the worst of each by 30 %; the filter, the laws and the
thresholds are the shipped ones. Every effect of the library is hidden once, on one of the rigs, and nothing on each rig
once more. Each is watched in three ways, in equal parts: at rest (reference 0, after a release from 0.4 rad), with
references as a laboratory gives them (steps, stairs, a sine, held angles) under the shipped laws that hold the ball,
and with the test signals of `hoopd experiment`. One picture in twenty is missing, in half of the cases because it never
came, in the other because it shows no ball. Everything in virtual time; exit code 1 when a row that judges what sensors
say is raised, but for the exceptions that the table shows as such (`honestrigs.rigs.RIGHT`). Others are told, too:
`ball_implausible`, the filter's own test of the ball, may end a test signal on a rig that is far from its model.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import TextIO

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the processes share the cores
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

from honestrigs.rigs import HIDDEN, OFF, RIGHT, RIGS, UNHIDEABLE, off_by  # noqa: E402
from honestrigs.watching import WAYS, Hour, Seen, spend  # noqa: E402
from lockstepruns import JUDGING, be_hasty  # noqa: E402
from processes import cores, progress  # noqa: E402


def hours(minutes: float, seed: int, only: Sequence[str] | None = None) -> list[Hour]:
    """What is watched: effects in turn over the rigs, each in every way, for equal times."""
    slots = [(k, name) for k, name in enumerate([*HIDDEN, *[""] * RIGS]) if only is None or (name or "nothing") in only]
    seconds = 60.0 * minutes / (len(slots) * len(WAYS))
    return [Hour(k, k % RIGS, name, way, seconds, seed) for k, name in slots for way in WAYS]


def watched(todo: Sequence[Hour], workers: int, log: TextIO | None = None, *, hasty: bool = False) -> list[Seen]:
    """All of them, on so many processes; each is written to the log as soon as it is seen."""
    seen: list[Seen] = []
    begin = be_hasty if hasty else None
    with ProcessPoolExecutor(workers, initializer=begin) as pool:
        for done in as_completed([pool.submit(spend, one) for one in todo]):
            seen.append(done.result())
            if log is not None:
                log.write(json.dumps({**seen[-1].hour._asdict(), **seen[-1]._replace(hour=None)._asdict()}) + "\n")
                log.flush()
            raised = sum(len(one.alarms) for one in seen)
            progress(
                f"{sum(one.seconds for one in seen) / 60:.1f} minutes, {len(seen)} of {len(todo)}, {raised} raised"
            )
    progress("")
    return sorted(seen, key=lambda one: todo.index(one.hour))


def show(seen: Sequence[Seen]) -> None:
    """A line for each effect on its rig, then one for each rig."""
    print(f"{'hidden':<26}{'rig':>4}{'watched':>9}{'acting':>8}  " + "".join(f"{way:<12}" for way in WAYS) + "others")
    for slot in dict.fromkeys(one.hour.slot for one in seen):
        mine = [one for one in seen if one.hour.slot == slot]
        verdicts = {one.hour.way: ", ".join(_times(one)) or "none" for one in mine}
        print(
            f"{mine[0].hour.effect or 'nothing':<26}{mine[0].hour.rig:>4}"
            f"{sum(one.seconds for one in mine):>7.0f} s{sum(one.acting_s for one in mine):>6.0f} s  "
            + "".join(f"{verdicts.get(way, '-'):<10}  " for way in WAYS)
            + _others(mine)
        )
    print()
    for rig in sorted({one.hour.rig for one in seen}):
        mine = [one for one in seen if one.hour.rig == rig]
        off = ", ".join(f"{name} {100 * value:+.0f} %" for name, value in off_by(rig).items())
        ended = sum(len(one.alarms) for one in mine)
        print(f"rig {rig}: {sum(one.seconds for one in mine):5.0f} s, {ended} raised; {off}")
    if UNHIDEABLE:
        print(f"not hidden, because no rig can: {', '.join(UNHIDEABLE)}")


def _times(one: Seen) -> list[str]:
    right = RIGHT.get(one.hour.effect, ())
    return [f"{raised.name} {raised.t:.1f} s{' (exception)' * (raised.name in right)}" for raised in one.alarms]


def false(seen: Sequence[Seen]) -> list[str]:
    """The rows that were raised, each time, and are no exception."""
    return [raised.name for one in seen for raised in one.alarms if raised.name not in RIGHT.get(one.hour.effect, ())]


def _others(mine: Sequence[Seen]) -> str:
    """What came beside."""
    total = sum((Counter(one.others) for one in mine), Counter[str]())
    return ", ".join(f"{name} {count}" for name, count in sorted(total.items()))


def conclude(seen: Sequence[Seen], took_s: float) -> None:
    """What it comes to."""
    wrong, raised = false(seen), sum(len(one.alarms) for one in seen)
    listed = ", ".join(f"{name} {count}" for name, count in Counter(wrong).items()) or "none"
    total, acting = (sum(getattr(one, name) for one in seen) / 3600 for name in ("seconds", "acting_s"))
    print(
        f"{total:.2f} h in virtual time, {acting:.2f} h of them under a law; parameters up to {100 * OFF:.0f} % off;"
        f" of {len(JUDGING)} rows that judge sensors were raised: {listed};"
        f" exceptions: {raised - len(wrong)}; {took_s:.0f} s"
    )


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=120.0, help="in all")
    parser.add_argument("--seed", type=int, default=0, help="of noise, missing pictures and signals")
    parser.add_argument("--only", nargs="*", choices=["nothing", *HIDDEN], metavar="EFFECT", help="some of the effects")
    parser.add_argument("--hasty", action="store_true", help="the camera's rows speak at their first evidence")
    parser.add_argument("--workers", type=int, default=cores())
    parser.add_argument("--json", type=Path, help="write what was seen to this file, a line each, as it comes")
    options = parser.parse_args()
    begun = time.monotonic()
    todo = hours(options.minutes, options.seed, options.only)
    with options.json.open("w") if options.json else contextlib.nullcontext() as log:
        seen = watched(todo, options.workers, log, hasty=options.hasty)
    show(seen)
    conclude(seen, time.monotonic() - begun)
    return int(bool(false(seen)))


if __name__ == "__main__":
    sys.exit(main())
