"""What an earlier state of the program found and how long it took, beside this one.

python tools/bench/before_after.py concealed                       ten concealed cases against those that were kept
python tools/bench/before_after.py real [--all]                    fits and diagnoses of a laboratory's recordings
python tools/bench/before_after.py speed --before CHECKOUT         lock-step, a tick, a fit, a diagnosis, in turns

`--tree CHECKOUT` asks another checkout than this one. What was kept stands in tests/data/before_the_move; `--keep
FILE` writes the figures of a run in the same form. Bounds: the same verdicts and names, every value within 0.1
standard errors, the median ratio of 11 pairs not above 1.05 by the processor's time. Exit code 1 when one is missed,
2 when a command fails.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import processes
from beforeafter import figures, hidden, ratios, realrecordings, speed, trees

KEPT = trees.ROOT / "tests" / "data" / "before_the_move"
MOST_ERRORS = 0.1
MOST_RATIO = 1.05
PAIRS = 11
SHOWN_PERCENT = 0.05  # fits that differ by less look the same in the tables


@contextmanager
def folder(given: Path | None) -> Any:
    """The folder of work: what was told, else one that goes with the run."""
    if given is not None:
        given.mkdir(parents=True, exist_ok=True)
        yield given
        return
    with tempfile.TemporaryDirectory(prefix="hoopd-before-") as name:
        yield Path(name)


def concealed(options: argparse.Namespace, work: Path) -> int:
    """The ten cases."""
    found = hidden.run(options.tree, work, processes.progress)
    return judged(found, "concealed.json", options)


def real(options: argparse.Namespace, work: Path) -> int:
    """The real recordings."""
    asked = realrecordings.CHEAP if not options.all else (*realrecordings.FITS, *realrecordings.DIAGNOSES)
    chosen = [one for one in asked if options.only in one.name]
    found = realrecordings.run(options.tree, work, chosen, processes.progress)
    return judged(found, "real.json", options)


def judged(found: Mapping[str, Any], name: str, options: argparse.Namespace) -> int:
    """Shows what was found beside what was kept; 1 when a bound is missed."""
    processes.progress("")
    if options.keep:
        options.keep.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        return 0
    kept = json.loads((KEPT / name).read_text(encoding="utf-8"))
    if kept["versions"] != found["versions"]:
        print(f"other versions than those that were kept: {kept['versions']} before, {found['versions']} now")
    well = [_shown(case, kept["cases"][case], now) for case, now in found["cases"].items()]
    equal = sum(well)
    print(f"{equal} of {len(well)} cases with the same names and values within {MOST_ERRORS:g} standard errors")
    return int(equal < len(well))


def _shown(case: str, kept: Mapping[str, Any], now: Mapping[str, Any]) -> bool:
    """Prints one case; whether it holds."""
    before, after = kept["figures"], now["figures"]
    same, most = figures.names(before) == figures.names(after), figures.largest(before, after)
    title = f"{case} ({kept['family']}: {', '.join(kept['hidden']) or 'nothing'})" if "family" in kept else case
    print(f"{title}: names {'equal' if same else 'DIFFERENT'}, largest difference {most.errors:.2g} ({most.name})")
    if kept.get("recordings") != now.get("recordings"):
        print("  the generator made other recordings than those that were kept: nothing here can be compared")
        return False
    print(f"  {', '.join(figures.names(before))}" + ("" if same else f"  ->  {', '.join(figures.names(after))}"))
    for channel, old in before.get("percent", {}).items():
        new = after["percent"].get(channel, math.nan)
        mark = "" if abs(new - old) < SHOWN_PERCENT else "  <"
        print(f"  {channel:60} {old:6.1f} {new:6.1f}{mark}")
    return same and most.errors <= MOST_ERRORS


def timed(options: argparse.Namespace, work: Path) -> int:
    """Both checkouts in turns."""
    chosen = options.only.split(",") if options.only else list(speed.WORK)
    if {"fit", "diagnosis"} & set(chosen):
        processes.progress("recording")
        speed.prepare(options.before, work)
    found = []
    for name in chosen:
        found.append(speed.compare(options.before, options.tree, name, options.pairs, work, processes.progress))
        processes.progress("")
        _told(found[-1])
    slow = [one.name for one in found if one.cpu.median > MOST_RATIO]
    for name in slow:
        print(f"FAILED {name}: the median ratio is above {MOST_RATIO:g}")
    return int(bool(slow))


def _told(one: speed.Compared) -> None:
    """A line for what is measured, as soon as it is."""
    print(f"{one.name}: {one.before_s:.4g} s before, {one.after_s:.4g} s after; ratio {_ratio(one.cpu)}", end="; ")
    print(f"by the clock {_ratio(one.clock)}", flush=True)


def _ratio(ratio: ratios.Ratio) -> str:
    if math.isnan(ratio.low):
        return f"{ratio.median:.3f}"
    return f"{ratio.median:.3f}, {ratio.low:.3f} to {ratio.high:.3f} ({100 * ratio.level:.1f} %)"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(required=True)
    for name, run in (("concealed", concealed), ("real", real), ("speed", timed)):
        verb = verbs.add_parser(name, help=run.__doc__)
        verb.set_defaults(run=run)
        verb.add_argument("--tree", type=Path, default=trees.ROOT, help="checkout that is asked (this one)")
        verb.add_argument("--work", type=Path, help="folder of cases and results; what is there is not made again")
        if run is not timed:
            verb.add_argument("--keep", type=Path, help="write the figures to this file and compare nothing")
    verbs.choices["real"].add_argument("--all", action="store_true", help="the long diagnoses, too")
    verbs.choices["real"].add_argument("--only", default="", help="commands whose name holds this text")
    verbs.choices["speed"].add_argument("--before", type=Path, required=True, help="the earlier checkout")
    verbs.choices["speed"].add_argument("--pairs", type=int, default=PAIRS)
    verbs.choices["speed"].add_argument("--only", default="", help=f"comma-separated: {', '.join(speed.WORK)}")
    return parser


def main() -> int:
    """Measure and judge."""
    options = _parser().parse_args()
    try:
        with folder(options.work) as work:
            return int(options.run(options, work.resolve()))
    except trees.ToolError as error:
        print(f"before_after: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
