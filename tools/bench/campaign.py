"""The fault campaign: the daemon on the full rig, one fault a run, judged by the board's log of torque.

    python tools/bench/campaign.py [--lockstep] [--direct] [--fifo] [--trials N] [--only KIND ...] [--keep FOLDER]

In real time a run lasts some eight seconds, with a slow lie some twenty. A failed one is repeated, at most three times,
when an independent witness saw the machine stand still for more than 50 ms (or starve a core), or when it did not
control yet as the fault came. In lock-step nothing is repeated. What each kind does:
docs/explanations/fault_campaign.md. Ctrl-C ends it and shows what there is. Exit code 1 when a trial fails or is
left out.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools"), str(ROOT / "tools" / "bench")]

from faultcampaign.judging import Verdict, judge  # noqa: E402
from faultcampaign.kinds import KINDS  # noqa: E402
from faultcampaign.table import show  # noqa: E402
from faultcampaign.trials import Way, perform  # noqa: E402
from harness.witness import Witness  # noqa: E402
from processes import progress  # noqa: E402

from hoopd.shell.operator import CommandError  # noqa: E402

ATTEMPTS = 4


def campaign(names: list[str], folder: Path, way: Way, trials: int) -> Iterator[Verdict]:
    """All kinds one after the other, then all of them once more until each has had its trials."""
    for number in range(trials):
        for index, name in enumerate(names):
            progress(f"trial {number + 1}/{trials}, {index + 1}/{len(names)} {name}")
            place = folder / name.replace(" ", "-").replace(",", "") / str(number)
            play = attempt if way.lockstep else repeated
            yield play(name, place, way, number)
    progress("")


def repeated(name: str, folder: Path, way: Way, number: int) -> Verdict:
    """One trial, again when the machine stood still."""
    for count in range(1, ATTEMPTS + 1):
        mine = folder / str(count)
        mine.mkdir(parents=True)
        with Witness(mine / "gaps.txt") as witness:
            verdict = attempt(name, mine, way, number, witness)
            verdict.attempts = count
            if not verdict.wrong or (verdict.controlled and not witness.gaps()):
                break
    return verdict


def attempt(name: str, folder: Path, way: Way, number: int = 0, witness: Witness | None = None) -> Verdict:
    """One trial, once; a run that leaves nothing to judge has failed."""
    kind = KINDS[name]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        trial = perform(folder, kind, way, number)
        verdict = judge(name, kind, trial, witness.gaps if witness else lambda start, stop: ())
    except (AssertionError, OSError, LookupError, ValueError, CommandError) as error:
        verdict = Verdict(name, kind.outcome, kind.deadline_s, wrong=[f"{type(error).__name__}: {error}"[:200]])
    verdict.trial = number
    return verdict


def playable(way: Way) -> list[str]:
    """The kinds that can be made in this way."""
    return [
        name
        for name, kind in KINDS.items()
        if not (way.direct and kind.pictures) and not (way.lockstep and kind.realtime_only)
    ]


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--lockstep", action="store_true", help="in virtual time; kinds that a script can make")
    parser.add_argument("--direct", action="store_true", help="ball angles without pictures")
    parser.add_argument("--fifo", action="store_true", help="with real-time priority, as the unit grants it")
    parser.add_argument("--trials", type=int, default=1, metavar="N", help="runs of each kind, with other seeds")
    parser.add_argument("--only", nargs="*", choices=sorted(KINDS), metavar="KIND", help="some of the kinds")
    parser.add_argument("--keep", type=Path, help="existing folder for what the runs leave behind")
    parser.add_argument("--json", type=Path, help="write every trial to this file")
    options = parser.parse_args()
    way, begun = Way(options.direct, options.fifo, options.lockstep), time.monotonic()
    names = [name for name in playable(way) if not options.only or name in options.only]
    verdicts: list[Verdict] = []
    with tempfile.TemporaryDirectory(prefix="hoopd-campaign-") as scratch, contextlib.suppress(KeyboardInterrupt):
        for verdict in campaign(names, options.keep or Path(scratch), way, options.trials):
            verdicts.append(verdict)
    show(verdicts, time.monotonic() - begun, way)
    if options.json:
        options.json.write_text(json.dumps([vars(verdict) for verdict in verdicts], indent=2))
    return int(len(verdicts) < len(names) * options.trials or any(verdict.wrong for verdict in verdicts))


if __name__ == "__main__":
    sys.exit(main())
