"""Rational functions of frequency responses."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest
from scipy.linalg import block_diag

from hoopd.ident.bases import laguerre
from hoopd.ident.frequencydata import frequency_response
from hoopd.ident.rationalfit import fit_basis_response, minimum_phase, rational
from hoopd.ident.vectorfit import rational_matrix

W = np.geomspace(0.01, 100.0, 300)
PLANT = ct.tf([3.0, 2.0, 30.0], np.polymul([1.0, 0.1, 4.0], [1.0, 1.0, 100.0]))


def measured(system: ct.TransferFunction, noise: float = 0.0, seed: int = 0) -> ct.FRD:
    rng = np.random.default_rng(seed)
    error = noise * (rng.standard_normal(len(W)) + 1j * rng.standard_normal(len(W)))
    return ct.FRD(system(1j * W) * np.exp(error), W)


def same(one: ct.TransferFunction, other: ct.TransferFunction, within: float) -> bool:
    return bool(np.abs(np.log(one(1j * W) / other(1j * W))).max() < within)


@pytest.mark.parametrize("stable", [False, True])
@pytest.mark.parametrize("phase", [False, True])
def test_exact_data_give_the_system(stable: bool, phase: bool) -> None:
    found = rational(measured(PLANT), 4, 2, stable=stable, phase=phase)
    assert same(found.system, PLANT, 1e-5) and found.rms < 1e-6
    assert np.allclose(np.sort(found.system.poles().imag), np.sort(PLANT.poles().imag), atol=1e-5)


def test_a_guess_brings_its_orders() -> None:
    guess = ct.tf([1.0, 1.0, 1.0], [1.0, 1.0, 1.0, 1.0, 1.0])
    assert same(rational(measured(PLANT), guess).system, PLANT, 1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_noise_of_so_much_leaves_an_error_of_so_much(seed: int) -> None:
    found = rational(measured(PLANT, 0.1, seed), 4, 2, phase=True)
    assert found.rms == pytest.approx(0.1 * np.sqrt(2.0), rel=0.15) and same(found.system, PLANT, 0.25)


def test_an_unstable_response_is_fitted_as_it_is_or_made_stable() -> None:
    wrong = ct.tf([1.0, 3.0], [1.0, -0.4, 4.0])
    assert rational(measured(wrong), 2, 1).system.poles().real == pytest.approx([0.2, 0.2], abs=1e-6)
    forced = rational(measured(wrong), 2, 1, stable=True)
    assert forced.system.poles().real.max() < 0.0 and np.abs(forced.error.real).max() < 1e-3


def test_minimum_phase_keeps_gain_and_sign() -> None:
    for system in (ct.tf([-1.0, 2.0], [1.0, -0.4, 4.0]), ct.tf([1.0, -1.5], [1.0, -0.4, 0.3], 0.1)):
        found = minimum_phase(system)
        w = np.linspace(0.1, 10.0, 20)
        assert np.allclose(
            np.abs(ct.frequency_response(found, w).complex), np.abs(ct.frequency_response(system, w).complex)
        )
        assert np.sign(found.dcgain()) == np.sign(system.dcgain())
        edge = 1.0 if found.dt else 0.0
        place = np.abs if found.dt else np.real
        assert max(place(found.poles()).max(), place(found.zeros()).max()) < edge


def test_a_basis_fits_a_gain() -> None:
    plant = ct.tf([2.0, 1.0], [1.0, 1.4, 2.0])
    found = fit_basis_response(measured(plant), laguerre(-1.5, 12), phase=True)
    assert found.rms < 0.02 and np.abs(found.error[:200]).max() < 0.02
    direct = fit_basis_response(measured(1.0 + plant), laguerre(-1.5, 12), direct=True)
    assert direct.rms < 1e-3 and direct.system.D[0, 0] == pytest.approx(1.0, abs=0.01)


def test_what_cannot_be_fitted_is_refused() -> None:
    with pytest.raises(ValueError, match="3 frequencies for 4 poles"):
        rational(ct.FRD([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]), 4, 3)
    with pytest.raises(ValueError, match="nowhere zero"):
        rational(ct.FRD([1.0, 0.0, 3.0], [1.0, 2.0, 3.0]), 1)
    with pytest.raises(ValueError, match="one input and output"):
        rational(ct.FRD(np.ones((1, 2, 3)), [1.0, 2.0, 3.0]), 1)


def test_a_sampled_response_gives_the_continuous_system_behind_its_hold() -> None:
    true, step = ct.tf([4.0], [1.0, 0.4, 4.0]), 0.3
    w = np.linspace(0.1, np.pi / step, 60)
    sampled = ct.FRD(ct.ss(ct.sample_system(ct.ss(true), step, "zoh"))(np.exp(1j * w * step)), w, step)
    found = rational(sampled, 2, 0)
    assert np.allclose(found.system.den[0][0], [1.0, 0.4, 4.0], rtol=1e-4) and found.rms < 1e-6
    weights = np.ones(len(w))
    weights[-1] = 0.0
    assert np.allclose(rational(sampled, 2, 0, weight=weights, phase=True).system.num[0][0], [4.0], rtol=1e-4)
    as_it_is = rational(sampled, 2, 0, hold=False)
    assert as_it_is.system.den[0][0][1] == pytest.approx(0.33, abs=0.02)
    with pytest.raises(ValueError, match="a hold wants"):
        rational(measured(true), 2, 0, hold=True)


@pytest.mark.parametrize("direct", [False, True])
def test_a_matrix_of_responses_has_common_poles(direct: bool) -> None:
    rng = np.random.default_rng(0)
    a = block_diag([[-0.1, 2.0], [-2.0, -0.1]], [[-0.5, 9.0], [-9.0, -0.5]], [[-1.0]])
    truth = ct.ss(a, rng.standard_normal((5, 2)), rng.standard_normal((3, 5)), np.ones((3, 2)) * direct)
    w = np.geomspace(0.05, 100.0, 120)
    exact = frequency_response(truth, w)
    found = rational_matrix(exact, poles=5, direct=direct)
    assert found.rms < 1e-7
    for pole in truth.poles():
        assert np.abs(found.system.poles() - pole).min() < 1e-5
    assert np.allclose(found.system(1j * w[::20]), truth(1j * w[::20]), atol=1e-6)
    noisy = ct.FRD(exact.frdata * (1.0 + 0.02 * rng.standard_normal(exact.frdata.shape)), w)
    again = rational_matrix(noisy, poles=5, direct=direct)
    assert again.rms < 0.05 and (again.system.poles().real < 0.0).all()


def test_what_no_matrix_is_fitted_to() -> None:
    w = np.geomspace(0.1, 10.0, 5)
    exact = frequency_response(ct.tf([1.0], [1.0, 1.0]), w)
    with pytest.raises(ValueError, match="5 frequencies for 9 poles"):
        rational_matrix(exact, poles=9)
    with pytest.raises(ValueError, match="continuous response"):
        rational_matrix(frequency_response(ct.tf([1.0], [1.0, -0.5], 0.1), w), poles=1)
    with pytest.raises(ValueError, match="no entry zero"):
        rational_matrix(ct.FRD(np.zeros((1, 1, 5)), w), poles=1)
