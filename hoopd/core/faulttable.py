"""The fault table: which faults there are, what each does, and how long it must last.

Rules of this file: data; what makes a period bad is `core.health`'s. docs/reference/faults.md holds the same table.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from hoopd.core.picturechecks import NAMES as PICTURE_FAULTS


class Action(IntEnum):
    """What a fault does, in rising order; the strongest active one wins."""

    NOTE = 0  # recorded and counted
    FLAG = 1  # control goes on, new experiments are refused
    PREDICT = 2  # control goes on, on the estimator's prediction
    PAUSE = 3  # zero torque, still armed
    STOP = 4  # controlled stop
    CUT = 5  # zero torque, drive off


class Fault(NamedTuple):
    """One row: after `on` bad periods in a row it is active, after `off` good ones it may go."""

    name: str
    action: Action
    on: int
    off: int
    latched: bool
    meaning: str


SECOND = 50  # periods

FAULTS: tuple[Fault, ...] = (
    Fault("frame_bad", Action.NOTE, 1, 1, False, "a frame of the board was damaged, out of order or implausible"),
    # 60 ms: the board's own time-out is 100 ms, so the host gives up first.
    Fault("link_lost", Action.CUT, 3, SECOND, True, "no good answer of the board for 60 ms, or the port is gone"),
    Fault(
        "board_fault",
        Action.CUT,
        1,
        1,
        True,
        "the board reports overcurrent, encoder, supply, overspeed or its own fault",
    ),
    Fault("board_timeout", Action.CUT, 1, 1, True, "the board's own time-out switched the torque off"),
    Fault("board_reset", Action.CUT, 1, 1, True, "the board restarted: its clock jumped or its drive went off"),
    Fault("board_refuses", Action.CUT, SECOND, 1, True, "the board did not enable its drive within a second"),
    Fault(
        "camera_late", Action.PREDICT, 1, SECOND, False, "the newest picture is more than 1.5 periods older than usual"
    ),
    Fault("camera_lost", Action.STOP, 1, SECOND, True, "no new picture for five periods"),
    Fault("ball_missing", Action.PREDICT, 1, 1, False, "the newest picture shows no ball where one can be"),
    # 200 ms: the prediction is good for about a third of the ball's own period (0.73 s).
    Fault("ball_lost", Action.PAUSE, 10, 10, False, "no ball for ten pictures in a row"),
    # A hand on the ball, or something red that is not the ball: it does not move as a ball under this torque must.
    Fault("ball_implausible", Action.STOP, 1, SECOND, True, "what the camera tracks does not move as a ball"),
    # No law was designed for that: gravity pulls the ball further away, and a real one has left its track.
    Fault("ball_runaway", Action.STOP, 1, SECOND, True, "the ball went over the top of the hoop under torque"),
    # `core.picturechecks` and `core.ballresponse`: what they count is said there. A camera that lies ends control.
    Fault("pictures_identical", Action.STOP, 1, SECOND, True, "the same picture comes again and again as a new one"),
    Fault("angle_stuck", Action.STOP, 1, SECOND, True, "the ball's angle stays equal while the hoop moves the ball"),
    Fault("angle_noiseless", Action.STOP, 1, SECOND, True, "the ball's angle has lost its noise: nothing measures it"),
    Fault("ball_unresponsive", Action.STOP, 1, SECOND, True, "the ball does not answer the hoop as a ball must"),
    Fault("overrun", Action.NOTE, 1, 1, False, "lateness and execution exceeded the period"),
    Fault("overrun_repeated", Action.FLAG, 3, SECOND, False, "three periods in a row were overrun"),
    Fault("overrun_persistent", Action.STOP, 10, SECOND, True, "ten periods in a row were overrun"),
    # 200 ms each: longer than any single damaged sample, shorter than the time a wrong torque needs to do harm.
    Fault("current_implausible", Action.CUT, 10, SECOND, True, "the motor current does not answer the torque"),
    Fault("speed_implausible", Action.CUT, 10, SECOND, True, "the reported speed is not the derivative of the angle"),
    # `core.encoderchecks`: what they count is said there.
    Fault("hoop_innovation", Action.CUT, 12, SECOND, True, "the hoop's angle and speed do not follow the torque"),
    Fault("torque_without_motion", Action.CUT, 1, SECOND, True, "torque acts and the hoop's angle stands still"),
    Fault("speed_noiseless", Action.CUT, 1, SECOND, True, "the reported speed has lost its noise: nothing measures it"),
    Fault("hoop_overspeed", Action.CUT, 3, SECOND, True, "the hoop turns faster than it may"),
    Fault("not_finite", Action.CUT, 1, 1, True, "an estimate or a command was not a finite number"),
    Fault("recorder_trouble", Action.FLAG, 1, 1, False, "rows were lost or cannot be written"),
    Fault("telemetry_trouble", Action.FLAG, 1, SECOND, False, "telemetry rows were dropped"),
    # `core.drift`: half a minute in which the innovations last; once in a run, the model does not change while it runs.
    Fault("model_drift", Action.NOTE, 1, 1, True, "the device does not move as the model says: run `hoopd diagnose`"),
)
CAMERA_FAULTS = (
    *("camera_late", "camera_lost", "ball_missing", "ball_lost", "ball_implausible", "ball_runaway"),
    *PICTURE_FAULTS,
)
# What a planned maneuver is, and no fault while it is played: a ball that goes round the hoop. Of one that is in the
# air by plan: that it is not seen, and does not move as one that rolls. Nothing else may be.
SUSPENDABLE = frozenset({"ball_runaway"})
SUSPENDABLE_IN_FLIGHT = frozenset({"ball_lost", "ball_implausible"})
BY_NAME: Mapping[str, Fault] = {fault.name: fault for fault in FAULTS}
