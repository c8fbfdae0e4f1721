"""Chapter 3: inputs, measured signals and free runs of both experiments; what the choice of a solver does.

Rules of this file: takes from the bench, computes with `hoopd.ident`, draws with `hoopd.plots`.
"""

from __future__ import annotations

import numpy as np

from hoopd.plants.hoop.fitting.fit_percent import FitScore
from hoopd.plants.hoop.fitting.solver_comparison import SolverCase, study
from hoopd.plants.hoop.thesis import ENTRIES_PRINTED
from hoopd.plots.fits import draw_fits
from hoopd.plots.solver import draw_solver_question
from thesis.records import HOOP_ALONE, SOURCES, Bench, thesis_plant
from thesis.results import Drawn, Row

WORDS = {"theta_rate": "hoop speed", "psi": "ball angle"}
SOLVERS = [
    *(SolverCase("RK45", r, 1e-3 * r) for r in (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)),
    *(SolverCase("Rosenbrock23", r, 1e-3 * r) for r in (1e-3, 1e-4, 1e-5, 1e-6)),
]
DETAILED, DETAIL_S = ("second",), 10.0
STEPS_S = (0.02, 0.01, 0.005, 0.0025, 0.00125)


def fits(bench: Bench, key: str) -> Drawn:
    """One experiment: measured, thesis's entries, entries re-estimated."""
    scores = bench.scores(key)
    title = f"{bench.words(key)} ({bench.origin(key)})"
    recordings = bench.parts(key)
    begin, end = float(recordings[0].t[0]), float(recordings[-1].t[-1])
    middle = (begin + end) / 2.0
    detail = (middle - DETAIL_S / 2, middle + DETAIL_S / 2) if key in DETAILED and end - begin > 3 * DETAIL_S else None
    caption = f"{bench.words(key)}: torque, measured signals and one free run of each model over each stretch."
    if HOOP_ALONE.items() <= SOURCES[key].values.items():
        caption += " The repository's entries are those that it found for the hoop alone: J11 -0.28, L1 658.8."
    rows = (*_fit_rows(scores), *_entry_rows(bench, key))
    return Drawn(
        draw_fits(recordings, scores, title, detail_s=detail),
        f"{caption}{_set_aside(scores)} {bench.note(key)}".strip(),
        rows,
    )


def _set_aside(scores: dict[str, list[FitScore]]) -> str:
    found = [one.channels["psi"].set_aside for one in next(iter(scores.values())) if "psi" in one.channels]
    return f" {sum(found)} pictures in which the camera repeated its last angle are set aside." if sum(found) else ""


def _fit_rows(scores: dict[str, list[FitScore]]) -> list[Row]:
    return [
        Row(f"{words}, {model}", ", ".join(f"{one.channels[name].nrmse_percent:.1f} %" for one in several))
        for name, words in WORDS.items()
        for model, several in scores.items()
        if name in several[0].channels
    ]


def _entry_rows(bench: Bench, key: str) -> list[Row]:
    found = bench.fitted(key)
    return [
        Row(name, f"{found.values[name]:.4g} [{low:.4g}, {high:.4g}]", f"{ENTRIES_PRINTED[name]:.4g}")
        for name, (low, high) in found.intervals.items()
    ]


def solver_question(bench: Bench) -> Drawn:
    """Adaptive solvers across the jumps of the recorded torque, and integration from sample to sample."""
    recording = bench.whole("first")
    t, u = recording.t, recording.u[:-1]
    x0 = np.nan_to_num([recording.theta[0], recording.dtheta[0], recording.psi[0], 0.0])
    bench.say("integrating with two solvers at several tolerances")
    found = study(thesis_plant(), x0, t, u, SOLVERS, STEPS_S)
    errors = {case.method: run.largest_error(found.truth)[0] for case, run in found.across.items() if case.rtol == 1e-3}
    by_step = np.abs(found.by_step[0.01] - found.truth).max(axis=0)[0]
    rows = (
        Row("largest error of the hoop angle, RK45 (Tsit5's kind)", f"{errors['RK45']:.2g} rad", "taken for stiffness"),
        Row("the same, Rosenbrock23", f"{errors['Rosenbrock23']:.2g} rad", "taken for the truth"),
        Row("the same, sample to sample at 10 ms", f"{by_step:.1g} rad"),
    )
    caption = (
        "Two adaptive solvers stepping over the jumps of the held torque (default tolerances), the converged run, "
        "and what the error costs. Both solvers of the thesis are wrong; the plant is not stiff (docs/explanations/"
        "solver.md)."
    )
    return Drawn(draw_solver_question(found, f"Solvers and a held torque ({bench.origin('first')})"), caption, rows)
