"""Figures of a diagnosis: every axis has its unit, what is drawn is what was given, and sizes stay readable."""

from __future__ import annotations

import numpy as np
import pytest
from diagnose.examples import coulomb, unknown
from matplotlib.figure import Figure

from hoopd.diagnose.record import Candidate, EffectFinding, Evidence, Quantity, Status, Visible
from hoopd.diagnose.report_curves import Comparison, Strip, Trace
from hoopd.plots import diagnosis as figures, diagnosis_curves as curves


def labels(figure: Figure) -> list[str]:
    return [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel()) if text]


def test_every_axis_of_a_curve_has_its_unit() -> None:
    _, friction = coulomb()
    diagnosis, detent = unknown()
    assert diagnosis.unexplained is not None and diagnosis.unexplained.curve is not None
    drawn = [
        *map(curves.draw_force, friction.forces), *map(curves.draw_comparison, friction.comparisons),
        curves.draw_harmonics(detent.harmonics[0]), curves.draw_curve(diagnosis.unexplained.curve),
    ]  # fmt: skip
    named = [text for figure in drawn for text in labels(figure) if not text.startswith("periods in a turn")]
    assert len(named) > 10
    assert all(text.endswith(("(N m)", "(rad/s)", "(rad)", "(s)")) for text in named), named


def test_the_named_law_is_drawn_through_the_missing_force() -> None:
    force = coulomb()[1].forces[0]
    law = force.regressors[0].law
    assert law is not None
    lines = {str(line.get_label()): line for line in curves.draw_force(force).axes[0].get_lines()}
    np.testing.assert_array_equal(lines["hoop.coulomb_friction"].get_ydata(), law.y)
    assert 300 < len(lines["smoothed"].get_xdata()) <= curves.MOST_DOTS  # type: ignore[arg-type]


def test_a_simulation_that_runs_away_does_not_squeeze_the_data() -> None:
    t = np.arange(100.0)
    measured = np.sin(t)
    trace = Trace("psi", "rad", t, measured, 1e6 * measured, measured)
    low, high = curves.draw_comparison(Comparison("a", [trace])).axes[0].get_ylim()
    assert -2.0 < low < -0.9 and 0.9 < high < 2.0


def test_of_a_long_recording_the_beginning_is_drawn_and_its_length_known() -> None:
    t = 0.02 * np.arange(2 * curves.MOST_POINTS)
    comparison = Comparison("a", [Trace("psi", "rad", t, t, t)])
    assert curves.cut_s(comparison) == pytest.approx(0.02 * (curves.MOST_POINTS - 1))
    assert curves.draw_comparison(comparison).axes[0].get_xlim()[1] == pytest.approx(0.02 * (curves.MOST_POINTS - 1))
    assert curves.cut_s(Comparison("a", [Trace("psi", "rad", t[:9], t[:9], t[:9])])) is None


@pytest.mark.parametrize("lifted", [-1, 0])
def test_a_pen_that_is_lifted_where_the_drawing_ends_ends_it_all_the_same(lifted: int) -> None:
    t = 0.02 * np.arange(2 * curves.MOST_POINTS)
    t[curves.MOST_POINTS + lifted] = np.nan
    comparison = Comparison("a", [Trace("psi", "rad", t, t, t)])
    told = curves.cut_s(comparison)
    assert told == pytest.approx(0.02 * curves.MOST_POINTS, abs=0.05)
    assert curves.draw_comparison(comparison).axes[0].get_xlim()[1] == told


def test_a_strip_has_the_size_of_the_disturbance_in_its_place() -> None:
    t = 0.02 * np.arange(1000)
    strength = np.where(t < 10.0, -3.0, 0.0)
    strength[700:720] = np.nan
    (image,) = figures.draw_strips([Strip("a", "hoop", t, strength)]).axes[0].get_images()
    (row,) = np.ma.filled(np.ma.asarray(image.get_array(), float), np.nan)
    known = np.isfinite(row)
    assert len(row) == figures.COLUMNS and 4 <= (~known).sum() <= 10
    np.testing.assert_allclose(row[: len(row) // 2 - 1], 3.0)
    np.testing.assert_allclose(row[len(row) // 2 + 1 :][known[len(row) // 2 + 1 :]], 0.0)


def test_only_the_best_candidates_are_drawn_and_thresholds_of_their_own_are_marked() -> None:
    many = [Candidate(name=f"slot.e{k}", log_likelihood_gain=100.0 - k, threshold=30.0 + k) for k in range(20)]
    axes = figures.draw_candidates(many, [], ["slot.e1"]).axes[0]
    assert [text.get_text() for text in axes.get_yticklabels()] == [
        f"slot.e{k}" for k in range(figures.MOST_CANDIDATES)
    ]
    marks = [line.get_xdata()[0] for line in axes.get_lines() if line.get_marker() == "|"]  # type: ignore[index]
    assert marks == [30.0 + k for k in range(figures.MOST_CANDIDATES)]


def test_a_finding_is_drawn_alone_and_beside_the_others_and_a_denied_one_says_so() -> None:
    def finding(name: str, gain: float, status: Status) -> EffectFinding:
        evidence = Evidence(log_likelihood_gain=gain, threshold=12.0, heldout_gain_percent=None)
        return EffectFinding(
            name=name, slot="a", parameters={}, evidence=evidence, not_excluded=[], statement="", status=status
        )

    alone = [Candidate(name="a.b", log_likelihood_gain=50.0, needed=12.0)]
    found = [finding("a.b", 20.0, "confirmed"), finding("a.of_x", 30.0, "not_confirmed")]
    axes = figures.draw_candidates(alone, found, []).axes[0]
    marks = {str(line.get_label()): line for line in axes.get_lines() if line.get_marker() == "o"}
    assert float(marks["named, on its own"].get_xdata()[0]) == 50.0  # type: ignore[index]
    assert marks["named, on its own"].get_markerfacecolor() == "none"
    assert float(marks["named, beside all others"].get_xdata()[0]) == 20.0  # type: ignore[index]
    legend = axes.get_legend()
    assert legend is not None and "denied by held-out data, beside all others" in [t.get_text() for t in legend.texts]


def test_a_nominal_value_far_away_is_an_arrow_at_the_edge() -> None:
    quantity = Quantity(value=1.0, unit="1/s", ci95=(0.9, 1.1), nominal=5.0)
    axes = figures.draw_parameters({"K1": quantity}).axes[0]
    (arrow,) = [line for line in axes.get_lines() if line.get_marker() == ">"]
    assert float(arrow.get_xdata()[0]) == figures.WIDEST_PERCENT  # type: ignore[index]


def test_what_is_visible_at_no_size_is_said_in_the_figure() -> None:
    power = {
        "a.b": Visible(parameter="d", unit="s", smallest=1e-3, largest=0.1),
        "c.d": Visible(parameter="d", unit="s", smallest=None, largest=0.1),
        "e.f": Visible(parameter="d", unit="s", smallest=0.2, largest=0.1),
    }
    said = [text.get_text() for text in figures.draw_power(power).axes[0].texts]
    assert said == ["d from 1 ms", "not visible at any size", "not visible at any size"]
