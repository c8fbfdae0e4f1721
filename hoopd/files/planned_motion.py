"""A planned motion with its feedback: `plan` of a trajectory file, `gains` of a controller file of kind `maneuver`.

Rules of this file: plain data to object and back; a recording that holds the file's text repeats the maneuver.
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from msgspec import Meta

from hoopd.core.limits import TORQUE_LIMIT_NM
from hoopd.core.tracker import (
    LARGEST_UNMODELLED,
    LONGEST_PLAN_TICKS,
    FlightTicks,
    MotionTracker,
    PlannedMotion,
    Tolerances,
)

# No flight across this hoop takes longer than 0.231 s, and one to its inner hoop is planned for 0.3 s at most. For
# 0.16 s more nobody asks where the ball is: a flight that a file makes longer would hide one that is gone.
LONGEST_FLIGHT_S = 0.3

Row = Annotated[list[float], Meta(min_length=4, max_length=4)]
Torque = Annotated[float, Meta(ge=-TORQUE_LIMIT_NM, le=TORQUE_LIMIT_NM)]


class TolerancesEntry(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """How far hoop speed, ball angle and ball speed may be from the planned ones."""

    dtheta_rad_s: Annotated[float, Meta(gt=0, le=100)]
    psi_rad: Annotated[float, Meta(gt=0, le=3.2)]
    dpsi_rad_s: Annotated[float, Meta(gt=0, le=100)]


class FlightEntry(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """Of a throw: the rows in which the ball is in the air, and what is otherwise meanwhile."""

    first_tick: Annotated[int, Meta(gt=0, lt=LONGEST_PLAN_TICKS)]
    ticks: Annotated[int, Meta(gt=0, lt=LONGEST_PLAN_TICKS)]
    unmodelled: Annotated[float, Meta(ge=0, le=LARGEST_UNMODELLED)]
    suspends: list[str] = []


class PlannedMotionEntry(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A row a tick: the torque, the state before it, and the gains on (theta, dtheta, psi, dpsi)."""

    torques_nm: Annotated[list[Torque], Meta(min_length=1, max_length=LONGEST_PLAN_TICKS)]
    states: Annotated[list[Row], Meta(min_length=2, max_length=LONGEST_PLAN_TICKS + 1)]  # one more: where it ends
    feedback: Annotated[list[Row], Meta(min_length=1, max_length=LONGEST_PLAN_TICKS)]
    start: TolerancesEntry  # within which it begins
    envelope: TolerancesEntry  # beyond which it is given up
    # density of what the model may leave of so fast a motion, (rad/s)^2/s: the filter's own noise is for a ball at rest
    unmodelled: Annotated[float, Meta(ge=0, le=LARGEST_UNMODELLED)] = 0.0
    suspends: list[str] = []  # rows of the fault table that the plan itself would raise
    flight: FlightEntry | None = None
    let_down: bool = False  # it ends on top of the inner hoop: the ball falls, and it is over when all is calm


def planned_motion_entry(gains: dict[str, Any]) -> PlannedMotionEntry:
    """Checked gains; ValueError names the one that is wrong."""
    try:
        return msgspec.convert(gains, PlannedMotionEntry, strict=True)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None


def flight_doubt(entry: PlannedMotionEntry, sample_time_s: float) -> str:
    """Why a plan's flight can be none of this ball; empty: it can, or it has none. A recorded one is played again
    whatever it was."""
    seconds = 0.0 if entry.flight is None else entry.flight.ticks * sample_time_s
    if seconds <= LONGEST_FLIGHT_S + 1e-9:
        return ""
    return f"flight: a ball is in the air for {LONGEST_FLIGHT_S:g} s at most, not for {seconds:.3g}"


def flight_ticks(entry: FlightEntry) -> FlightTicks:
    """As the law has it."""
    return FlightTicks(entry.first_tick, entry.ticks, entry.unmodelled, tuple(entry.suspends))


def tracker_of(entry: PlannedMotionEntry) -> MotionTracker:
    """The law; ValueError when its tables do not fit each other."""
    plan = PlannedMotion(
        entry.torques_nm,
        entry.states,
        entry.feedback,
        start=Tolerances(**msgspec.structs.asdict(entry.start)),
        envelope=Tolerances(**msgspec.structs.asdict(entry.envelope)),
        unmodelled=entry.unmodelled,
        suspends=entry.suspends,
        flight=None if entry.flight is None else flight_ticks(entry.flight),
        let_down=entry.let_down,
    )
    return MotionTracker(plan)
