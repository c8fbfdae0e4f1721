"""What a subspace estimate chooses by itself: direct term, order, horizon; and what it says when that is doubtful."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from hoopd.ident.checks import IdentificationWarning
from hoopd.ident.confidence import response_spread
from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Innovations
from hoopd.ident.simulationcheck import check_simulation
from hoopd.ident.statespace import heldback, projection
from hoopd.ident.statespace.linear import radius
from hoopd.ident.statespace.ordering import has_direct_term
from hoopd.ident.statespace.pem import pem
from hoopd.ident.statespace.projection import TriangularFactor, WindowSplit
from hoopd.ident.statespace.subspace import subspaceid
from hoopd.ident.statespace.uncertainty import response_covariance
from tests.shared import shared_path

RESONANCE = [1.0, -1.9, 0.98]


def made(b: list[float], a: list[float], n: int, seed: int, noise: float = 0.1, offset: float = 0.0) -> Data:
    u, e = np.random.default_rng(seed).standard_normal((2, n))
    clean = lfilter(b, a, u)
    return iddata(clean + offset + noise * clean.std() * e, u)


def test_a_direct_term_is_taken_where_the_data_have_one() -> None:
    without, some = (made(b, [1.0, -0.8], 800, 0) for b in ([0.0, 1.0], [0.5, 1.0]))
    assert not has_direct_term([without], 5) and has_direct_term([some], 5)
    assert subspaceid(some, 1).d[0, 0] == pytest.approx(0.5, abs=0.1)
    assert subspaceid(without, 1).d[0, 0] == 0.0
    assert subspaceid(some, 1, direct=False).d[0, 0] == 0.0


def test_correlations_near_one_are_not_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    found = TriangularFactor(np.eye(60), WindowSplit(5, 5, 3, 3), 80)
    monkeypatch.setattr(projection, "correlations", lambda _: np.array([0.999, 0.99, 0.98, 0.1, 0.05, 0.01]))
    monkeypatch.setattr(projection, "chance", lambda _: 0.5)
    # by the next correlation's square alone a penalty of 0.49 an order would have left two of them out
    assert projection.choose_order(found, 5) == 3


@pytest.mark.parametrize(("seed", "b", "a"), [(0, [0.0, 1.0, 0.5], RESONANCE), (1, [0.3, 0.1], [1.0, -0.99])])
def test_the_choice_foretells_new_data_as_the_system_does_and_is_told(
    seed: int, b: list[float], a: list[float]
) -> None:
    own, new = made(b, a, 600, seed), made(b, a, 600, seed + 100)
    model = subspaceid(own, most_order=4)
    assert model.nx == len(a) - 1 and radius(model.a) < 1.0
    assert model.choice is not None and model.choice.order == model.nx
    assert set(model.choice.fits) == {1, 10, np.inf} and model.choice.looked >= 8
    simulated = heldback.held_errors(model, [new]).losses[-1]
    assert simulated < 0.13  # the noise alone leaves 0.1
    assert model.report is not None
    assert any(f"order {model.nx}" in one and "held back" in one for one in model.report.choices)


def test_what_is_asked_for_is_not_chosen() -> None:
    data = made([0.0, 1.0], [1.0, -0.8], 500, 0)
    model = subspaceid(data, horizon=6, weighting="N4SID", most_order=3, refine=0)
    assert model.choice is not None
    assert (model.choice.horizon, model.choice.weighting, model.choice.steps) == (6, "N4SID", 0)


def test_of_a_short_record_nothing_is_held_back() -> None:
    model = subspaceid(made([0.0, 1.0], [1.0, -0.8], 90, 0), most_order=2)
    assert model.choice is not None and not model.choice.fits
    assert "nothing held back" in str(model.choice)


def test_an_output_that_is_missing_at_first_has_the_operating_point_of_the_rest() -> None:
    """Two outputs without means, one of them recorded from the second third on."""
    one = made([0.0, 1.0], [1.0, -0.8], 600, 0)
    y = np.hstack([one.y, one.y]) - np.mean(one.y)
    y[:200, 1] = np.nan
    data = iddata(y - np.nanmean(y, axis=0), one.u - np.mean(one.u))
    middle = heldback.folds(data)[2].held[0]
    assert np.isfinite(middle.y).all() and abs(float(np.mean(middle.y[:, 1]))) < 1.0


def test_models_no_worse_by_chance_are_equal_and_worse_ones_are_not() -> None:
    rng = np.random.default_rng(0)
    changes = np.full((1, 16), 100.0)
    best = heldback.HeldErrors(4.0 + rng.uniform(0.0, 0.1, (1, 1, 16)), changes)
    alike = heldback.HeldErrors(best.errors * rng.uniform(0.7, 1.35, (1, 1, 16)), changes)
    worse = heldback.HeldErrors(best.errors * 1.4, changes)
    assert heldback.no_worse(alike, best) and not heldback.no_worse(worse, best)


def test_an_unstable_model_is_told() -> None:
    rng = np.random.default_rng(0)
    u = rng.standard_normal(150)
    data = iddata(lfilter([0.0, 1.0], [1.0, -1.9, 0.99], u)[:150] * 1.05 ** np.arange(150), u)
    with pytest.warns(IdentificationWarning, match="unstable"):
        subspaceid(data, 2)


def test_a_model_that_predicts_and_does_not_simulate_is_told() -> None:
    one = np.ones((1, 1))
    data = made([0.0, 1.0], [1.0, -0.99], 600, 0, noise=0.01)
    right, wrong = (Innovations(0.99 * one, b * one, one, 0 * one, 0.9 * one, 1.0) for b in (1.0, -1.0))
    with pytest.warns(IdentificationWarning, match="predicts and does not simulate"):
        check_simulation(wrong, [data])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_simulation(right, [data])


def test_a_usual_horizon_that_gives_an_unstable_model_is_left_for_another() -> None:
    rows = np.loadtxt(shared_path("plants/daisy/cstr.dat"))[:5000]
    data = iddata(rows[:, 2:] - rows[:, 2:].mean(axis=0), rows[:, 1:2] - rows[:, 1:2].mean(axis=0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = subspaceid(data, 4)
    assert radius(model.a) < 1.0
    assert model.choice is not None and model.choice.looked > 1


def wandering(seed: int, walk: float) -> Data:
    rng = np.random.default_rng(seed)
    u, e = rng.standard_normal((2, 900))
    y = lfilter([0.0, 1.0], [1.0, -0.8], u) + 0.1 * e + walk * np.cumsum(rng.standard_normal(900))
    return iddata(y - y.mean(), u - u.mean())


def test_an_output_that_wanders_gets_a_state_for_it_and_a_quiet_one_does_not() -> None:
    moved, quiet = (subspaceid(wandering(3, walk), most_order=1) for walk in (0.1, 0.0))
    assert quiet.choice is not None and quiet.choice.disturbance is None and quiet.nx == 1
    assert moved.choice is not None and moved.choice.disturbance is not None
    assert "slow disturbance" in str(moved.choice) and moved.nx == 2
    assert not moved.b[1].any() and 0.89 < moved.a[1, 1] < 1.0  # no input reaches it, and it is stable
    plain = replace(moved, a=moved.a[:1, :1], b=moved.b[:1], c=moved.c[:, :1], k=moved.k[:1], x0=None)
    new = [wandering(4, 0.1)]
    losses = [heldback.held_errors(model, new, [1, 10]).losses for model in (moved, plain)]
    assert losses[0][0] < losses[1][0] and losses[0][1] < 0.85 * losses[1][1]


def test_a_third_is_held_back_three_times_and_means_are_those_of_what_is_fitted() -> None:
    data = wandering(0, 0.1)
    found = heldback.folds(data)
    assert [one.held[0].n for one in found] == [300, 300, 300]
    assert [len(one.fitted) for one in found] == [1, 1, 2]
    assert all(abs(np.concatenate([part.y for part in one.fitted]).mean()) < 1e-9 for one in found)
    # of the third between, what is known of the operating point comes from the rows before it
    for one, known in zip(found, (data.y[:600], data.y[300:], data.y[:300]), strict=True):
        (start,) = np.flatnonzero(np.isclose(data.t, one.held[0].t[0]))
        assert np.allclose(one.held[0].y, data.y[start : start + 300] - known.mean())
    raw = heldback.folds(replace(data, y=data.y + 5.0))  # nobody took a mean out
    assert raw[0].held[0].y.mean() == pytest.approx(data.y[600:].mean() + 5.0)


def test_refinement_goes_on_as_long_as_it_foretells_better() -> None:
    rng = np.random.default_rng(5)
    u, e = rng.standard_normal((2, 700))
    # a noise model that no short window shows: its zeros are near the circle
    y = lfilter([0.0, 1.0], [1.0, -0.9], u) + lfilter([1.0, -0.97], [1.0, -0.2], e)
    model = subspaceid(iddata(y, u), most_order=3, horizon=5)
    assert model.choice is not None and model.choice.steps in (1, 2, 4, 8, 16, 32)


def test_subspace_models_have_bands() -> None:
    data = made([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], 800, 0)
    w = np.array([0.1, 0.5, 1.5])
    one, best = (response_spread(model, w) for model in (subspaceid(data, 2, refine=3), pem(data, 2)))
    assert one is not None and best is not None
    assert np.allclose(one.gain, best.gain, rtol=0.1)
    assert np.isfinite(response_covariance(subspaceid(data, 2), w)).all()


def test_a_slow_disturbance_widens_no_band_of_the_process() -> None:
    model = subspaceid(wandering(3, 0.1), most_order=1)
    band = response_spread(model, np.array([0.1, 1.0]))
    assert band is not None and (band.gain < 0.05).all()
