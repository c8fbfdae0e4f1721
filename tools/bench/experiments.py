"""Default experiments on the default rig over many seeds: how far ball and hoop move, and that nothing stops them.

Usage: python tools/bench/experiments.py [--seeds 20] [--only NAME] [--json FILE]
Every row is so many runs of `hoopd experiment` in lock-step (bytes, board, camera two frames late, noise), without an
amplitude, so that it is chosen from the model. Exit code 1 when one does not end as planned or a fault is raised.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from hoopd.daemon.app import Options  # noqa: E402
from hoopd.daemon.experiment import KINDS, run  # noqa: E402
from hoopd.daemon.recording_target import Where  # noqa: E402
from hoopd.plants.hoop.loop.experiment_plan import DURATION_S, DURATIONS_S, Plan  # noqa: E402

HOLDING = Path("controllers/lqg.yaml")


def plans() -> dict[str, Plan]:
    """All rows."""
    rows = {kind: Plan(kind, DURATIONS_S.get(kind, DURATION_S)) for kind in KINDS}
    long = {f"{kind}, 40 s": Plan(kind, 40.0) for kind in ("prbs", "chirp", "multisine", "steps")}
    others = {
        "prbs, clock 2": Plan("prbs", clock_ticks=2),
        "prbs around LQG": Plan("prbs", around=HOLDING),
        "prbs, no ball": Plan("prbs", ball=False),
    }
    return {**rows, **long, **others}


def results(plan: Plan, seeds: int) -> list[dict[str, Any]]:
    """One run a seed."""
    found = []
    for seed in range(seeds):
        options = Options(sim=True, sets=("log.level=error",), seed=seed, speed="max", direct=True)
        with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(io.StringIO()):
            found.append(run(plan._replace(seed=seed), options, Where(folder=Path(folder))))
    return found


def spread(found: list[dict[str, Any]], name: str) -> tuple[float, float]:
    """Smallest and largest of a figure."""
    values = [row[name] or 0.0 for row in found]
    return min(values), max(values)


def judged(found: list[dict[str, Any]]) -> dict[str, Any]:
    """A row's figures."""
    names = ("amplitude_nm", "largest_hoop_speed_rad_s", "largest_ball_angle_rad", "crest_factor")
    return {
        "done": sum(row["outcome"] == "done" for row in found),
        "faults": sum(bool(row["faults"]) for row in found),
        "outcomes": sorted({row["outcome"] for row in found}),
        "little_room": sum(any("little room" in note for note in row["notes"]) for row in found),
        **{name: spread(found, name) for name in names},
    }


def main() -> int:
    """Print the table; 1 when something was stopped."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", help="one row by its name")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table = {}
    print(f"{'experiment':18} {'done':>7} {'faults':>6}  {'N m':12} {'hoop rad/s':12} {'ball rad':12} crest")
    chosen = {name: plan for name, plan in plans().items() if options.only in (None, name)}
    for name, plan in chosen.items():
        row = table[name] = judged(results(plan, options.seeds))
        ranges = [
            f"{row['amplitude_nm'][0]:.2f}-{row['amplitude_nm'][1]:.2f}",
            "{:.1f}-{:.1f}".format(*row["largest_hoop_speed_rad_s"]),
            "{:.2f}-{:.2f}".format(*row["largest_ball_angle_rad"]),
            "{:.2f}-{:.2f}".format(*row["crest_factor"]),
        ]
        done = f"{row['done']}/{options.seeds}"
        print(f"{name:18} {done:>7} {row['faults']:6}  {ranges[0]:12} {ranges[1]:12} {ranges[2]:12} {ranges[3]}")
    if options.json:
        options.json.write_text(json.dumps(table, indent=2))
    return int(any(row["done"] < options.seeds or row["faults"] for row in table.values()))


if __name__ == "__main__":
    sys.exit(main())
