"""Figures of identification: what is in them, and that the same numbers give the same bytes."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.patches import Ellipse
from scipy.signal import lfilter

from hoopd.ident.data import Data, iddata
from hoopd.ident.models import Polynomials
from hoopd.ident.prediction import predict, simulate
from hoopd.ident.residualtests import residuals
from hoopd.ident.spectral import correlation
from hoopd.plots import style
from hoopd.plots.identification import (
    Response,
    Roots,
    draw_coherence,
    draw_correlation,
    draw_orders,
    draw_residuals,
    draw_responses,
    draw_roots,
    draw_said,
    draw_spectra,
    draw_spectrogram,
)

MODEL = Polynomials(0.1, a=np.array([1.0, -1.5, 0.7]), b=(np.array([0.0, 1.0, 0.5]),))


@pytest.fixture(scope="module")
def data() -> Data:
    rng = np.random.default_rng(0)
    u, e = np.sign(rng.standard_normal(400)), 0.5 * rng.standard_normal(400)
    return iddata(lfilter([0.0, 1.0, 0.5], MODEL.a, u) + lfilter([1.0], MODEL.a, e), u, 0.1, outputs=["psi"])


def test_measured_and_said_with_the_fit_in_the_legend(data: Data) -> None:
    made = draw_said([data], {"arx": [predict(MODEL, data)], "free": [simulate(MODEL, data)]}, "one step ahead")
    texts = [text.get_text() for text in made.axes[0].get_legend().get_texts()]
    assert texts[0] == "measured" and texts[1].startswith("arx, one step ahead: ") and texts[1].endswith(" %")
    assert style.rendered(made, ".png") == style.rendered(
        draw_said([data], {"arx": [predict(MODEL, data)], "free": [simulate(MODEL, data)]}, "one step ahead"), ".png"
    )


def test_an_operating_point_is_drawn_and_changes_no_fit(data: Data) -> None:
    said = {"arx": [predict(MODEL, data)]}
    about, there = (draw_said([data], said, "one step ahead", offsets=of).axes[0] for of in (None, {"psi": 60.0}))
    for low, high in zip(about.get_lines(), there.get_lines(), strict=True):
        assert high.get_ydata() == pytest.approx(low.get_ydata() + 60.0) and low.get_label() == high.get_label()
    assert there.get_ylim() == pytest.approx([end + 60.0 for end in about.get_ylim()])


def test_residuals_say_what_was_tested(data: Data) -> None:
    made = draw_residuals(residuals(MODEL, data))
    assert len(made.axes) == 2
    assert "white: yes" in made.axes[0].get_title(loc="right") and "no feedback" in made.axes[1].get_title(loc="right")


def test_responses_have_bands_where_the_numbers_have_them() -> None:
    w = np.geomspace(0.1, 30.0, 50)
    h = 1.0 / (1.0 + 1j * w)
    made = draw_responses([Response("one", w, h, 0.1 * np.ones(50), 0.1 * np.ones(50)), Response("two", w, 2 * h)])
    gain, phase = made.axes
    assert len(gain.collections) == 1 and len(phase.collections) == 1
    # 1.96 sigma of 10 % are 1.7 dB each way
    box = gain.collections[0].get_paths()[0].get_extents()
    assert box.height == pytest.approx(2 * 1.702 + np.ptp(20 * np.log10(np.abs(h))), rel=1e-3)


def test_an_ellipse_is_as_large_as_its_covariance() -> None:
    poles = np.array([0.5 + 0.3j, 0.5 - 0.3j])
    made = draw_roots([Roots("m", poles, np.array([0.1]), [np.diag([0.04, 0.01])] * 2)])
    found = [one for one in made.axes[0].patches if isinstance(one, Ellipse) and one.width != 2.0]
    assert len(found) == 2
    assert sorted([found[0].width, found[0].height]) == pytest.approx([2 * 2.448 * 0.1, 2 * 2.448 * 0.2])


def test_the_best_order_is_marked() -> None:
    values = np.array([[5.0, 3.0, np.nan], [4.0, 1.0, 2.0]])
    axes = draw_orders(["1", "2"], ["1", "2", "3"], values, "BIC").axes[0]
    (mark,) = axes.get_lines()
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == (1, 1)


def test_the_other_figures_are_drawn() -> None:
    w = np.linspace(0.0, 10.0, 20)
    assert draw_coherence(w, {"u -> y": np.full(20, 0.9)}).axes[0].get_ylim()[1] > 1.0
    assert draw_spectra(w, {"y": (np.ones(20), 0.5 * np.ones(20), 2 * np.ones(20))}).axes[0].collections


def test_raw_correlations_and_spectrograms_are_drawn() -> None:
    x = np.random.default_rng(0).standard_normal((300, 2))
    made = draw_correlation(correlation(x, lags=20), [("y", "y"), ("y", "u"), ("u", "y"), ("u", "u")])
    assert [axes.get_ylabel() for axes in made.axes] == ["y, y", "y, u", "u, y", "u, u"]
    assert max(made.axes[0].get_lines()[0].get_ydata()) == pytest.approx(1.0)
    shown = draw_spectrogram(np.arange(5.0), np.arange(1.0, 9.0), np.outer(np.ones(5), np.geomspace(1e-3, 1.0, 8)))
    (mesh,) = shown.axes[0].collections
    assert mesh.get_array().shape == (8, 5) and mesh.get_array().max() == pytest.approx(0.0)


def test_a_wide_band_does_not_hide_the_curve_nor_a_far_root_the_plane() -> None:
    w = np.geomspace(0.1, 30.0, 50)
    h = 1.0 / (1.0 + 1j * w)
    gain, _ = draw_responses([Response("one", w, h, np.full(50, 1e3), np.full(50, 1e3))]).axes
    assert np.ptp(gain.get_ylim()) < 60.0
    far = np.array([0.5 + 0j, 40.0 + 0j])
    axes = draw_roots([Roots("m", np.array([0.2 + 0j]), far, (), [np.eye(2)] * 2)]).axes[0]
    assert "1 farther out" in axes.get_xlabel()
    assert len([one for one in axes.patches if isinstance(one, Ellipse) and one.width != 2.0]) == 1
