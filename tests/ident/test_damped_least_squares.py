"""The one damped least-squares search: it ends where a dense solver ends, by its own rules, and nowhere else."""

from __future__ import annotations

import ast
import doctest
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

import hoopd
from hoopd.ident import damped_least_squares
from hoopd.ident.damped_least_squares import (
    Damping,
    Ends,
    NormalEquations,
    Result,
    Starts,
    StartsEliminated,
    minimise,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Point:
    x: Array
    cost: float


def rosenbrock(x: Array) -> tuple[Array, Array]:
    """A bent valley: residuals and derivatives."""
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]), np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


def searched(start: Array, damping: Damping | None = None, ends: Ends | None = None) -> Result[Point]:
    def at(x: Array) -> Point:
        e = rosenbrock(x)[0]
        return Point(x, float(e @ e))

    def linearised(point: Point) -> NormalEquations:
        e, j = rosenbrock(point.x)
        return NormalEquations(j.T @ j, j.T @ e)

    return minimise(at(start), linearised, lambda point, step: at(point.x + step), damping, ends)


def test_the_example_holds() -> None:
    assert doctest.testmod(damped_least_squares).failed == 0


@pytest.mark.parametrize("damping", [Damping(), Damping(first=0.0, easier=0.1, harder=10.0, again=1e-4)])
def test_a_bent_valley_is_followed_to_its_end(damping: Damping) -> None:
    found = searched(np.array([-1.2, 1.0]), damping, Ends(exact=1e-28))
    assert found.converged
    assert found.point.x == pytest.approx([1.0, 1.0], abs=1e-10)


def test_too_few_steps_are_no_end() -> None:
    found = searched(np.array([-1.2, 1.0]), None, Ends(steps=3))
    assert (found.steps, found.converged) == (3, False)


def test_a_search_that_no_step_helps_says_whether_it_was_at_its_end() -> None:
    def linearised(point: Point) -> NormalEquations:
        return NormalEquations(np.eye(1), np.ones(1))  # promises a gain that there is not

    worse = Point(np.ones(1), 2.0)
    ends = Ends(stuck=1e-5)
    assert not minimise(Point(np.zeros(1), 1.0), linearised, lambda p, s: worse, None, ends).converged
    flat = minimise(
        Point(np.zeros(1), 1.0), lambda p: NormalEquations(np.eye(1), np.zeros(1)), lambda p, s: worse, None, ends
    )
    assert flat.converged


def test_a_start_that_runs_away_is_refused() -> None:
    with pytest.raises(ArithmeticError, match="runs away"):
        minimise(Point(np.zeros(1), np.inf), lambda p: NormalEquations(np.eye(1), np.zeros(1)), lambda p, s: p)


def test_eliminated_starts_give_the_step_of_the_whole_matrix() -> None:
    """Three experiments with two unknowns of their own, four in common."""
    rng = np.random.default_rng(3)
    by_p, by_s, e = rng.normal(size=(3, 9, 4)), rng.normal(size=(3, 9, 2)), rng.normal(size=(3, 9))
    whole = np.zeros((27, 10))
    whole[:, :4] = by_p.reshape(27, 4)
    for k in range(3):
        whole[9 * k : 9 * k + 9, 4 + 2 * k : 6 + 2 * k] = by_s[k]
    expected = np.linalg.lstsq(whole, -e.ravel(), rcond=None)[0]
    group = Starts(
        np.einsum("bki,bkj->bij", by_s, by_s), np.einsum("bki,bkj->bij", by_s, by_p), np.einsum("bki,bk->bi", by_s, e)
    )
    equations = StartsEliminated(
        np.einsum("bki,bkj->ij", by_p, by_p), np.einsum("bki,bk->i", by_p, e), [group]
    )  # fmt: skip
    step, (moves,) = equations.step(0.0)
    assert np.concatenate([step, moves.ravel()]) == pytest.approx(expected, rel=1e-9)
    gain = float(e.ravel() @ e.ravel() - np.sum((e.ravel() + whole @ expected) ** 2))
    assert equations.promised(0.0) == pytest.approx(gain, rel=1e-9)


def test_it_ends_where_a_dense_solver_ends() -> None:
    dense = least_squares(lambda x: rosenbrock(x)[0], [-1.2, 1.0], lambda x: rosenbrock(x)[1], xtol=1e-15)
    assert searched(np.array([-1.2, 1.0])).point.x == pytest.approx(dense.x, abs=1e-8)


def test_nobody_damps_a_search_of_his_own() -> None:
    """Outside of the one search no loop changes a damping."""
    root, wrong = Path(hoopd.__file__).parent, []
    for path in root.rglob("*.py"):
        if path.name == "damped_least_squares.py":
            continue
        loops = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.For | ast.While)]
        stored = {
            f"{path.relative_to(root)}:{name.lineno}"
            for loop in loops
            for name in ast.walk(loop)
            if isinstance(name, ast.Name) and name.id == "damping" and isinstance(name.ctx, ast.Store)
        }
        wrong += sorted(stored)
    assert wrong == []
