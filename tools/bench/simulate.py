"""Time of one free run of 1,000 samples, side by side with adaptive solvers; ends with 1 when the bound is missed.

python tools/bench/simulate.py [--runs N] [--slow N] [--samples N] [--effects all|NAME,...] [--json FILE]

With `--effects` it is the processor time with each effect at its usual size against that without, side by side, and
how far the run is from one in steps of a quarter of a millisecond.

Each way takes its turn in every round, so that a busy machine slows all of them; the first call, which writes the
equations out, stands apart.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hoopd.plants.effects.library import library
from hoopd.plants.found_effects import FoundEffect, FoundEffects
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.fitting.solver_comparison import SolverCase, across_jumps, sample_to_sample, two_level_torque
from hoopd.plants.hoop.simulate import STEP_S, HoopModel
from hoopd.plants.model_file import load_model, plant_of

MODEL = Path(__file__).resolve().parents[2] / "config" / "models" / "thesis.yaml"
TICK_S, SAMPLES = 0.02, 1000
# A fit runs some hundred of these; a person who drags a parameter sees the curve move.
BOUND_MS = 5.0
# A run with an effect takes at most so many times as long as one without.
BOUND_WITH_EFFECTS = 2.0


def timed(call: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Seconds of one call, and what it gave."""
    start = time.perf_counter()
    result = call()
    return time.perf_counter() - start, result


def ways(samples: int) -> tuple[dict[str, Callable[[], np.ndarray]], Callable[[], np.ndarray]]:
    """Each way to run so many samples, ours first, and the converged run."""
    file = load_model(MODEL)
    plant, x0 = plant_of(file), np.zeros(4)
    t, u = TICK_S * np.arange(samples + 1), two_level_torque(samples)
    model, fine = (HoopModel(file.structure, file.values(), step_s=h) for h in (0.01, 0.0025))
    calls = {
        "hoopd, steps of 10 ms": lambda: model.run((), x0, t, u),
        "hoopd, steps of 2.5 ms": lambda: fine.run((), x0, t, u),
        "scipy RK45 at every sample, rtol 1e-6": lambda: (
            sample_to_sample(plant, x0, t, u, "RK45", rtol=1e-6, atol=1e-9).x
        ),
        "scipy Radau at every sample, rtol 1e-6": lambda: (
            sample_to_sample(plant, x0, t, u, "Radau", rtol=1e-6, atol=1e-9).x
        ),
        "scipy RK45 across the jumps, rtol 1e-6": lambda: (
            across_jumps(plant, x0, t, u, SolverCase("RK45", 1e-6, 1e-9)).x
        ),
        "scipy Radau across the jumps, rtol 1e-6": lambda: (
            across_jumps(plant, x0, t, u, SolverCase("Radau", 1e-6, 1e-9)).x
        ),
    }
    return calls, lambda: sample_to_sample(plant, x0, t, u, "DOP853").x


def effect_rows(wanted: str, runs: int, samples: int) -> list[dict[str, float | str]]:
    """For each effect: the median ratio of processor times, with it and without, and what finer steps would change."""
    file = load_model(MODEL)
    known, x0 = library(hoop_plant(file.structure, file.values())), np.array([0.0, 0.0, 0.2, 0.0])
    t, u = TICK_S * np.arange(samples + 1), two_level_torque(samples)
    plain = HoopModel(file.structure, file.values())
    rows: list[dict[str, float | str]] = []
    for name in known if wanted == "all" else wanted.split(","):
        sizes = {p.name: p.neutral + p.size for p in known[name].parameters}
        found = FoundEffects(file.structure, file.values(), (FoundEffect(name, sizes),))
        model, fine = (HoopModel.with_effects(found, step_s=step) for step in (STEP_S, STEP_S / 40.0))
        first_s, run = cpu_timed(lambda model=model: model.run((), x0, t, u))
        error = np.abs(run - fine.run((), x0, t, u))[:, [0, 2]].max()
        pairs = [[cpu_timed(lambda one=one: one.run((), x0, t, u))[0] for one in (plain, model)] for _ in range(runs)]
        ratio = float(np.median([with_it / without for without, with_it in pairs]))
        rows.append({"effect": name, "ratio": ratio, "first_ms": 1e3 * first_s, "error_rad": float(error)})
    return rows


def cpu_timed(call: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Seconds of the processor in one call, and what it gave."""
    start = time.thread_time()
    result = call()
    return time.thread_time() - start, result


def judged_effects(rows: list[dict[str, float | str]]) -> bool:
    """Print the table; whether all are within the bound."""
    print(f"{'effect':<26} {'against none':>12} {'first ms':>9} {'error rad':>10}")
    for row in sorted(rows, key=lambda row: -float(row["ratio"])):
        print(f"{row['effect']:<26} {row['ratio']:11.2f}x {row['first_ms']:9.1f} {row['error_rad']:10.1e}")
    over = [str(row["effect"]) for row in rows if float(row["ratio"]) > BOUND_WITH_EFFECTS]
    print(f"{'MISSED: ' + ', '.join(over) if over else 'ok'}; the bound is {BOUND_WITH_EFFECTS:g} times as long")
    return not over


def main() -> int:
    """Measure, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--slow", type=int, default=3, help="turns of the adaptive solvers: enough for their size")
    parser.add_argument("--samples", type=int, default=SAMPLES, help="of a run; the bound is for 1,000")
    parser.add_argument("--effects", help="all, or names of effects, in place of the solvers")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    if options.effects:
        found = effect_rows(options.effects, options.runs, options.samples)
        good = judged_effects(found)
        if options.json is not None:
            record = {"bound": BOUND_WITH_EFFECTS, "met": good, "rows": found}
            options.json.write_text(json.dumps(record, indent=2) + "\n")
        return 0 if good else 1
    calls, truth = ways(options.samples)
    converged, rows = truth(), []
    first = {name: timed(call) for name, call in calls.items()}
    times: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(options.runs):
        for name, call in calls.items():
            if turn < options.slow or name.startswith("hoopd"):
                times[name].append(timed(call)[0])
    ours = 1e3 * float(np.median(next(iter(times.values()))))
    print(
        f"{str(options.samples) + ' samples':<42} {'median ms':>9} {'p95 ms':>8} {'first ms':>9} {'against ours':>12}"
        f" {'theta error':>12}"
    )
    for name, (first_s, states) in first.items():
        median, p95 = (1e3 * float(np.percentile(times[name], q)) for q in (50, 95))
        error = float(np.abs(states - converged).max(axis=0)[0])
        rows.append(
            {"how": name, "median_ms": median, "p95_ms": p95, "runs": len(times[name]), "theta_error_rad": error}
        )
        print(f"{name:<42} {median:9.2f} {p95:8.2f} {1e3 * first_s:9.1f} {median / ours:11.1f}x {error:12.1e}")
    good = ours < BOUND_MS
    print(f"{'ok' if good else 'MISSED'}: {ours:.2f} ms for {options.samples:,} samples, the bound is {BOUND_MS:g} ms")
    if options.json is not None:
        options.json.write_text(json.dumps({"bound_ms": BOUND_MS, "met": good, "rows": rows}, indent=2) + "\n")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
