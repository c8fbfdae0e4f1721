"""The fault campaign: the daemon on the full rig, one fault a run, judged by the board's log of torque.

    python tools/bench/campaign.py [--lockstep] [--direct] [--fifo] [--only KIND ...] [--keep FOLDER] [--json FILE]

In real time every run lasts some seven seconds. A failed one is repeated, at most three times, when an independent
witness saw the machine stand still for more than 50 ms (or starve a core), or when it did not control yet as the fault
came. In lock-step nothing is repeated. Exit code 1 when a kind fails.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from faultcampaign.judging import Verdict, judge  # noqa: E402
from faultcampaign.kinds import KINDS  # noqa: E402
from faultcampaign.trials import Way, perform  # noqa: E402
from system.witness import Witness  # noqa: E402

ATTEMPTS = 4


def campaign(names: list[str], folder: Path, way: Way) -> list[Verdict]:
    """All kinds, one after the other."""
    verdicts = []
    for index, name in enumerate(names):
        sys.stderr.write(f"\r\x1b[2K{index + 1}/{len(names)} {name}")
        sys.stderr.flush()
        place = folder / name.replace(" ", "-").replace(",", "")
        verdicts.append(attempt(name, place, way, None) if way.lockstep else repeated(name, place, way))
    sys.stderr.write("\r\x1b[2K")
    return verdicts


def repeated(name: str, folder: Path, way: Way) -> Verdict:
    """One kind, again when the machine stood still."""
    for number in range(1, ATTEMPTS + 1):
        mine = folder / str(number)
        mine.mkdir(parents=True)
        with Witness(mine / "gaps.txt") as witness:
            verdict = attempt(name, mine, way, witness)
            verdict.attempts = number
            if not verdict.wrong or (verdict.controlled and not witness.gaps()):
                break
    return verdict


def attempt(name: str, folder: Path, way: Way, witness: Witness | None) -> Verdict:
    """One kind, once; a run that leaves nothing to judge has failed."""
    kind = KINDS[name]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        return judge(name, kind, perform(folder, kind, way), witness.gaps if witness else lambda start, stop: ())
    except (AssertionError, OSError, IndexError, ValueError) as error:
        return Verdict(name, kind.outcome, kind.deadline_s, wrong=[f"{type(error).__name__}: {error}"[:200]])


def show(verdicts: list[Verdict], took_s: float, way: Way) -> None:
    """The table."""
    print(
        f"{'kind':<22} {'rule':<8} {'from':>7} {'deadline':>8} {'zero at':>9} {'max N m':>8} {'rad/s':>6} {'replay':>7}"
        "  verdict, message"
    )
    for v in verdicts:
        deadline = "-" if v.outcome == "goes on" else f"{v.deadline_s:.3f} s"
        zero = "went on" if v.outcome == "goes on" else f"{v.zero_s:.3f} s"
        verdict = "FAILED: " + "; ".join(v.wrong) if v.wrong else "ok"
        again = f" (attempt {v.attempts})" if v.attempts > 1 else ""
        print(
            f"{v.kind:<22} {v.outcome:<8} {v.began_s:>5.2f} s {deadline:>8} {zero:>9} {v.max_torque_nm:>8.3f}"
            f" {v.max_speed_rad_s:>6.1f} {'equal' if v.opens else 'NO':>7}  {verdict}{again}; {v.message}"
        )
    failed = sum(bool(v.wrong) for v in verdicts)
    print(f"{len(verdicts)} kinds, {failed} failed, {took_s:.0f} s, {way}")


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
    parser.add_argument("--only", nargs="*", choices=sorted(KINDS), metavar="KIND", help="some of the kinds")
    parser.add_argument("--keep", type=Path, help="existing folder for what the runs leave behind")
    parser.add_argument("--json", type=Path, help="write the table to this file")
    options = parser.parse_args()
    way, begun = Way(options.direct, options.fifo, options.lockstep), time.monotonic()
    names = [name for name in playable(way) if not options.only or name in options.only]
    with tempfile.TemporaryDirectory(prefix="hoopd-campaign-") as scratch:
        verdicts = campaign(names, options.keep or Path(scratch), way)
    show(verdicts, time.monotonic() - begun, way)
    if options.json:
        options.json.write_text(json.dumps([vars(verdict) for verdict in verdicts], indent=2))
    return int(any(verdict.wrong for verdict in verdicts))


if __name__ == "__main__":
    sys.exit(main())
