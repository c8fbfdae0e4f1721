"""The figure of the solver question: adaptive solvers across the jumps of a held torque, and steps between them.

Rules of this file: draws what it is given; an error is the largest difference from the converged run.
"""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hoopd.plants.hoop.fitting.solver_comparison import RTOL, SolverCase, Study
from hoopd.plots.style import BLACK, BLUE, GREY, SKY, VERMILION, figure, legend

LOOKS = {"RK45": (BLUE, "RK45 (ode45, as Tsit5)"), "Rosenbrock23": (VERMILION, "Rosenbrock23 (ode23s)")}
# Long enough for some samples, short enough to see single steps.
CLOSE_S = 0.6


def draw_solver_question(found: Study, title: str) -> Figure:
    """Steps against the torque, hoop and ball angle with the default tolerances, errors against effort."""
    made = figure(10.0, 7.0, rows=2, columns=2, title=title)
    steps, hoop, errors, ball = made.axes
    _steps(steps, found)
    _angle(hoop, found, 0, "hoop angle (rad)")
    _angle(ball, found, 2, "ball angle (rad)")
    _errors(errors, found)
    return made


def _defaults(found: Study) -> dict[str, SolverCase]:
    """The cases as a thesis would call them: nothing set."""
    return {case.method: case for case in found.across if case.rtol == RTOL and math.isinf(case.max_step_s)}


def _steps(axes: Axes, found: Study) -> None:
    start = found.t[0] + (found.t[-1] - found.t[0]) / 2
    axes.step(found.t[:-1], found.u, where="post", color=BLACK, linewidth=1.0, label="torque, held over 20 ms")
    level = float(np.abs(found.u).max())
    for row, (method, case) in enumerate(_defaults(found).items()):
        if method in LOOKS:
            times = found.across[case].times
            axes.plot(times, np.full(len(times), -1.35 * level - 0.3 * level * row), "|", color=LOOKS[method][0])
    axes.set_xlim(start, start + CLOSE_S)
    axes.set_ylim(-2.0 * level, 1.25 * level)
    axes.set_yticks([-level, 0.0, level])
    axes.set_title("ends of the solvers' steps below the torque", fontsize=10)
    axes.set_xlabel("time (s)")
    axes.set_ylabel("torque (N m)")


def _angle(axes: Axes, found: Study, state: int, label: str) -> None:
    axes.plot(found.t, found.truth[:, state], color=BLACK, linewidth=2.2, label="converged")
    for method, case in _defaults(found).items():
        if method in LOOKS:
            colour, name = LOOKS[method]
            axes.plot(found.t, found.across[case].x[:, state], color=colour, linewidth=1.1, label=name)
    axes.set_title(f"across the jumps, rtol {RTOL:g}", fontsize=10)
    axes.set_xlabel("time (s)")
    axes.set_ylabel(label)
    if state == 0:
        legend(axes)


def _errors(axes: Axes, found: Study) -> None:
    """Largest error of the hoop angle against derivative evaluations."""
    for method, (colour, name) in LOOKS.items():
        runs = [run for case, run in found.across.items() if case.method == method and math.isinf(case.max_step_s)]
        efforts = [run.evaluations for run in runs]
        axes.loglog(efforts, [run.largest_error(found.truth)[0] for run in runs], "o-", color=colour, label=name)
    span = found.t[-1] - found.t[0]
    steps = sorted(found.by_step, reverse=True)
    efforts = [round(4 * span / h) for h in steps]
    worst = [float(np.abs(found.by_step[h] - found.truth).max(axis=0)[0]) for h in steps]
    axes.loglog(efforts, worst, "s-", color=BLACK, label="RK4, sample to sample")
    slope = worst[0] * (np.array(efforts) / efforts[0]) ** -4.0
    axes.loglog(efforts, 3.0 * slope, "--", color=SKY, linewidth=1.0, label="order 4")
    axes.axhline(2 * math.pi / 4096, color=GREY, linewidth=0.8, linestyle=":")
    axes.annotate("one encoder count", (0.01, 2 * math.pi / 4096), xycoords=("axes fraction", "data"), ha="left",
                  va="bottom", fontsize=8.5, color=GREY)  # fmt: skip
    axes.set_title("largest error of the hoop angle against effort", fontsize=10)
    axes.set_xlabel("evaluations of the equations")
    axes.set_ylabel("error (rad)")
    axes.set_ylim(1e-11, 1e6)  # room for the legend above the curves
    legend(axes, loc="upper left", ncols=2)
