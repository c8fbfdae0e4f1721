"""The graph of a sigma-point filter tells what the filter tells sample by sample, or there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from hoopd.ident.data import iddata
from hoopd.ident.statespace.filter_graph import PART, filter_graph
from hoopd.ident.statespace.nonlinear import nonlinear_pem
from hoopd.ident.statespace.unscented import NonlinearSystem, filtered

N = PART + 30


def tank(x: Any, u: Any, p: Any, t: float) -> Any:
    """Two tanks below each other, the upper one bounded."""
    out = p[0] * np.sqrt(np.maximum(x, 1e-6))
    return x + 0.1 * np.stack([np.clip(u[0], 0.0, 3.0) - out[0], out[0] - p[1] * out[1]])


def level(x: Any, u: Any, p: Any, t: float) -> Any:
    return np.where(x[1:] > 1e-3, x[1:], 0.0) + 1e-3 * np.sin(t)


def system(f: Callable[..., Any] = tank, h: Callable[..., Any] = level) -> NonlinearSystem:
    return NonlinearSystem(f, h, 2, 1, 1e-4 * np.eye(2), 4e-4 * np.eye(1), 0.1 * np.eye(2))


def record() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng, t = np.random.default_rng(0), 0.1 * np.arange(N)
    u = 1.0 + 0.8 * np.sign(np.sin(t))[:, None]
    x, y = np.array([1.0, 0.8]), np.empty((N, 1))
    for i in range(N):
        y[i] = level(x, u[i], [0.9, 1.2], t[i]) + 0.02 * rng.standard_normal()
        x = tank(x, u[i], [0.9, 1.2], t[i])
    y[40:60] = np.nan
    return y, u, t


def test_it_tells_what_numpy_tells_through_gaps_and_parts_for_several_sets() -> None:
    y, u, t = record()
    p = np.array([[0.9, 0.8, 1.1], [1.2, 1.0, 1.3]])
    x0 = np.array([[1.0, 1.2, 0.9], [0.8, 0.8, 0.7]])
    graph = filter_graph(system(), y, u, t, p[:, 0], x0[:, 0])
    assert graph is not None
    errors, states = graph.run(y, u, t, p, x0)
    own = filtered(system(), y, u, t, p, x0)
    np.testing.assert_allclose(errors, own.e, atol=1e-9)
    np.testing.assert_allclose(states, own.x, atol=1e-9)


def test_what_is_lost_stays_lost_though_the_equations_bound_the_state() -> None:
    def bounded(x: Any, u: Any, p: Any, t: float) -> Any:
        return np.maximum(tank(x, u, p, t), 0.0)

    y, u, t = record()
    p, x0 = np.array([0.9, 1.2]), np.array([1.0, 0.8])
    graph = filter_graph(system(bounded), y, u, t, p, x0)
    assert graph is not None
    broken = replace(graph, system=replace(graph.system, spread=-0.1 * np.eye(2)))
    errors, _ = broken.run(y, u, t, p[:, None], x0[:, None])
    assert np.isnan(errors).all()


def branching(x: Any, u: Any, p: Any, t: float) -> Any:
    return tank(x, u, p, t) if t < 5.0 else 1.01 * tank(x, u, p, t)


def tabled(x: Any, u: Any, p: Any, t: float) -> Any:
    return tank(x, np.interp(u, [0.0, 1.0, 2.0], [0.0, 1.0, 2.0]), p, t)


class Changing:
    """Not a function of its arguments: every call adds a little."""

    calls = 0

    def __call__(self, x: Any, u: Any, p: Any, t: float) -> Any:
        self.calls += 1
        return tank(x, u, p, t) + 1e-3 * self.calls


@pytest.mark.parametrize("f", [branching, tabled, Changing()])
def test_what_cannot_be_followed_has_no_graph(f: Callable[..., Any]) -> None:
    y, u, t = record()
    assert filter_graph(system(f), y, u, t, np.array([0.9, 1.2]), np.array([1.0, 0.8])) is None


def by_columns(x: Any, u: Any, p: Any, t: float) -> Any:
    assert np.ndim(x) == 1
    return tank(x, u, p, t)


def casadi_tank() -> ca.Function:
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p", 2)
    out = p[0] * ca.sqrt(ca.fmax(x, 1e-6))
    return ca.Function("f", [x, u, p], [x + 0.1 * ca.vertcat(u - out[0], out[0] - p[1] * out[1])])


@pytest.mark.parametrize(
    ("f", "more"), [(tank, {}), (by_columns, {"vectorised": False}), (casadi_tank(), {}), (tabled, {})]
)
def test_every_way_to_write_the_equations_gives_one_estimate(f: Any, more: dict[str, bool]) -> None:
    y, u, _ = record()
    data = iddata(y, u, 0.1)[:300]
    found = nonlinear_pem(data, f, level, [0.7, 1.0], [1.0, 1.0], process=1e-4, measurement=4e-4, **more)
    assert np.abs(found.p - [0.9, 1.2]).max() < 4.0 * max(found.deviations().values()) < 0.4
    again = nonlinear_pem(data, tank, level, [0.7, 1.0], [1.0, 1.0], process=1e-4, measurement=4e-4)
    np.testing.assert_allclose(found.p, again.p, rtol=1e-4)
