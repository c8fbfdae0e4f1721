"""The thesis's solver question, measured: adaptive solvers across the jumps of a held torque, and steps between them.

python tools/bench/solver.py [--recording FILE] [--figure FILE] [--json FILE]

Without a recording the torque is a seeded random two-level signal of 0.1 N m over 20 s.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from hoopd.plants.hoop.fitting.solver_comparison import (
    SolverCase,
    Study,
    sample_to_sample,
    stiffness,
    study,
    two_level_torque,
)
from hoopd.plants.model_file import load_model, plant_of
from hoopd.plots.solver import draw_solver_question
from hoopd.plots.style import save
from hoopd.recording import load

MODEL = Path(__file__).resolve().parents[2] / "config" / "models" / "thesis.yaml"
TICK_S, SAMPLES, SEED = 0.02, 1000, 0
TOLERANCES = [(1e-3, 1e-6), (1e-4, 1e-7), (1e-5, 1e-8), (1e-6, 1e-9), (1e-7, 1e-10)]
CASES = [
    *(SolverCase("RK45", *tolerance) for tolerance in TOLERANCES),
    *(SolverCase("Rosenbrock23", *tolerance) for tolerance in TOLERANCES[:4]),
    SolverCase("Radau"),
    SolverCase("Radau", 1e-6, 1e-9),
    *(SolverCase("RK45", max_step_s=h) for h in (0.02, 0.005, 0.001)),
    *(SolverCase("Rosenbrock23", max_step_s=h) for h in (0.02, 0.005, 0.001)),
]
STEPS_S = (0.02, 0.01, 0.005, 0.0025, 0.00125)


def problem(recording: Path | None) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Start (4,), times, torque and a name."""
    if recording is None:
        return np.zeros(4), TICK_S * np.arange(SAMPLES + 1), two_level_torque(SAMPLES, SEED), "random two-level torque"
    found = load(recording)
    # as the thesis starts: what was measured first, the ball's speed 0
    x0 = np.nan_to_num([found.theta[0], found.dtheta[0], found.psi[0], 0.0])
    return np.asarray(x0), found.t, found.u[:-1], found.source


def table(found: Study) -> list[dict[str, Any]]:
    """One row for each way to integrate."""
    rows = [(case.text, run.steps, run.evaluations, run.x) for case, run in found.across.items()]
    span = found.t[-1] - found.t[0]
    for h, x in found.by_step.items():
        rows.append((f"Runge-Kutta 4, sample to sample, {1e3 * h:g} ms", round(span / h), round(4 * span / h), x))
    out = []
    for name, steps, evaluations, x in rows:
        theta, dtheta, psi, _ = np.abs(x - found.truth).max(axis=0)
        out.append({"how": name, "steps": steps, "evaluations": evaluations})
        out[-1] |= {"theta_rad": float(theta), "dtheta_rad_s": float(dtheta), "psi_rad": float(psi)}
    return out


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("--recording", "--figure", "--json"):
        parser.add_argument(name, type=Path)
    options = parser.parse_args()
    plant = plant_of(load_model(MODEL))
    stiff = stiffness(plant)
    print("eigenvalues 1/s:", ", ".join(f"{z:.4f}" for z in stiff.eigenvalues))
    print(f"ratio of decay rates {stiff.ratio:.2f}; explicit steps are stable up to {stiff.largest_step_s:.3f} s")
    x0, t, u, name = problem(options.recording)
    found = study(plant, x0, t, u, CASES, STEPS_S)
    radau = sample_to_sample(plant, x0, t, u, "Radau", rtol=1e-10, atol=1e-12)
    agreement = float(radau.largest_error(found.truth).max())
    print(f"{name}: Radau and DOP853, started anew at every sample, differ by {agreement:.1e} at most")
    print(
        f"{'largest error over the run':<46} {'steps':>6} {'evals':>7} {'theta rad':>10} {'dtheta':>10} {'psi rad':>10}"
    )
    rows = table(found)
    for row in rows:
        errors = " ".join(f"{row[key]:>10.2g}" for key in ("theta_rad", "dtheta_rad_s", "psi_rad"))
        print(f"{row['how']:<46} {row['steps']:>6} {row['evaluations']:>7} {errors}")
    if options.figure is not None:
        save(draw_solver_question(found, f"Solvers and a held torque: {name}"), options.figure)
    if options.json is not None:
        result = {"torque": name, "ratio": stiff.ratio, "restarted_agree": agreement, "rows": rows}
        options.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
