"""Pictures of models, one call each: what is in them, for every kind of model."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest
from matplotlib.patches import Ellipse
from scipy.signal import lfilter

from hoopd import plots
from hoopd.ident import arx, bj, iddata, impulseest, oe, stack, subspaceid, tfest, varx
from hoopd.ident.data import Data
from hoopd.plots import bode, compare_plot, plot, pzmap, resid, step

DT = 0.1


@pytest.fixture(scope="module")
def data() -> Data:
    u, e = np.random.default_rng(0).standard_normal((2, 500))
    return iddata(lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.7], u) + 0.3 * e, u, DT)


@pytest.fixture(scope="module")
def two(data: Data) -> Data:
    rng = np.random.default_rng(1)
    u = np.column_stack([data.u[:, 0], rng.standard_normal(500)])
    y = np.column_stack([data.y[:, 0], lfilter([0.0, 1.0], [1.0, -0.6], u[:, 1]) + 0.1 * rng.standard_normal(500)])
    return iddata(y, u, DT, outputs=["level", "flow"], inputs=["pump", "valve"])


def test_bands_of_what_has_a_covariance_hold_the_truth(data: Data) -> None:
    gain, _ = bode({"oe": oe(data, 2, 2)}, data).axes
    (band,) = gain.collections
    points = band.get_paths()[0].vertices
    truth = ct.tf([1.0, 0.5], [1.0, -1.5, 0.7], DT)
    inside = 0
    curve = next(line for line in gain.get_lines() if line.get_label() == "oe")
    for w, own in zip(curve.get_xdata(), curve.get_ydata(), strict=True):
        near = points[np.isclose(points[:, 0], w), 1]
        true = 20.0 * np.log10(abs(truth(np.exp(1j * w * DT))))
        assert near.min() < own < near.max()
        inside += near.min() <= true <= near.max()
    assert inside > 0.8 * len(curve.get_xdata())


def test_steps_have_bands_where_there_is_a_covariance(data: Data, two: Data) -> None:
    (axes,) = step({"oe": oe(data, 2, 2), "true": ct.tf([1.0, 0.5], [1.0, -1.5, 0.7], DT)}).axes
    assert len(axes.collections) == 1 and axes.get_legend_handles_labels()[1] == ["oe", "true"]
    grid = step(subspaceid(two, 3), 4.0).axes
    assert [one.get_ylabel() for one in grid[:2]] == ["level per step of pump", "level per step of valve"]
    with pytest.raises(TypeError, match="has no response to a step of its own"):
        step(tfest(data))
    with pytest.raises(ValueError, match="different numbers of outputs or inputs"):
        step([oe(data, 2, 2), subspaceid(two, 3)])


def test_the_package_shows_its_names() -> None:
    assert set(plots.__all__) <= set(dir(plots))


def test_every_kind_of_model_has_a_response_and_one_colour(data: Data) -> None:
    system = ct.tf([1.0, 0.5], [1.0, -1.5, 0.7], DT)
    models = [arx(data, 2, 2), bj(data, 2, 1, 1, 2), subspaceid(data, 2), impulseest(data, 20), tfest(data), system,
              ct.frd(system, np.geomspace(0.1, 30.0, 50))]  # fmt: skip
    gain, phase = bode(models, data).axes
    names = gain.get_legend_handles_labels()[1]
    assert names[:2] == ["from the data", "ARX"] and len(names) == 8
    colours = [line.get_color() for line in gain.get_lines()]
    assert colours == [line.get_color() for line in phase.get_lines()]
    drawn = compare_plot(models[:2], data).axes[0].get_lines()
    assert [line.get_color() for line in drawn][1:3] == colours[1:3]


def test_phases_lie_on_each_other(data: Data) -> None:
    minus = ct.tf([-1.0], [1.0, -0.5], DT)
    _, phase = bode([minus, ct.tf([-1.001], [1.0, -0.5], DT)]).axes
    one, other = (line.get_ydata() for line in phase.get_lines())
    assert np.allclose(one, other, atol=1.0)


def test_several_channels_have_a_panel_each(two: Data) -> None:
    model = varx(two, 2, 2)
    made = bode(model, two)
    assert len(made.axes) == 8 and made.axes[1].get_title() == "level from valve"
    assert len(compare_plot(model, two, 5).axes) == 2 and len(plot(two).axes) == 4
    names = pzmap(model).axes[0].get_legend_handles_labels()[1]
    assert names[0] == "poles" and "zeros, level from pump" in names


def test_rows_put_together_have_their_regions(two: Data) -> None:
    model = stack([oe(two.channels([name]), 2, 2) for name in two.outputs])
    assert model.summary()["method"] == "output error" and model.simulate(two).shape == (500, 2)
    assert len(bode(model).axes[0].collections) == 1
    ellipses = [one for one in pzmap(model).axes[0].patches if isinstance(one, Ellipse)]
    assert len(ellipses) >= model.state_space.nx
    assert next(iter(model.deviations())) == "b1(1) (level)"


def test_a_continuous_model_has_its_own_plane() -> None:
    lag = ct.tf([1.0], [1.0, 0.4, 1.0])
    axes = pzmap(lag).axes[0]
    assert axes.get_xlabel() == "real part (rad/s)" and len(bode(lag).axes) == 2
    with pytest.raises(ValueError, match="no plane in common"):
        pzmap([lag, ct.c2d(lag, DT)])


def test_a_simulation_that_diverges_leaves_the_measured_in_sight(data: Data) -> None:
    wild = ct.tf([1.0], [1.0, -3.0], DT)
    axes = compare_plot({"wild": wild}, data).axes[0]
    assert "wild, simulated: diverges" in axes.get_legend_handles_labels()[1] or axes.get_ylim()[1] < 100.0
    assert axes.get_ylim()[1] < 3.0 * np.ptp(data.y)


def test_residuals_and_experiments(data: Data) -> None:
    assert len(resid(arx(data, 2, 2), [data[:250], data[250:]]).axes) == 2
    made = plot({"first": data[:250], "second": data[250:]}, units={"y": "V"})
    assert made.axes[0].get_legend_handles_labels()[1] == ["first", "second"]
    assert made._repr_png_()[:4] == b"\x89PNG"  # what a notebook asks for


def test_what_is_none_of_these_names() -> None:
    with pytest.raises(AttributeError, match="no attribute 'rubbish'"):
        _ = plots.rubbish
