"""The likelihood through gaps is that of the joint density, and the Kalman filter's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from hoopd.ident.gaplikelihood import likelihood_errors, stretch
from hoopd.ident.models import Innovations

Array = np.ndarray


def model(seed: int = 0, nx: int = 3, ny: int = 2, nu: int = 1) -> Innovations:
    rng = np.random.default_rng(seed)
    a, c, k = rng.standard_normal((nx, nx)), rng.standard_normal((ny, nx)), rng.standard_normal((nx, ny))
    a *= 0.9 / np.abs(np.linalg.eigvals(a)).max()
    k *= 0.2
    while np.abs(np.linalg.eigvals(a - k @ c)).max() > 0.95:
        k *= 0.5
    root = rng.standard_normal((ny, ny)) + 2.0 * np.eye(ny)
    return Innovations(
        a, rng.standard_normal((nx, nu)), c, rng.standard_normal((ny, nu)), k, 1.0, r=root @ root.T
    )  # fmt: skip


def by_joint_density(m: Innovations, y: Array, u: Array, wide: float) -> float:
    """-2 log density of the outputs that were measured, the start normal with covariance wide I; nothing recursive."""
    n, ny, nx = len(y), m.ny, m.nx
    of_x, of_e, of_u = np.zeros((n * ny, nx)), np.zeros((n * ny, n * ny)), np.zeros(n * ny)
    x, powers = np.zeros(nx), [np.eye(nx)]
    for t in range(n):
        rows = slice(t * ny, (t + 1) * ny)
        of_x[rows] = m.c @ powers[-1]
        for s in range(t):
            of_e[rows, s * ny : (s + 1) * ny] = m.c @ powers[t - 1 - s] @ m.k
        of_e[rows, rows] = np.eye(ny)
        of_u[rows] = m.c @ x + m.d @ u[t]
        x = m.a @ x + m.b @ u[t]
        powers.append(m.a @ powers[-1])
    assert m.r is not None
    cov = of_e @ np.kron(np.eye(n), m.r) @ of_e.T + wide * of_x @ of_x.T
    seen = np.isfinite(y.ravel())
    e, cov = (y.ravel() - of_u)[seen], cov[np.ix_(seen, seen)]
    return float(e @ linalg.solve(cov, e, assume_a="pos") + np.linalg.slogdet(cov)[1])


@pytest.mark.parametrize("holes", [(), (3,), (0, 7, 8, 9, 21, 39), (38, 39)])
def test_differences_are_those_of_the_joint_density(holes: tuple[int, ...]) -> None:
    rng = np.random.default_rng(1)
    y, u = rng.standard_normal((40, 2)), rng.standard_normal((40, 1))
    for t in holes:
        y[t, t % 2] = np.nan
    y[12] = np.nan
    one, other = model(0), model(1)
    wide = 1e7
    wanted = [by_joint_density(m, y, u, wide) for m in (one, other)]
    data = [stretch(y, u)]
    found = []
    for m in (one, other):
        errors = likelihood_errors(m, data)
        found.append(sum(float(np.sum(e**2)) for e in errors.errors) + errors.deviance)
    assert found[0] - found[1] == pytest.approx(wanted[0] - wanted[1], rel=1e-4)


def test_from_rest_it_is_the_joint_density_itself() -> None:
    rng = np.random.default_rng(2)
    y, u = rng.standard_normal((30, 2)), rng.standard_normal((30, 1))
    y[[4, 5, 17], 0] = np.nan
    errors = likelihood_errors(model(), [stretch(y, u)], free_start=False)
    said = sum(float(np.sum(e**2)) for e in errors.errors) + errors.deviance
    assert said == pytest.approx(by_joint_density(model(), y, u, 0.0), rel=1e-9)


def test_stretches_of_one_length_are_taken_together_and_count_alike() -> None:
    rng = np.random.default_rng(3)
    parts = [stretch(rng.standard_normal((n, 2)), rng.standard_normal((n, 1))) for n in (20, 20, 31, 20)]
    whole = likelihood_errors(model(), parts)
    each = [likelihood_errors(model(), [one]) for one in parts]
    assert whole.deviance == pytest.approx(sum(one.deviance for one in each))
    for i, one in enumerate(each):
        assert np.allclose(whole.errors[i], one.errors[0])
