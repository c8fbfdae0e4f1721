"""What somebody tries who knows another toolbox: it works, or one line says what to write."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest

from hoopd import ident
from hoopd.ident import (
    Data,
    Innovations,
    Polynomials,
    arx,
    compare,
    detrend,
    fill_gaps,
    forecast,
    iddata,
    idfilt,
    impulse_response,
    impulseest,
    innovations,
    pem,
    predict,
    resample_system,
    scan,
    simulate,
    srivc,
    subspaceid,
    tfest,
    trend,
)
from hoopd.plots import compare_plot, impulse, resid

DT = 0.1
PLANT = Polynomials(DT, np.array([1.0, -1.5, 0.7]), (np.array([0.0, 1.0, 0.5]),), variance=0.09)


def data(seed: int = 0, samples: int = 400, plant: Polynomials = PLANT) -> Data:
    u = np.sign(np.random.default_rng(seed).standard_normal(samples))
    return iddata(simulate(plant, iddata(u, u, DT), "zero", seed=seed + 1000), u, DT)


@pytest.mark.parametrize(
    ("name", "told"), [("n4sid", "subspaceid"), ("misdata", "fill_gaps"), ("ssest", "pem"), ("spa", "tfest")]
)
def test_other_names_say_what_they_are_here(name: str, told: str) -> None:
    with pytest.raises(AttributeError, match=rf"has no {name}: it is .*{told}"):
        getattr(ident, name)


def test_other_orders_of_arguments_say_what_is_wanted() -> None:
    own, model = data(), PLANT
    with pytest.raises(TypeError, match=r"orders stand one by one"):
        arx(own, [2, 2, 3], 1)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"models come first"):
        compare(own, [model, model])
    with pytest.raises(TypeError, match=r"a transfer function .*srivc"):
        tfest(own, 2)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r"want a denominator too .* a band is prefilter"):
        idfilt(own, [0.0, 5.0])
    with pytest.raises(ValueError, match=r"the filter is unstable: .* modulus 5"):
        idfilt(own, 5.0, [0.1, 0.5])
    gaps = iddata(np.where(np.arange(400) % 7 == 3, np.nan, own.y[:, 0]), own.u, DT)
    with pytest.raises(ValueError, match=r"not a Polynomials; by a model: smooth\(model, data\)"):
        fill_gaps(gaps, model)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"of what fill_gaps gives take \.data"):
        arx(fill_gaps(gaps), 2, 2)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="residuals of one model"):
        resid([model, model], own)


def test_several_experiments_are_taken_or_refused_in_words() -> None:
    two = [data(0), data(1, 200)]
    for said, one in ((simulate(PLANT, two), two), (predict(PLANT, two, 5), two)):
        assert [len(part) for part in said] == [part.n for part in one]
    assert PLANT.predict(two, 5)[1] == pytest.approx(predict(PLANT, two[1], 5))
    assert [abs(float(one.y.mean())) < 1e-12 for one in detrend(two)] == [True, True]
    for refused in (lambda: srivc(two, 2), lambda: trend(two)):  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="one experiment"):
            refused()
    figure = compare_plot(PLANT, two)
    assert [axes.get_ylabel() for axes in figure.axes] == ["y, experiment 1", "y, experiment 2"]


def test_a_direct_term_is_taken_where_the_data_tell_of_one() -> None:
    at_once = Polynomials(DT, np.array([1.0, -0.8]), (np.array([1.0, 0.5]),), variance=0.01)
    assert pem(data(0, 600, at_once), 1).d.any() and subspaceid(data(0, 600, at_once), 1).d.any()
    assert not pem(data(0, 600), 2).d.any()
    assert not pem(data(0, 600, at_once), 1, direct=False).d.any()


def test_a_forecast_is_what_comes_and_its_error_what_it_misses() -> None:
    own = data(3, 500)
    told = forecast(PLANT, own[:400], 100, own.u[400:])
    assert told.t == pytest.approx(own.t[400:])
    assert told.y[0] == pytest.approx(predict(PLANT, own)[400], abs=1e-6)
    assert told.deviation is not None and told.deviation[0, 0] == pytest.approx(0.3)
    late = Polynomials(DT, PLANT.a, PLANT.b).noise(np.exp(1j * np.linspace(0, np.pi, 4001)))
    assert told.deviation[-1, 0] == pytest.approx(0.3 * np.sqrt(np.mean(np.abs(late) ** 2)), rel=0.01)
    misses = []
    for seed in range(200):
        one = data(seed, 60)
        misses.append(forecast(PLANT, one[:50], 10, one.u[50:]).y[-1, 0] - one.y[-1, 0])
    assert np.std(misses) == pytest.approx(told.deviation[9, 0], rel=0.15)
    with pytest.raises(ValueError, match="10 values of each of the 1 inputs"):
        forecast(PLANT, own, 10)


@pytest.mark.parametrize(("gap", "unseen"), [(slice(5, 10), 5), (slice(3, 9), 0)])
def test_a_forecast_counts_the_noise_of_outputs_that_are_missing(gap: slice, unseen: int) -> None:
    model = Polynomials(1.0, a=np.array([1.0, -0.9]), variance=1.0)
    y = np.array([1.0, 2.0, 1.0, 3.0, 2.0, 1.0, 0.0, 2.0, 1.0, 1.0])
    y[gap] = np.nan
    deviation = forecast(model, iddata(y), 2).deviation
    ahead = [np.sqrt(sum(0.81**j for j in range(unseen + i))) for i in (1, 2)]
    assert deviation is not None and deviation[:, 0] == pytest.approx(ahead)


def test_the_error_of_a_forecast_after_one_of_two_outputs_was_lost_is_what_it_misses() -> None:
    a, b = np.array([[0.9, 0.2], [0.0, 0.8]]), np.zeros((2, 0))
    k, r = np.array([[0.5, 0.3], [0.1, 0.6]]), np.array([[1.0, 0.4], [0.4, 0.5]])
    model = Innovations(a, b, np.eye(2), np.zeros((2, 0)), k, 1.0, r=r)
    rng, misses = np.random.default_rng(0), []
    for _ in range(600):
        e, x, y = rng.multivariate_normal([0.0, 0.0], r, 63), np.zeros(2), np.empty((63, 2))
        for i, one in enumerate(e):
            y[i], x = x + one, a @ x + k @ one
        seen = y[:60].copy()
        seen[55:, 0], seen[58:, 1] = np.nan, np.nan
        told = forecast(model, iddata(seen), 3)
        misses.append(told.y - y[60:])
    assert told.deviation is not None
    assert np.sqrt(np.mean(np.square(misses), axis=0)) == pytest.approx(told.deviation, rel=0.1)


def test_the_inputs_of_a_forecast_stand_in_either_layout_as_those_of_a_simulation() -> None:
    model = innovations(ct.ss(np.diag([0.5, 0.2]), np.eye(2), [[1.0, 1.0]], np.zeros((1, 2)), 1.0))
    rng = np.random.default_rng(0)
    own = iddata(rng.standard_normal(50), rng.standard_normal((50, 2)))
    u = np.column_stack([np.arange(10.0), np.zeros(10)])
    joined = simulate(model, iddata(np.full(60, np.nan), np.vstack([own.u, u])), "zero")[50:]
    free = forecast(model, own, 10, np.zeros((10, 2))).y
    told = forecast(model, own, 10, u).y
    assert np.allclose(told, forecast(model, own, 10, u.T).y)
    still = simulate(model, iddata(np.full(60, np.nan), np.vstack([own.u, 0.0 * u])), "zero")[50:]
    assert np.allclose(told - free, joined - still)
    with pytest.raises(ValueError, match="10 values of each of the 2 inputs"):
        forecast(model, own, 10, u[:9])


def test_pulses_are_drawn_with_what_the_data_say_without_structure() -> None:
    own = data(0, 2000)
    model, taps = arx(own, 2, 2), impulseest(own, 30)
    answer = impulse_response(model, 2.9)
    assert answer.deviation is not None and answer.y[1, 0, 0] == pytest.approx(1.0 / DT, rel=0.05)
    assert impulse_response(taps).y[:30, 0, 0] == pytest.approx(taps.g[:, 0, 0])
    claimed = impulse_response(taps).deviation
    assert claimed is not None and claimed[:30, 0, 0] == pytest.approx(taps.deviation[:, 0, 0], rel=1e-3)
    assert len(impulse({"ARX": model, "taps": taps}).axes[0].collections) == 2


def test_a_scan_prints_as_a_table_and_a_result_comes_to_another_step() -> None:
    lines = repr(scan(data(), range(1, 5), range(1, 5))).splitlines()
    assert lines[0].split() == ["na", "nb", "delay", "parameters", "variance"]
    assert lines[1].split()[:2] == ["2", "2"] and len(lines) == 12
    assert resample_system(PLANT, 0.2).dt == resample_system(ct.ss(PLANT.system), 0.2).dt == 0.2
