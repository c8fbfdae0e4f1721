"""Subspace estimates: the right system, order, gain; several experiments and gaps; what is wrong is said by name."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from harness.identcriteria import statespace as criteria
from harness.identcriteria.statespacesets import made, mimo4, mimo4k_gain, mimo_set, responses

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations
from hoopd.ident.statespace import inputs, windows
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.projection import WEIGHTINGS
from hoopd.ident.statespace.subspace import subspaceid

W = np.array([0.1, 0.25, 0.9, 2.0])


def off(model: Innovations, truth: Innovations) -> float:
    return float(np.abs(responses(model, W) - responses(truth, W)).max() / np.abs(responses(truth, W)).max())


def noisy(seed: int = 1, n: int = 1500) -> tuple[Data, Innovations]:
    rng = np.random.default_rng(seed)
    truth = replace(mimo4(), k=mimo4k_gain())
    return made(truth, rng.standard_normal((n, 2)), 0.2 * rng.standard_normal((n, 3))), truth


@pytest.mark.parametrize("number", [15, 16, 17, pytest.param(18, marks=pytest.mark.proof), 19, 50])
def test_a_criterion_holds(number: int) -> None:
    found = getattr(criteria, f"criterion_{number}")(3)
    assert all(value for value in found.values() if isinstance(value, bool | np.bool_)), found


@pytest.mark.parametrize(
    "weighting", [pytest.param(one, marks=[] if one == "CVA" else pytest.mark.proof) for one in WEIGHTINGS]
)
def test_every_weighting_finds_order_response_and_gain(weighting: str) -> None:
    data, truth = noisy()
    model = subspaceid(data, weighting=weighting)  # type: ignore[arg-type]
    assert model.nx == 4
    assert off(model, truth) < 0.05
    noise = [responses(replace(m, b=m.k, d=np.eye(3)), W) for m in (model, truth)]
    assert np.abs(noise[0] - noise[1]).max() / np.abs(noise[1]).max() < 0.25
    assert radius(model.a - model.k @ model.c) < 1.0
    assert model.r is not None
    assert np.allclose(np.sqrt(np.diag(model.r)), 0.2, rtol=0.15)


def test_moments_of_windows_are_those_of_the_windows() -> None:
    rng = np.random.default_rng(0)
    pieces = [rng.standard_normal((n, 3)) for n in (40, 9, 3)]
    rows = np.vstack([[z[i : i + 5].ravel() for i in range(len(z) - 4)] for z in pieces[:2]])
    order = rng.permutation(15)
    assert np.allclose(windows.moments(pieces, 5), rows.T @ rows)
    low = windows.factor(pieces, 5, order)
    assert np.allclose(low @ low.T, (rows.T @ rows)[np.ix_(order, order)])


def test_a_factor_of_data_without_noise_keeps_its_digits() -> None:
    rng = np.random.default_rng(0)
    z = np.repeat(rng.standard_normal((200, 1)), 2, axis=1) + 1e-9 * rng.standard_normal((200, 2))
    low = windows.factor([z], 2, np.arange(4))
    rows = np.hstack([z[:-1], z[1:]])
    assert np.isclose(np.abs(np.prod(np.diag(low))), np.prod(np.linalg.svd(rows)[1]), rtol=1e-4)


def test_several_experiments_and_gaps_lead_to_the_same_system() -> None:
    data, truth = noisy(2, 2400)
    y = data.y.copy()
    y[[300, 301, 900]] = np.nan
    whole = subspaceid([data[:1200], data[1200:]], 4)
    gaps = subspaceid(iddata(y, data.u), 4)
    assert off(whole, truth) < 0.05
    assert off(gaps, truth) < 0.05


def test_units_of_the_channels_do_not_matter() -> None:
    data, _ = noisy()
    scaled = iddata(data.y * [1e-4, 1.0, 1e3], data.u * [1e5, 1e-2])
    one, other = subspaceid(data, 4), subspaceid(scaled, 4)
    back = replace(other, c=other.c / np.array([[1e-4], [1.0], [1e3]]), b=other.b * [1e5, 1e-2])
    assert off(back, one) < 1e-6


def test_an_unstable_model_is_drawn_in_only_where_that_is_asked() -> None:
    rng = np.random.default_rng(4)
    one = np.ones((1, 1))
    data = made(
        Innovations(1.01 * one, one, one, 0 * one, 0.5 * one, 1.0),
        *(rng.standard_normal((2, 300, 1)) * [[[1.0]], [[0.1]]]),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert radius(subspaceid(data, 1).a) > 1.0
        assert radius(subspaceid(data, 1, stable=0.98).a) <= 0.98


def test_refining_comes_nearer_to_the_likeliest_model() -> None:
    own, _, truth = mimo_set(5, n=1500, gain=True)
    plain, refined = subspaceid(own, 4), subspaceid(own, 4, refine=3)
    assert plain.r is not None
    assert refined.r is not None
    assert np.linalg.det(refined.r) < np.linalg.det(plain.r)
    assert off(refined, truth) < 0.05


def test_a_single_sine_an_order_too_high_a_loop_and_an_integrator_are_named() -> None:
    rng = np.random.default_rng(0)
    one = np.ones((1, 1))
    first = Innovations(0.8 * one, one, one, 0 * one, 0 * one, 1.0)
    e = 0.1 * rng.standard_normal((600, 1))
    sine = made(first, np.sin(0.3 * np.arange(600.0))[:, None], e)
    with pytest.warns(IdentificationWarning, match="persistently exciting"):
        subspaceid(sine, 1)
    rich = made(first, rng.standard_normal((600, 1)), e)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        subspaceid(rich, 1)
    with pytest.warns(IdentificationWarning, match="too high"):
        subspaceid(rich, 4)
    with pytest.warns(IdentificationWarning, match="integrator"):
        subspaceid(made(replace(first, a=one), rng.standard_normal((600, 1)), e), 1)
    with pytest.warns(IdentificationWarning, match="feedback"):
        subspaceid(looped(rng), 1)


def looped(rng: np.random.Generator) -> Data:
    x, u, y = 0.0, np.zeros((1000, 1)), np.zeros((1000, 1))
    for i in range(1, 1000):
        u[i] = -0.5 * y[i - 1] + 0.3 * rng.standard_normal()
        e = rng.standard_normal()
        y[i] = x + e
        x = 0.8 * x + u[i, 0] + 0.3 * e
    return iddata(y, u)


def test_bad_data_are_refused_by_name() -> None:
    data, _ = noisy(n=200)
    with pytest.raises(ValueError, match="too few"):
        subspaceid(data[:20], 4)
    with pytest.raises(ValueError, match="constant"):
        subspaceid(iddata(data.y, np.ones((200, 2))), 4)
    with pytest.raises(ValueError, match="weighting"):
        subspaceid(data, 4, weighting="SSARX")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="horizon"):
        subspaceid(data, 4, horizon=2)


def test_long_data_are_taken_in_parts_with_the_same_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    data, _ = noisy(3, 1200)
    parts = [data[:700], data[700:]]
    whole = subspaceid(parts, 4, direct=True)
    monkeypatch.setattr(inputs, "CHUNK", 130)
    assert off(subspaceid(parts, 4, direct=True), whole) < 1e-9
