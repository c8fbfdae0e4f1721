"""Figures of closed loops: what is on them, and that the same data make the same bytes."""

from __future__ import annotations

import control
import numpy as np
import pytest

from hoopd.design.gang_of_four import gang_of_four
from hoopd.plants.hoop.loop.closed_loop import ClosedLoopRun
from hoopd.plants.hoop.loop.trial import Trial
from hoopd.plots.loops import draw_design, draw_gang_of_four, draw_responses
from hoopd.plots.style import rendered

PLANT, CONTROLLER = control.ss([[0.9]], [[0.1]], [[1.0]], 0, 0.02), control.ss([[0.2]], [[1.0]], [[1.0]], 0.5, 0.02)


def made(scale: float) -> ClosedLoopRun:
    t = 0.02 * np.arange(50)
    x = scale * np.exp(-t)[:, None] * np.ones(4)
    return ClosedLoopRun(t, x, x[:, 0], x[:, 2], x)


RUNS = Trial(*(made(scale) for scale in (1.0, 1.1, 0.4, 0.5, 0.1)))


def test_gang_of_several_loops_has_their_names_and_units() -> None:
    gang = gang_of_four(PLANT, CONTROLLER)
    figure = draw_gang_of_four({"PID": gang, "lead": gang})
    assert len(figure.axes) == 4
    for axes in figure.axes:
        assert "(" in axes.get_ylabel() and axes.get_xlabel() == "frequency (rad/s)"
        assert {line.get_label() for line in axes.get_lines()} >= {"PID", "lead"}


def test_responses_are_nonlinear_against_linear() -> None:
    figure = draw_responses({"PID": (made(1.0), made(1.1)), "lead": (made(0.5), made(0.6))})
    labels = {line.get_label() for line in figure.axes[0].get_lines()}
    assert labels == {"PID nonlinear", "PID linear", "lead nonlinear", "lead linear"}
    colours = {line.get_label(): line.get_color() for line in figure.axes[0].get_lines()}
    assert colours["PID nonlinear"] == colours["PID linear"] != colours["lead nonlinear"]
    assert [axes.get_ylabel() for axes in figure.axes] == ["ball angle (rad)", "hoop speed (rad/s)", "torque (N m)"]


@pytest.mark.proof
def test_design_is_drawn_the_same_every_time() -> None:
    one, two = (draw_design(gang_of_four(PLANT, CONTROLLER), RUNS, 0.4, "lqg") for _ in range(2))
    assert all(rendered(one, extension) == rendered(two, extension) for extension in (".png", ".svg"))
    assert one.axes[4].get_title() == "Ball let go at 0.4 rad"
