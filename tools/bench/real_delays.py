"""How late readings are, told by parts of a recording and beside other effects: do the intervals agree?

python tools/bench/real_delays.py --out FOLDER [--only NAME,...] [--tree CHECKOUT]

Each recording of hoop and ball is diagnosed from models/hoop.yaml by its first two thirds, by all of it (the other
recording proves), and without the names of other delays and lags. The table has what was named, and how late hoop and
ball are in all (realdata/delays.py). Exit code 1 when two intervals of one sum do not overlap or a delay is named by
one part and not by another, 2 when the recordings are not there. With the folder of real_pairs.py its diagnoses are
used again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path

from beforeafter import trees
from realdata import delays, intervals
from realdata.kept import Commands, Data
from realdata.places import HOOPS, Hoop

USERS = "models/hoop.yaml"
BOTH = tuple(one for one in HOOPS if one.name.startswith("both"))
# What could take a part of the camera's latency upon itself.
OTHERS = "actuator.delay,actuator.lag,encoder.latency"
Told = dict[str, dict[str, intervals.Estimate]]  # by how it was asked, by name


def _asked(one: Hoop) -> dict[str, tuple[str | Data, ...]]:
    (other,) = (another for another in BOTH if another is not one)
    plain: tuple[str | Data, ...] = ("diagnose", Data(one.path), *one.arguments, "--model", USERS)
    return {
        "two thirds": (*plain, "--no-free-run"),
        "all": (*plain, "--holdout", Data(other.path), "--no-free-run"),
        "camera alone": (*plain, "--without", OTHERS, "--no-free-run"),
    }


def measured(commands: Commands, hoops: Sequence[Hoop]) -> tuple[Told, list[str]]:
    """Every diagnosis; commands that failed."""
    found: Told = {}
    failed = []
    for one in hoops:
        for how, arguments in _asked(one).items():
            done = commands.run([*arguments, "--yes"], writes="--write")
            if done.failure:
                failed.append(f"{one.name}, {how}: {done.failure}")
            else:
                found[f"{one.name}, {how}"] = intervals.estimates(done.model)
    return found, failed


def show(found: Told) -> list[str]:
    """Print the tables; what disagrees."""
    print(f"{'named [ms]':26} {'actuator.delay':>22} {'encoder.latency':>22} {'camera.latency':>22}")
    for how, estimates in found.items():
        names = ("actuator.delay.d", "encoder.latency.d", "camera.latency.d")
        print(f"{how:26} " + " ".join(f"{_ms(estimates.get(name)):>22}" for name in names))
    late = {how: delays.sums(estimates) for how, estimates in found.items()}
    print(f"\n{'in all [ms]':26} {'hoop':>22} {'ball':>22}")
    for how, estimates in late.items():
        print(f"{how:26} " + " ".join(f"{_ms(estimates.get(name)):>22}" for name in delays.SUMS))
    return disagreeing(late)


def disagreeing(late: Mapping[str, Mapping[str, intervals.Estimate]]) -> list[str]:
    """Sums of two diagnoses whose intervals exclude each other, and those that one does not have."""
    missed = []
    for one, other in combinations(late, 2):
        for name in delays.SUMS:
            both = [late[how].get(name) for how in (one, other)]
            if both[0] is None or both[1] is None:
                # what was not allowed cannot be named
                if both != [None, None] and not (name.startswith("hoop") and "alone" in one + other):
                    missed.append(f"{name}: {_ms(both[0])} ({one}), {_ms(both[1])} ({other})")
            elif intervals.Compared(name, (one, other), both[0], both[1]).overlap is False:
                missed.append(f"{name}: {_ms(both[0])} ({one}), {_ms(both[1])} ({other})")
    return missed


def _ms(one: intervals.Estimate | None) -> str:
    if one is None:
        return "-"
    if one.interval is None:
        return f"{1e3 * one.value:.2f}"
    return f"{1e3 * one.value:.2f} ({1e3 * one.interval[0]:.2f} to {1e3 * one.interval[1]:.2f})"


def main() -> int:
    """Measure and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of results; what is there is not made again")
    parser.add_argument("--tree", type=Path, default=trees.ROOT, help="checkout that diagnoses (this one)")
    parser.add_argument("--only", default=",".join(one.name for one in BOTH), help="recordings, comma-separated")
    options = parser.parse_args()
    hoops = [one for one in BOTH if one.name in options.only.split(",")]
    try:
        found, missed = measured(Commands(options.out, options.tree, 3 * len(hoops)), hoops)
    except trees.ToolError as error:
        print(f"real_delays: {error}", file=sys.stderr)
        return 2
    missed += show(found)
    for text in missed:
        print(f"FAILED {text}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
