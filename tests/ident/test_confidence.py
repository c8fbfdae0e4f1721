"""Standard errors of responses, poles and zeros: of one model in two forms, and against the scatter over data."""

from __future__ import annotations

import numpy as np
import pytest

from hoopd.ident.confidence import pole_spread, response_spread, zero_spread
from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations
from hoopd.ident.polynomial.arx import arx, varx
from hoopd.ident.polynomial.pem import armax, bj, oe
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.uncertainty import pole_covariance, response_covariance

A, B, L = np.array([[0.7, 0.2], [-0.3, 0.6]]), np.array([1.0, 0.5]), np.array([[0.3, 0.0], [0.2, 0.1]])
W = np.array([0.1, 0.5, 2.0])


def made(seed: int, n: int = 400) -> Data:
    rng = np.random.default_rng(seed)
    u, e, y = rng.standard_normal(n), rng.standard_normal((n, 2)), np.zeros((n, 2))
    for k in range(1, n):
        y[k] = A @ y[k - 1] + B * u[k - 1] + L @ e[k]
    return iddata(y, u)


def test_regions_of_several_outputs_are_as_wide_as_the_scatter() -> None:
    gains, poles, zeros, said = [], [], [], []
    for seed in range(100):
        model = varx(made(seed), 1, 1)
        response, pole, zero = response_spread(model, W), pole_spread(model), zero_spread(model, 0)
        assert response is not None and pole is not None and zero is not None
        upper = int(np.argmax(pole.roots.imag))
        gains.append(np.abs(response.h[:, :, 0]))
        poles.append(pole.roots[upper])
        zeros.append(zero.roots[0].real)
        said.append((response.gain[:, :, 0], *np.diag(pole.covariances[upper]), zero.covariances[0, 0, 0]))
    relative = np.std(gains, axis=0) / np.mean(gains, axis=0)
    # the scatter of 100 is known to 7 %
    assert relative / np.mean([one[0] for one in said], axis=0) == pytest.approx(np.ones((3, 2)), abs=0.25)
    for seen, i in ((np.real(poles), 1), (np.imag(poles), 2), (np.array(zeros), 3)):
        assert np.std(seen) / np.sqrt(np.mean([one[i] for one in said])) == pytest.approx(1.0, abs=0.25)


def test_differences_give_what_the_formulas_of_a_state_space_give() -> None:
    model = pem(made(0), 2)
    response, pole = response_spread(model, W), pole_spread(model)
    assert response is not None and pole is not None
    wanted = response_covariance(model, W)
    # |dh|^2 is the same in both coordinates
    total = np.abs(response.h) ** 2 * (response.gain**2 + response.phase**2)
    assert np.allclose(total, np.trace(wanted, axis1=-2, axis2=-1), rtol=1e-4)
    assert np.allclose(pole.covariances, pole_covariance(model)[1], rtol=1e-4)


def test_every_form_has_a_region_and_a_model_without_covariance_none() -> None:
    data = made(1).channels([0])
    for model in (arx(data, 2, 2), armax(data, 2, 2, 1), oe(data, 2, 2), bj(data, 2, 1, 1, 2)):
        response, zero = response_spread(model, W), zero_spread(model, 0)
        assert response is not None and np.all(response.gain > 0.0) and np.all(response.phase > 0.0)
        assert zero is not None and len(zero.covariances) == len(zero.roots)
    plain = Innovations(A, B[:, None], np.eye(2), np.zeros((2, 1)), np.zeros((2, 2)), 1.0)
    assert response_spread(plain, W) is pole_spread(plain) is zero_spread(plain, 0) is None
