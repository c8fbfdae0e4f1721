"""Is the plant stiff? No: steps from sample to sample converge, adaptive steps across the jumps of the torque do not.

The thesis saw two adaptive solvers differ and took the stiff one; see docs/explanations/solver.md.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from shared import shared_path

from hoopd.plants.hoop.fitting.solver_comparison import (
    SolverCase,
    Study,
    across_jumps,
    sample_to_sample,
    stiffness,
    study,
    two_level_torque,
)
from hoopd.plants.model_file import load_model, plant_of
from hoopd.plots.solver import draw_solver_question
from hoopd.plots.style import rendered
from hoopd.recording import load

ROOT = Path(__file__).resolve().parents[2]
PLANT = plant_of(load_model(ROOT / "config" / "models" / "thesis.yaml"))
STEPS_S = (0.02, 0.01, 0.005, 0.0025)
LOOSE = (SolverCase("RK45"), SolverCase("Rosenbrock23"))
TIGHT = (SolverCase("RK45", 1e-7, 1e-10), SolverCase("Rosenbrock23", 1e-5, 1e-8))


@pytest.fixture(scope="module")
def made() -> Study:
    """Ten seconds of a seeded torque."""
    samples = 500
    return study(PLANT, np.zeros(4), 0.02 * np.arange(samples + 1), two_level_torque(samples), LOOSE + TIGHT, STEPS_S)


@pytest.fixture(scope="module")
def real() -> Study:
    """The torque with which the thesis saw it."""
    found = load(shared_path("recordings/meas_hoopAndBall2_01.mat"))
    x0 = np.array([found.theta[0], found.dtheta[0], found.psi[0], 0.0])
    return study(PLANT, x0, found.t, found.u[:-1], LOOSE + TIGHT, STEPS_S)


def errors(found: Study, case: SolverCase) -> np.ndarray:
    return found.across[case].largest_error(found.truth)


@pytest.mark.proof
def test_steps_from_sample_to_sample_converge_with_order_four(made: Study) -> None:
    worst = np.array([np.abs(made.by_step[h] - made.truth).max(axis=0) for h in STEPS_S])
    orders = np.log2(worst[:-1] / worst[1:])
    assert (np.abs(orders - 4.0) < 0.2).all(), orders
    assert worst[1].max() < 1e-4, "the step that is used: rad and rad/s"


@pytest.mark.proof
def test_other_methods_agree_when_started_anew_at_every_sample(made: Study) -> None:
    """Explicit and implicit, the same to 1e-9: the answer does not depend on the solver."""
    samples = 150
    t, u = made.t[: samples + 1], made.u[:samples]
    radau = sample_to_sample(PLANT, np.zeros(4), t, u, "Radau", rtol=1e-11, atol=1e-13)
    assert radau.largest_error(made.truth[: samples + 1]).max() < 1e-9


def test_solvers_that_step_over_the_jumps_differ(made: Study) -> None:
    judge_jumps(made)


@pytest.mark.proof
def test_solvers_that_step_over_the_jumps_of_the_real_torque_differ(real: Study) -> None:
    judge_jumps(real)


def judge_jumps(found: Study) -> None:
    """With default tolerances they are radians away from the truth and from one another; tolerance heals both."""
    explicit, stiff = (found.across[case] for case in LOOSE)
    assert np.abs(explicit.x - stiff.x)[:, 0].max() > 1.0
    assert errors(found, LOOSE[0])[0] > 3.0
    assert errors(found, LOOSE[1])[0] > 0.05
    for loose, tight in zip(LOOSE, TIGHT, strict=True):
        assert (errors(found, tight) < errors(found, loose) / 10.0).all()
        assert errors(found, tight)[0] < 0.02


def test_a_bound_on_the_step_helps_and_still_is_worse_than_no_jump_at_all(made: Study) -> None:
    bounded = [
        across_jumps(PLANT, np.zeros(4), made.t, made.u, SolverCase("RK45", max_step_s=h)).largest_error(made.truth)[0]
        for h in (0.02, 0.002)
    ]
    assert errors(made, LOOSE[0])[0] > 3.0 * bounded[0] > 9.0 * bounded[1]
    assert bounded[1] > 1e3 * np.abs(made.by_step[0.02] - made.truth)[:, 0].max()


def test_with_a_constant_torque_the_errors_are_what_the_tolerance_promises(made: Study) -> None:
    """The same solvers, tolerances and plant without jumps: the jumps are the cause."""
    u = np.full(len(made.u), 0.05)
    truth = sample_to_sample(PLANT, np.zeros(4), made.t, u, "DOP853").x
    for case in LOOSE:
        worst = across_jumps(PLANT, np.zeros(4), made.t, u, case).largest_error(truth)
        assert worst[0] < 0.01 and worst[2] < 0.02, case
        assert (worst < errors(made, case) / 5.0).all(), case


def test_the_plant_is_not_stiff() -> None:
    found = stiffness(PLANT)
    assert found.ratio == pytest.approx(0.4816611437370447 / 0.167663694405211)
    assert found.ratio < 10.0
    assert found.largest_step_s > 10 * 0.02


def test_rosenbrock_has_order_two() -> None:
    """On a torque without jumps, with a fixed step: halving it quarters the error."""
    t, u = np.linspace(0.0, 2.0, 101), np.full(100, 0.1)
    x0 = np.array([0.0, 0.0, 0.5, 0.0])
    truth = sample_to_sample(PLANT, x0, t, u, "DOP853").x
    runs = [across_jumps(PLANT, x0, t, u, SolverCase("Rosenbrock23", 1.0, 1.0, h)) for h in (0.01, 0.005, 0.0025)]
    # the start's small steps are few
    worst = np.array([np.abs(run.x[-1] - truth[-1]).max() for run in runs])
    assert (np.abs(np.log2(worst[:-1] / worst[1:]) - 2.0) < 0.3).all(), worst


def test_the_figure_is_drawn_and_the_page_says_what_the_command_prints(made: Study) -> None:
    assert len(rendered(draw_solver_question(made, "made"), ".png")) > 20_000
    page = (ROOT / "docs" / "explanations" / "solver.md").read_text(encoding="utf-8")
    assert "tools/bench/solver.py" in page and f"{stiffness(PLANT).ratio:.2f}" in page
    # the whole table is printed by the command; here the row that matters most is computed anew
    samples = 1000
    full = study(PLANT, np.zeros(4), 0.02 * np.arange(samples + 1), two_level_torque(samples), LOOSE[:1], (0.01,))
    row = next(line for line in page.splitlines() if re.match(r"\| RK45, rtol 0.001 \|", line))
    said = [float(cell) for cell in row.split("|")[-4:-1]]
    # so loose a solution has lost its way among the jumps: how far it strays hangs on the processor's last bits
    assert (np.abs(np.log(np.array(said) / errors(full, LOOSE[0])[:3])) < np.log(4.0)).all()
