"""The automatic choice of `subspaceid` on made-up systems, beside estimates of the order that a textbook would say.

python tools/bench/ident_choice.py [--seeds 0,1] [--samples 1000] [--only short] [--json FILE]

`harness.identcriteria.family` says what the systems are. The rivals are plain subspace estimates (CVA and MOESP, with a
direct term) of the system's own order, which nobody knows of real data. Fit 100 (1 - |y - yhat| / |y - mean y|) on the
half that was not fitted, one step ahead, ten steps ahead and simulated, the initial state fitted on its first
max(50, 3 order) samples. Exit code 1 when fewer than 11 of 12 cells are within half a point of the best rival, or a
model is unstable without a warning.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
import warnings
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

import numpy as np  # noqa: E402
from harness.identcriteria.family import MadeUp, family  # noqa: E402

from hoopd.ident import Data, Innovations, estimate_x0, fit_percent, predict, subspaceid  # noqa: E402

HORIZONS = (1, 10, math.inf)
TOLERANCE, SHARE = 0.5, 11.0 / 12.0


def fits(model: Innovations, held: Data) -> list[float]:
    """Percent by horizon, mean over the outputs."""
    samples, found = max(50, 3 * model.nx), []
    with np.errstate(all="ignore"):
        for h in HORIZONS:
            x0 = estimate_x0(model, held, samples=samples, simulation=h == math.inf)
            percent = float(np.mean(fit_percent(held.y, predict(model, held, h, x0))))
            found.append(percent if math.isfinite(percent) else -math.inf)
    return found


def rivals(made: MadeUp) -> list[list[float]]:
    """Fits of the plain estimates that can be made."""
    found = []
    for weighting in ("CVA", "MOESP"):
        try:
            model = subspaceid(made.own, made.order, weighting=weighting, direct=True, horizon=max(made.order + 2, 10))
        except ValueError:
            continue
        found.append(fits(model, made.held))
    return found


def measured(made: MadeUp) -> dict[str, Any]:
    """One row."""
    start = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = subspaceid(made.own)
    seconds, said = time.process_time() - start, [str(one.message) for one in caught]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        best = [max(column, default=-math.inf) for column in zip(*rivals(made), strict=True)]
    radius = float(np.abs(np.linalg.eigvals(model.a)).max())
    return {
        "name": made.name, "fits": fits(model, made.held), "best": best or [-math.inf] * len(HORIZONS),
        "silent": radius >= 1.0 and not any("unstable" in one or "integrator" in one for one in said),
        "radius": radius, "seconds": seconds, "choice": str(model.choice),
    }  # fmt: skip


def held_up(row: dict[str, Any]) -> list[bool]:
    """By horizon whether the fit is within the tolerance of the best rival."""
    return [own > best - TOLERANCE for own, best in zip(row["fits"], row["best"], strict=True)]


def main() -> int:
    """Print the table."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--seeds", default="0,1")
    asked.add_argument("--samples", type=int, default=1000)
    asked.add_argument("--only", default="", help="systems whose name holds this")
    asked.add_argument("--json", type=Path)
    chosen = asked.parse_args()
    rows = []
    print("| system | 1 step | 10 steps | simulated | best rival | radius | s | choice |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for seed in chosen.seeds.split(","):
        for made in family(int(seed), chosen.samples):
            if chosen.only not in made.name:
                continue
            rows.append(row := measured(made))
            marks = " | ".join(
                f"{own:.1f}{'' if good else ' *'}" for own, good in zip(row["fits"], held_up(row), strict=True)
            )
            best = " / ".join(f"{one:.1f}" for one in row["best"])
            words = row["choice"].partition(":")[0]
            end = f"{best} | {row['radius']:.3f} | {row['seconds']:.1f} | {words}"
            print(f"| {made.name} | {marks} | {end} |", flush=True)
    good, points = np.array([held_up(row) for row in rows]), np.array([
        np.subtract(np.maximum(row["fits"], -100.0), np.maximum(row["best"], -100.0)) for row in rows
    ])  # fmt: skip
    print(f"\n{good.sum()} of {good.size} cells within {TOLERANCE} points of the best rival (* not); by horizon "
          f"{good.mean(axis=0).round(3)}; points ahead of it: mean {points.mean(axis=0).round(2)}, worst "
          f"{points.min(axis=0).round(1)}; {np.mean([row['seconds'] for row in rows]):.1f} s a system")  # fmt: skip
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(rows, indent=1) + "\n")
    return int(good.mean() < SHARE or any(row["silent"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
