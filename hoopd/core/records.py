"""Records that cross the edges of the tick.

Rules of this file: immutable, units in the names or in the comment beside them, run time in seconds since
the daemon's start (monotonic), missing numbers are NaN, angles in radians. Nothing here computes.
"""

from __future__ import annotations

from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

# Usual age of a picture's angle at the tick that uses it: delivered two frames of 20 ms after the middle of its
# exposure, then half a tick until it is used.
PICTURE_AGE_S = 0.05


class CameraSample(NamedTuple):
    """One analysed picture; `t` is the middle of its exposure."""

    frame: int  # camera's own picture counter
    t: float  # s, run time of the middle of the exposure
    t_arrival: float  # s, run time at which the detection was ready
    psi: float  # rad in (-pi, pi], NaN when no ball was found
    confidence: float  # 0..1
    x_px: float  # ball centre, NaN when no ball was found
    y_px: float
    corners: int = 0  # checksum of the picture's corners, which show neither hoop nor ball; 0: not told
    # the ball's place in the hoop's plane, wherever it is: psi is NaN off its track; NaN when no ball was found
    direction: float = nan  # rad, as psi
    distance: float = nan  # of the ball's centre from the axis, in shares of its track's radius


class DriverSample(NamedTuple):
    """One answer of the driver board; `t` is when the board sampled."""

    t: float  # s, run time: request written + its time on the wire
    seq: int  # echo of the request's sequence number
    status: int  # bit0 enabled, 1 time-out latched, 2 torque limited, 3 fault
    errors: int  # bit0 crc, 1 seq gap, 2 overcurrent, 3 encoder, 4 supply, 5 overspeed
    theta: float  # rad, wrapped by the board at +-512 turns
    dtheta: float  # rad/s
    current: float  # A
    board_ms: int  # board clock modulo 65536


class LinkCounts(NamedTuple):
    """What the serial line brought since the last tick, by kind."""

    good: int = 0
    bad_crc: int = 0
    garbage_bytes: int = 0
    unexpected_seq: int = 0
    implausible: int = 0
    lost: bool = False  # the port itself is gone


class Command(NamedTuple):
    """A wish of the operator, applied at a tick's edge."""

    # arm | disarm | clear | reference | speed | tune | stop | shutdown
    # controller | trial | experiment | accept | revert | alive (`core.succession`)
    name: str
    value: float = 0.0
    key: str = ""  # tune: name of the parameter; controller, trial, experiment: FILE@SHA256
    text: str = ""  # controller, trial, experiment: what the file held, so that a replay needs no other


class Inputs(NamedTuple):
    """All that a tick may know of the world; recorded, so that a replay repeats the tick to the bit."""

    id: int  # counts timer expirations, missed ones included
    t: float  # s, run time at which the slots were taken
    camera: CameraSample | None  # newest one since the last tick
    driver: DriverSample | None  # newest one since the last tick
    link: LinkCounts
    commands: tuple[Command, ...]
    lateness_s: float  # of this tick against its deadline
    execution_s: float  # of the previous tick
    camera_stalled: bool  # the back end's own watchdog gave up
    trouble: int  # bit0 recorder drops or cannot write, bit1 telemetry drops


class BallPlace(NamedTuple):
    """Of a ball that may leave the hoop: what it is believed to do, and where it is."""

    mode: str  # rolling | air | inner
    probability: float  # of that mode, 0..1
    distance: float  # of its centre from the axis, in shares of its track's radius
    surprise: float = nan  # innovation of the distance over what is expected of it, NaN without one


class Estimate(NamedTuple):
    """State estimate at the tick's time."""

    x: Vector  # (4,) theta rad, dtheta rad/s, psi rad, dpsi rad/s
    ready: bool  # both sensors have been seen since the last reset
    innovation_psi: float  # rad, NaN without a new sample
    innovation_theta: float  # rad, NaN without a new sample
    psi_accepted: bool  # a new psi passed the innovation gate
    nis: float  # normalised innovation squared of psi, NaN without one
    # innovations of theta, dtheta and psi over what the filter expects of them (1: its own), NaN without a sample
    surprise: tuple[float, float, float] = (nan, nan, nan)
    ahead: Vector | None = None  # (4,) where the plant will be when this tick's torque acts; None: at once
    ball: BallPlace | None = None  # None: it rolls, and nothing else is thought of


class TorqueCommand(NamedTuple):
    """What goes to the driver board this tick."""

    seq: int
    enable: bool
    clear_fault: bool
    torque_nm: float


class TickRecord(NamedTuple):
    """One row of telemetry and of the recording (schema `hoopd.tick`); row k: `u` is held from t_k to t_k+1."""

    t: float
    id: int
    mode: str
    u: float  # N m
    theta: float  # rad, unwrapped, NaN when missing
    dtheta: float
    current: float
    psi: float  # rad, unwrapped near the estimate, NaN when missing
    y_t: float  # s, when theta, dtheta and current were sampled
    psi_t: float  # s, middle of the exposure
    x_hat: tuple[float, float, float, float]
    reference: float  # rad
    status: int  # of the board
    errors: int  # of the board
    lateness_s: float
    execution_s: float
    distance: float = nan  # shares of the track; NaN when no ball was seen
    ball_mode: str = ""  # what the ball is believed to do, where it may leave the hoop; empty: it rolls
    mode_probability: float = nan
    distance_hat: float = nan  # estimate at t
