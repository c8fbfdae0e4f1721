"""How often each criterion of the identification toolbox holds: a table of rates over seeds.

python tools/bench/ident_criteria.py [--seeds 100] [--only 01,15] [--workers 2] [--json FILE]

A criterion is a function of a seed that gives its figures and verdicts; it holds when every verdict does. Rates stand
with their Clopper-Pearson intervals (95 %). A seed that fails with an error counts as one that does not hold.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
import warnings
from concurrent.futures import ProcessPoolExecutor, as_completed
from importlib import import_module
from pathlib import Path
from typing import Any

# one thread of linear algebra a process; before numpy is loaded
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools" / "bench"), str(ROOT / "tools")]

AREAS = ("polynomial", "optima", "statespace", "realisation", "prediction", "nonparametric")
MARKS = ("criterion_", "bar_")


def known() -> dict[str, tuple[str, str]]:
    """Criteria by their numbers or names: module and function; two of one number carry their area."""
    found: dict[str, tuple[str, str]] = {}
    for area in AREAS:
        module = import_module(f"harness.identcriteria.{area}")
        for name in sorted(vars(module)):
            if name.startswith(MARKS) and callable(getattr(module, name)):
                key = name.removeprefix("criterion_")
                found[f"{key} ({area})" if key in found else key] = area, name
    return found


def held(area: str, name: str, seed: int) -> tuple[bool, str, float]:
    """Whether a criterion holds at a seed, what does not, and the seconds that it took."""
    import numpy as np

    start = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            figures = getattr(import_module(f"harness.identcriteria.{area}"), name)(seed)
        wrong = [key for key, value in figures.items() if isinstance(value, bool | np.bool_) and not value]
        return not wrong, ", ".join(wrong), time.perf_counter() - start
    except Exception as error:  # a criterion that cannot be asked does not hold
        return False, f"{type(error).__name__}: {error}"[:80], time.perf_counter() - start


def rates(wanted: dict[str, tuple[str, str]], seeds: int, workers: int) -> dict[str, dict[str, Any]]:
    """{"held", "seeds", "interval", "why", "seconds"} by criterion."""
    from concealed.proportions import clopper_pearson

    told: dict[str, list[tuple[bool, str, float]]] = {key: [] for key in wanted}
    with ProcessPoolExecutor(workers) as pool:
        jobs = {pool.submit(held, *place, seed): key for key, place in wanted.items() for seed in range(seeds)}
        for count, job in enumerate(as_completed(jobs), start=1):
            told[jobs[job]].append(job.result())
            if sys.stderr.isatty():
                print(f"\r{count} of {len(jobs)}", end="", file=sys.stderr)
    return {key: _row(found, clopper_pearson) for key, found in told.items()}


def _row(found: list[tuple[bool, str, float]], interval: Any) -> dict[str, Any]:
    count = sum(one[0] for one in found)
    return {
        "held": count,
        "seeds": len(found),
        "interval": interval(count, len(found)),
        "why": sorted({one[1] for one in found if not one[0]}),
        "seconds": sorted(one[2] for one in found)[len(found) // 2],
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--only", default="", help="comma-separated numbers, e.g. 01,15")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    only = [one for one in options.only.split(",") if one]
    wanted = {key: place for key, place in known().items() if not only or key.split(" ")[0] in only}
    if not wanted:
        sys.exit(f"ident_criteria: none of {options.only}; known: {', '.join(known())}")
    found = rates(wanted, options.seeds, options.workers)
    print("| criterion | held | 95 % | what did not | s a seed |\n|---|---|---|---|---|")
    for key, row in sorted(found.items()):
        low, high = row["interval"]
        span = f"{100 * low:.0f}-{100 * high:.0f} %"
        print(f"| {key} | {row['held']}/{row['seeds']} | {span} | {'; '.join(row['why'])} | {row['seconds']:.2f} |")
    if options.json:
        options.json.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
