"""Smoothing against the conditional mean and covariance of all states at once, written out as one normal vector."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg

from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations
from hoopd.ident.smoothing import smooth

A = np.array([[0.9, 0.3, 0.0], [-0.2, 0.8, 0.1], [0.0, 0.0, 0.5]])
MODEL = Innovations(
    A, np.array([[0.0], [1.0], [0.5]]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]), np.array([[0.1], [0.0]]),
    np.array([[0.4, 0.1], [0.0, 0.3], [0.1, 0.0]]), 0.1, r=np.array([[0.3, 0.1], [0.1, 0.2]]),
)  # fmt: skip
Q, R = np.diag([0.1, 0.2, 0.05]), np.diag([0.3, 0.1])
P0 = np.diag([1.0, 2.0, 0.5])


def dense(data: Data, x0: np.ndarray, p0: np.ndarray, joint: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """E[x | y] (n, 3) and the covariances; joint (5, 5) is that of [w; v]."""
    n, nx = data.n, 3
    # x = first x0 + into (b u + w)
    powers = [np.linalg.matrix_power(A, k) for k in range(n)]
    into = np.block([[powers[t - j - 1] if t > j else np.zeros((nx, nx)) for j in range(n)] for t in range(n)])
    first, out = np.vstack(powers), np.kron(np.eye(n), MODEL.c)
    root = linalg.sqrtm(joint).real
    w, v = np.kron(np.eye(n), root[:nx]), np.kron(np.eye(n), root[nx:])
    columns = np.hstack([into @ w, first @ linalg.sqrtm(p0).real])
    mean = first @ x0 + into @ (data.u @ MODEL.b.T).ravel()
    seen = np.isfinite(data.y).ravel()
    y = (out @ columns + np.hstack([v, np.zeros((len(v), nx))]))[seen]
    rest = (data.y.ravel() - out @ mean - (data.u @ MODEL.d.T).ravel())[seen]
    gain = np.linalg.solve(y @ y.T, y @ columns.T).T
    cov = columns @ columns.T - gain @ y @ columns.T
    return (mean + gain @ rest).reshape(n, nx), np.array([cov[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(n)])


@pytest.fixture
def data() -> Data:
    rng = np.random.default_rng(0)
    y = rng.standard_normal((12, 2))
    y[3:6], y[8, 0] = np.nan, np.nan
    return iddata(y, rng.standard_normal(12), 0.1)


def test_states_are_the_conditional_means_of_unrelated_noises(data: Data) -> None:
    x0 = np.array([0.5, -1.0, 0.2])
    mean, cov = dense(data, x0, P0, linalg.block_diag(Q, R))
    found = smooth(replace(MODEL, r=None), data, x0, P0, noise=(Q, R))
    assert np.allclose(found.states, mean, atol=1e-8) and np.allclose(found.covariances, cov, atol=1e-8)
    assert np.allclose(found.outputs, mean @ MODEL.c.T + data.u @ MODEL.d.T, atol=1e-8)


def test_states_are_the_conditional_means_of_an_innovation_form(data: Data) -> None:
    both = np.vstack([MODEL.k, np.eye(2)])
    mean, cov = dense(data, np.zeros(3), P0, both @ MODEL.r @ both.T)
    found = smooth(MODEL, data, "zero", P0)
    assert np.allclose(found.states, mean, atol=1e-7) and np.allclose(found.covariances, cov, atol=1e-7)


def test_a_gap_is_bridged_from_both_sides() -> None:
    rng = np.random.default_rng(1)
    n, x = 400, np.zeros(3)
    u, w, v = rng.standard_normal((n, 1)), rng.standard_normal((n, 3)) * 0.1, rng.standard_normal((n, 2)) * 0.1
    states, y = np.empty((n, 3)), np.empty((n, 2))
    for i in range(n):
        states[i], y[i] = x, MODEL.c @ x + MODEL.d @ u[i] + v[i]
        x = A @ x + MODEL.b @ u[i] + w[i]
    y[200:204] = np.nan
    found = smooth(MODEL, iddata(y, u, 0.1), noise=(0.01 * np.eye(3), 0.01 * np.eye(2)))
    error = np.einsum("ni,nij,nj->n", states - found.states, np.linalg.inv(found.covariances), states - found.states)
    # chi-square with 3 degrees of freedom at each sample, and wider in the gap
    assert 2.5 < error[20:-20].mean() < 3.5 and error[200:204].max() < 20.0
    assert np.trace(found.covariances[202]) > 1.5 * np.trace(found.covariances[150])


def test_what_cannot_be_weighed_is_refused(data: Data) -> None:
    with pytest.raises(ValueError, match="does not know"):
        smooth(replace(MODEL, r=None), data)
    with pytest.raises(ValueError, match="of 3 states"):
        smooth(MODEL, data, noise=(np.eye(2), R))
    with pytest.raises(ValueError, match="x0 has 2 numbers"):
        smooth(MODEL, data, np.zeros(2))
