"""A flight in a file is one of this hoop's ball: longer, it would hide for all of a plan that the ball is gone."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from hoopd.design.controller_text import controller_text
from hoopd.files.controller import ControllerFile, parse_controller, parse_recorded_controller
from hoopd.files.planned_motion import FlightEntry, PlannedMotionEntry, TolerancesEntry
from hoopd.files.reading import InputError
from hoopd.files.trajectory import (
    KeptLimits,
    TrajectoryFile,
    maneuver_controller,
    parse_trajectory,
    trajectory_text,
)

LQG = Path(__file__).resolve().parents[2] / "config/controllers/lqg.yaml"
WIDE = TolerancesEntry(dtheta_rad_s=20.0, psi_rad=0.5, dpsi_rad_s=8.0)


def flying(ticks: int, sample_time_s: float = 0.02) -> TrajectoryFile:
    """A plan of 90 ticks at rest whose flight lasts so long."""
    flight = FlightEntry(first_tick=1, ticks=ticks, unmodelled=60.0, suspends=["ball_lost", "ball_implausible"])
    zeros = [[0.0] * 4] * 91
    plan = PlannedMotionEntry(
        torques_nm=[0.0] * 90, states=zeros, feedback=zeros[1:], start=WIDE, envelope=WIDE, flight=flight
    )
    limits = KeptLimits(torque_nm=0.6, hoop_speed_rad_s=40.0, contact=0.5)
    return TrajectoryFile("hoopd.trajectory/1", "x", "throw", "hoop.yaml", "ab", sample_time_s, 1, limits, plan)


def law(file: TrajectoryFile) -> ControllerFile:
    return maneuver_controller(file, parse_controller(LQG.read_text(), "lqg.yaml"))


def law_text(file: TrajectoryFile) -> str:
    return controller_text(msgspec.to_builtins(law(file)), "a plan")


@pytest.mark.parametrize(("ticks", "sample_time_s"), [(15, 0.02), (30, 0.01)])
def test_a_flight_of_three_tenths_of_a_second_is_read(ticks: int, sample_time_s: float) -> None:
    file = flying(ticks, sample_time_s)
    assert parse_trajectory(trajectory_text(file), "x.yaml") == file
    assert parse_controller(law_text(file), "law.yaml") == law(file)


@pytest.mark.parametrize(("ticks", "sample_time_s"), [(16, 0.02), (88, 0.02), (31, 0.01)])
def test_a_longer_one_is_refused_but_where_a_recorded_one_is_played_again(ticks: int, sample_time_s: float) -> None:
    file = flying(ticks, sample_time_s)
    for read, text in (
        (parse_trajectory, trajectory_text(file)),
        (parse_controller, law_text(file)),
    ):
        with pytest.raises(InputError, match=r"flight: a ball is in the air for 0\.3 s at most, not for (0\.3|1\.76)"):
            read(text, "x.yaml")
    recorded = parse_recorded_controller(law_text(file), "recorded")
    assert recorded.gains["flight"]["ticks"] == ticks
