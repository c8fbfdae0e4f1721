"""Intervals hold the truth as often as they say, also where what is left out draws every stretch its own way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hoopd.plants.declaration import Channel, Input, Plant, Slot
from hoopd.plants.free_run import FreeRun
from hoopd.plants.likelihood.fitting import HypothesisFit, fit
from hoopd.plants.likelihood.stretch_scatter import StretchShare, _width, half_widths, interval, scatter, widest
from hoopd.plants.likelihood.stretches import stretch_of
from hoopd.recording.timeline import ChannelNodes

STRETCHES, ROWS, DRAWS = 14, 60, 400


def coverage(drawn: float, columns: int = 3, lasting: int = 1) -> tuple[float, float, float]:
    """Of plain intervals, of those by the shortest stretches, and of ours over made regressions; `drawn`: how far a
    stretch draws the first parameter, `lasting`: stretches that are drawn alike."""
    rng, held = np.random.default_rng(4), []
    for _ in range(DRAWS // lasting):
        parts = [rng.normal(size=(ROWS, columns)) for _ in range(STRETCHES * lasting)]
        draws = np.repeat(drawn * rng.normal(size=STRETCHES), lasting)
        errors = [x[:, 0] * draw + rng.normal(size=ROWS) for x, draw in zip(parts, draws, strict=True)]
        pieces = [StretchShare(x.T @ x, x.T @ e) for x, e in zip(parts, errors, strict=True)]
        information = sum(one.information for one in pieces)
        step = np.linalg.solve(information, sum(one.slope for one in pieces))
        centred = [StretchShare(x.T @ x, x.T @ (e - x @ step)) for x, e in zip(parts, errors, strict=True)]
        sd = np.sqrt(np.diag(np.linalg.inv(information)))
        none = np.zeros((columns, columns)), np.zeros(columns)
        shortest = _width(sd[0], *(one[0] for one in scatter(centred, *none)))
        held.append(abs(step[0]) < np.array([1.96 * sd[0], shortest, widest(sd, [centred], *none)[0]]))
    plain, short, ours = np.mean(held, axis=0)
    return float(plain), float(short), float(ours)


def test_where_the_model_is_right_they_hold_95_in_100() -> None:
    plain, _, ours = coverage(0.0)
    assert plain == pytest.approx(0.95, abs=0.025) and 0.93 < ours < 0.98


@pytest.mark.proof
def test_where_it_is_not_they_still_do() -> None:
    plain, _, ours = coverage(0.4)
    assert plain < 0.75 and 0.92 < ours < 0.98


def test_what_lasts_longer_than_a_stretch_shows_in_longer_ones() -> None:
    """Four neighbours that are drawn alike scatter half as much as they are wrong by."""
    plain, short, ours = coverage(0.4, lasting=4)
    assert plain < 0.5 and short < 0.85 and 0.88 < ours < 0.99


def test_one_stretch_alone_says_nothing_of_scatter() -> None:
    assert _width(1.0, 50.0, 0.3) == pytest.approx(1.96, abs=1e-3)


# ---------------------------------------------------------------------------------------------- fits


def slide(belief: float) -> Plant:
    """A mass of whose size k m only the product counts."""
    return Plant(
        "slide", ("x",), lambda s, force: (force - s.p["d"] * s.dx) / (s.p["k"] * s.p["m"]),
        inputs=(Input("F", "N", 10.0, "x"),), values={"m": 2.0, "d": 1.0, "k": 1.0}, free=("m", "d"),
        bounds={"m": (0.1, 100.0)}, beliefs={"k": belief} if belief else {}, channels={"x": Channel("x", "m", "ruler")},
        slots={"ruler": Slot("sensor", "x", ("x",))},
    )  # fmt: skip


def fitted(plant: Plant) -> HypothesisFit:
    t, rng = np.arange(0.0, 12.0, 0.02), np.random.default_rng(1)
    force = np.sign(np.sin(2.0 * t))
    x = FreeRun(plant).run([], [0.1, 0.0], t, force[:-1]).readings[:, 0] + 1e-3 * rng.normal(size=len(t))
    stretch = stretch_of("run", plant, t, force[:-1], {"x": ChannelNodes(np.arange(len(t)), x)})
    return fit([stretch], (), plant.values)


def test_what_is_held_and_believed_to_a_share_only_widens_what_is_fitted_beside_it() -> None:
    known, believed = half_widths(fitted(slide(0.0))), half_widths(fitted(slide(0.1)))
    # k m is what the run tells: a tenth of k is a tenth of m
    assert believed["m"] == pytest.approx(1.96 * 0.1 * 2.0, rel=0.05)
    assert believed["m"] > 5.0 * known["m"]
    assert believed["d"] == pytest.approx(known["d"], rel=0.05)


def test_what_is_fitted_and_believed_to_a_share_is_pulled_to_what_it_was_told_to_be() -> None:
    """As wide as the belief where the run tells the product alone."""
    free = half_widths(fitted(replace(slide(0.1), free=("m", "d", "k"))))
    assert free["k"] == pytest.approx(1.96 * 0.1, rel=0.05)
    assert free["m"] == pytest.approx(1.96 * 0.1 * 2.0, rel=0.1)


def test_an_interval_is_asked_for_by_name() -> None:
    found = fitted(slide(0.0))
    low, high = interval(found, "m") or (0.0, 0.0)
    assert low < 2.0 < high and high - low == pytest.approx(2.0 * found.widths["m"])
    assert interval(found, "k") is None


def test_a_fit_without_parameters_has_no_widths() -> None:
    assert half_widths(replace(fitted(slide(0.0)), free=(), rows=[], tracks=[], covariance=np.zeros((0, 0)))) == {}


def test_of_few_stretches_scatter_counts_with_students_quantile() -> None:
    """Of five stretches 2.78, not 1.96; what a right model scatters by is none."""
    assert _width(1.0, 10.0, 4.0) == pytest.approx(27.76, rel=1e-3)
    plain = pytest.approx(1.96, rel=1e-3)
    assert _width(1.0, 1.2, 4.0) == plain and _width(1.0, 10.0, 2.0) == plain
