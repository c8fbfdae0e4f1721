"""Recordings of one device: what each of them teaches, simulated on every other.

python tools/bench/real_pairs.py --out FOLDER [--only NAME,...] [--tree CHECKOUT] [--json FILE]

Each recording is fitted (`hoopd fit --structure rolling`) and diagnosed with write-back (`hoopd diagnose --write`),
both from models/hoop.yaml, which is the user's own model. All three are simulated on every other recording (`hoopd
simulate`), in windows of 2 s and in one run. Bounds: naming is nowhere more than 1 point below the better of the
other two in windows, and better in most pairs; 95 % intervals of one parameter from two recordings overlap in at least
90 % of the pairs. Exit code 1 when one is missed, 2 when the recordings are not there. `--only`: fitted to these alone.
Results are kept in --out by the digest of data, arguments and program: an interrupted run goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from beforeafter import trees
from realdata import intervals, pairs
from realdata.kept import Commands, Data, Done
from realdata.places import HOOPS, Hoop

USERS = "models/hoop.yaml"
LEAST_OVERLAP = 0.9
KINDS = ("re-fitted", "named")
Models = dict[str, dict[str, Done]]  # by kind, by recording


def _learnt(commands: Commands, hoops: Sequence[Hoop]) -> Models:
    """Fits and diagnoses."""
    found: Models = {kind: {} for kind in KINDS}
    for one in hoops:
        what: tuple[str | Data, ...] = (Data(one.path), *one.arguments, "--model", USERS)
        found["re-fitted"][one.name] = commands.run(["fit", *what, "--structure", "rolling"], writes="--out")
        found["named"][one.name] = commands.run(["diagnose", *what, "--no-free-run", "--yes"], writes="--write")
    return found


def _simulated(commands: Commands, model: str | Data, target: Hoop, part: str) -> dict[str, Any] | None:
    arguments: tuple[str | Data, ...] = ("--input", Data(target.path, part), *target.arguments)
    return commands.run(["simulate", "--model", model, *arguments]).result


def _of_model(commands: Commands, done: Done, target: Hoop, part: str) -> dict[str, Any] | None:
    return None if done.failure else _simulated(commands, Data(done.model), target, part)


def _rows(commands: Commands, models: Models, hoops: Sequence[Hoop]) -> Iterator[pairs.Row]:
    for fitted, target, part in _asked(hoops):
        results = [
            _simulated(commands, USERS, target, part),
            *(_of_model(commands, models[kind][fitted.name], target, part) for kind in KINDS),
        ]
        for measure in pairs.MEASURES:
            for channel in pairs.channels(results):
                score = pairs.Score(*(pairs.percent(one, measure, channel) for one in results))
                yield pairs.Row(fitted.name, target.name + part, measure, channel, score)


def _asked(hoops: Sequence[Hoop]) -> list[tuple[Hoop, Hoop, str]]:
    """What is fitted, and on what of which other it is simulated."""
    return [(one, other, part) for one in hoops for other in HOOPS if other is not one for part in other.parts]


def show_pairs(rows: Sequence[pairs.Row]) -> list[str]:
    """Print the pairs; what misses a bound."""
    missed = []
    for measure in pairs.MEASURES:
        own = [row for row in rows if row.measure == measure]
        print(f"\n{measure}: percent of fit of {'fitted to':11} on {'':16} user's  re-fitted  named    gain")
        for row in own:
            told = "  ".join("    -" if one is None else f"{one:8.1f}" for one in row.score)
            mark = "  WORSE" if row.score.is_worse else ""
            print(f"  {row.channel:12} {row.fitted:12} {row.simulated:16} {told} {row.score.gain:+8.1f}{mark}")
        found = pairs.counted(own)
        print(f"  worse by more than a point in any channel: {found.worse} of {found.all}; better: {found.better}")
        if measure == pairs.MEASURES[0]:
            missed += [f"names make {found.worse} of {found.all} pairs worse"] if found.worse else []
            missed += [f"better in {found.better} of {found.all} only"] if 2 * found.better <= found.all else []
    return missed


def show_parameters(models: Models) -> list[str]:
    """Print what does not overlap; what misses a bound."""
    missed = []
    for kind in KINDS:
        known = {name: intervals.estimates(one.model) for name, one in models[kind].items() if not one.failure}
        rows = sorted(intervals.compared(known))
        well, count = intervals.share(rows)
        print(f"\nparameters, {kind}: {well} of {count} pairs overlap; no interval: {len(rows) - count}")
        for row in rows:
            if row.overlap is False:
                told = f"{intervals.shown(row.first)} | {intervals.shown(row.second)}"
                print(f"  {row.name:34} {' | '.join(row.models):22} {told}")
        if kind == "named" and well < LEAST_OVERLAP * count:
            missed.append(f"{well} of {count} parameters overlap, below {100 * LEAST_OVERLAP:g} %")
    return missed


def show_names(models: Models) -> list[str]:
    """Print what was named; commands that failed."""
    missed = []
    print("named")
    for kind in KINDS:
        for name, done in models[kind].items():
            if done.failure:
                missed.append(f"{name}, {kind}: {done.failure}")
            elif kind == "named":
                print(f"  {name:12} {_names(done.result or {})}")
    return missed


def _names(result: Mapping[str, Any]) -> str:
    told = [f"{one['name']} ({one['evidence']['log_likelihood_gain']:.0f} nats)" for one in result["effects"]]
    return f"{result['verdict']}: {', '.join(told) or 'nothing'}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of results; what is there is not made again")
    parser.add_argument("--tree", type=Path, default=trees.ROOT, help="checkout that fits and diagnoses (this one)")
    parser.add_argument("--only", help=f"fitted to these alone, comma-separated: {', '.join(h.name for h in HOOPS)}")
    parser.add_argument("--json", type=Path, help="write the figures to this file, too")
    return parser.parse_args()


def main() -> int:
    """Measure and judge."""
    options = _options()
    only = options.only.split(",") if options.only else [one.name for one in HOOPS]
    hoops = [one for one in HOOPS if one.name in only]
    if len(hoops) < len(only):
        print(f"real_pairs: --only: known are {', '.join(one.name for one in HOOPS)}", file=sys.stderr)
        return 2
    commands = Commands(options.out, options.tree, len(KINDS) * len(hoops) + (1 + len(KINDS)) * len(_asked(hoops)))
    try:
        models = _learnt(commands, hoops)
        rows = list(_rows(commands, models, hoops))
    except trees.ToolError as error:
        print(f"real_pairs: {error}", file=sys.stderr)
        return 2
    missed = [*show_names(models), *show_pairs(rows), *show_parameters(models)]
    for text in missed:
        print(f"FAILED {text}")
    if options.json:
        plain = [{**row._asdict(), "score": row.score._asdict()} for row in rows]
        options.json.write_text(json.dumps(plain, indent=1) + "\n", encoding="utf-8")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
