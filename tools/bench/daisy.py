"""The automatic choice of `subspaceid` on real records, beside the figures that its folder tells of other programs.

python tools/bench/daisy.py [--only dryer] [--json FILE]

The records are looked for in `$HOOPD_SHARED/plants/daisy`, else in `../shared/plants/daisy`; its README has the split,
the score and the others' figures, which are read when this runs. Means of the training rows are taken out of all rows.
Fit 100 (1 - |y - yhat| / |y - mean y|) on the validation rows, mean over the outputs, one step ahead, ten steps ahead
and simulated; the initial state of predictor and simulation is fitted on the first max(50, 3 order) validation rows.
Exit code 1 when fewer than 11 of 12 cells (in proportion of those asked for) are within half a point of the best of the
others, or a model is unstable without a warning; 2 without the records.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT)]

import numpy as np  # noqa: E402

from hoopd.ident import Data, Innovations, estimate_x0, fit_percent, iddata, predict, subspaceid  # noqa: E402

HORIZONS = (1, 10, math.inf)
TOLERANCE, SHARE = 0.5, 11.0 / 12.0
# Rows of the README's two tables: a name there, the file, its input and output columns.
RECORDS = {
    "dryer": ("dryer", [0], [1]), "CD arm": ("CD_player_arm", [0, 1], [2, 3]),
    "exchanger": ("exchanger", [1], [2]), "CSTR": ("cstr", [1], [2, 3]),
}  # fmt: skip


class Record(NamedTuple):
    """A record, split; what the best of the others reach (None: not told)."""

    name: str
    own: Data
    held: Data
    best: tuple[float | None, ...]


def records(folder: Path, only: str) -> Iterator[Record]:
    """Those whose name holds the word."""
    told = (folder / "README.md").read_text()
    for name, (file, inputs, outputs) in RECORDS.items():
        if only.lower() not in name.lower():
            continue
        rows = np.loadtxt(folder / f"{file}.dat")
        first = int(re.search(rf"{file}\.dat \|.*\| (\d+) of", told)[1])  # type: ignore[index]
        rows = rows - rows[:first].mean(axis=0)
        u, y = rows[:, inputs], rows[:, outputs]
        yield Record(name, iddata(y[:first], u[:first]), iddata(y[first:], u[first:]), best_of(told, name))


def best_of(told: str, name: str) -> tuple[float | None, ...]:
    """The largest figure of each horizon in the row of a record."""
    row = re.search(rf"^\| {name} \|(.*)$", told, re.MULTILINE)
    cells = [] if row is None else [cell.strip().split("/") for cell in row[1].split("|")]
    figures = [[float(one) for one in column if re.fullmatch(r"[\d.]+", one)] for column in zip(*(
        cell for cell in cells if len(cell) == len(HORIZONS)
    ), strict=True)]  # fmt: skip
    return tuple(max(column, default=None) for column in figures) or (None,) * len(HORIZONS)


def fit(model: Innovations, held: Data, horizon: float) -> float:
    """Percent, mean over the outputs."""
    first = max(50, 3 * model.nx)
    with np.errstate(all="ignore"):
        x0 = estimate_x0(model, held, samples=first, simulation=horizon == math.inf)
        return float(np.mean(fit_percent(held.y, predict(model, held, horizon, x0))))


def measured(record: Record) -> dict[str, Any]:
    """One row."""
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = subspaceid(record.own)
    said = [str(one.message) for one in caught]
    radius = float(np.abs(np.linalg.eigvals(model.a)).max())
    return {
        "record": record.name, "fits": [fit(model, record.held, h) for h in HORIZONS], "best": list(record.best),
        "radius": radius, "silent": radius >= 1.0 and not any("unstable" in one or "integrator" in one for one in said),
        "seconds": time.perf_counter() - start, "choice": str(model.choice), "warnings": said,
    }  # fmt: skip


def held_up(row: dict[str, Any]) -> list[bool]:
    """By horizon whether the fit is within the tolerance of the best."""
    return [
        best is None or (own > best - TOLERANCE) for own, best in zip(row["fits"], row["best"], strict=True)
    ]  # fmt: skip


def main() -> int:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--only", default="", help="records whose name holds this")
    asked.add_argument("--json", type=Path)
    chosen = asked.parse_args()
    folder = Path(os.environ.get("HOOPD_SHARED", ROOT.parent / "shared")) / "plants" / "daisy"
    if not folder.is_dir():
        print(f"no records: {folder} (set HOOPD_SHARED)", file=sys.stderr)
        return 2
    rows = []
    print("| record | 1 step | 10 steps | simulated | best of the others | radius | s |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for record in records(folder, chosen.only):
        row = measured(record)
        rows.append(row)
        marks = [f"{own:.1f}{'' if good else ' *'}" for own, good in zip(row["fits"], held_up(row), strict=True)]
        best = " / ".join("-" if one is None else f"{one:.1f}" for one in row["best"])
        print(f"| {record.name} | {' | '.join(marks)} | {best} | {row['radius']:.4f} | {row['seconds']:.1f} |")
        print(f"  {row['choice']}", flush=True)
    cells = [good for row in rows for good in held_up(row)]
    print(f"\n{sum(cells)} of {len(cells)} cells within {TOLERANCE} points of the best of the others (* not)")
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(rows, indent=1) + "\n")
    return int(sum(cells) < SHARE * len(cells) or any(row["silent"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
