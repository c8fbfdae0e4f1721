"""Basis functions: orthonormal whatever the poles, evaluated two ways, fitted to data."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest
from scipy import linalg

from hoopd.ident.bases import Basis, add_poles, kautz, laguerre, leadlag, orthonormal, pole
from hoopd.ident.basis_fit import fit_basis
from hoopd.ident.data import iddata

W = np.geomspace(0.01, 30.0, 50)


def gramian(basis: Basis) -> np.ndarray:
    own = basis.system
    solve = linalg.solve_discrete_lyapunov if basis.dt else linalg.solve_continuous_lyapunov
    return solve(own.A, own.B @ own.B.T * (1.0 if basis.dt else -1.0))


@pytest.mark.parametrize(
    "basis",
    [
        laguerre(-2.0, 6), laguerre(0.7, 5, 0.1), kautz([pole(3.0, 0.1), pole(5.0, 0.2)]),
        orthonormal([-1.0, -1.0 + 2.0j, -3.0, -1.0 - 2.0j]), orthonormal([0.5, 0.6 + 0.3j, -0.2], 0.1),
    ],
)  # fmt: skip
def test_the_functions_are_orthonormal_at_the_poles_asked_for(basis: Basis) -> None:
    assert np.allclose(gramian(basis), np.eye(len(basis)), atol=1e-10)
    assert np.allclose(np.poly(basis.system.A), np.poly(basis.poles), atol=1e-9 * np.abs(np.poly(basis.poles)).max())


def test_responses_are_those_of_the_textbook() -> None:
    s = 1j * W
    own = laguerre(-2.0, 4).responses(W)
    for k in range(4):
        assert np.allclose(own[:, k], 2.0 / (s + 2.0) * ((s - 2.0) / (s + 2.0)) ** k, atol=1e-12)
    pair = kautz([pole(3.0, 0.1)]).responses(W)
    assert np.allclose(pair, np.sqrt(1.2) * np.stack([s, 3.0 * np.ones(50)], 1) / (s**2 + 0.6 * s + 9.0)[:, None])
    lag = leadlag([1.0, 4.0]).responses(W)
    assert np.allclose(lag, np.stack([np.ones(50), 1.0 / (s + 1.0), 4.0 / (s + 4.0)], 1))


def test_filtering_is_the_response_of_the_system() -> None:
    u = np.random.default_rng(0).standard_normal(300)
    for basis, own in ((laguerre(0.6, 4, 0.1), 0.0), (leadlag([2.0]), 0.1)):
        system = basis.system if basis.dt else ct.c2d(basis.system, 0.1)
        assert np.allclose(basis.filtered(u, own), ct.forced_response(system, U=u).outputs.T, atol=1e-12)
    with pytest.raises(ValueError, match="give dt"):
        leadlag([2.0]).filtered(u)


def test_sums_and_further_poles() -> None:
    basis = add_poles(laguerre(-1.0, 3), [pole(2.0, 0.3)])
    assert len(basis) == 5 and np.allclose(gramian(basis), np.eye(5), atol=1e-10)
    assert len(add_poles(leadlag([1.0]), [-3.0])) == 3
    weights = np.array([1.0, -2.0, 0.5, 0.0, 3.0])
    assert np.allclose(ct.frequency_response(basis.combined(weights), W).complex, basis.responses(W) @ weights)
    with pytest.raises(ValueError, match="not stable"):
        laguerre(1.2, 2, 0.1)


@pytest.mark.parametrize("seed", range(3))
def test_a_basis_fits_data_with_gaps_as_well_as_its_errors_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    basis = orthonormal([0.8, 0.5 + 0.3j], 0.1)
    true = rng.standard_normal((2, 2, 3))
    u = rng.standard_normal((3000, 2))
    y = sum(basis.filtered(u[:, i]) @ true[:, i].T for i in range(2)) + 0.2 * rng.standard_normal((3000, 2))
    y[400:410, 0] = np.nan
    found = fit_basis(iddata(y, u, 0.1), basis)
    assert np.abs((found.coefficients - true) / found.deviation).max() < 4.0
    assert np.allclose(found.variance, 0.04, rtol=0.15) and found.system.ninputs == found.system.noutputs == 2
    with pytest.raises(ValueError, match="input u1 is constant"):
        fit_basis(iddata(y, 0.0 * u, 0.1), basis)


def test_a_pole_from_frequency_and_damping() -> None:
    assert pole(2.0, 0.5) == pytest.approx(-1.0 + 1j * np.sqrt(3.0))
    assert pole(2.0, 1.25) == pytest.approx(-4.0) or pole(2.0, 1.25) == pytest.approx(-1.0)
