"""The kinds of faults of the campaign: how each is made, what the rule says, which message must name it.

Rules of this file: a kind is a row of `KINDS`; scripted ones run in both ways, those that need a process, a signal or a
neighbour in real time alone; `deadline_s` is the rule's, from the moment that `since` names to its action, and a
controlled stop is part of it.
"""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from system.realrun import Daemon
from system.test_realtime import FLOOD, SUBSCRIBER, neighbour

AT_S = 4.0  # run time at which a scripted fault begins
BOARD_TIMEOUT_S = 0.1
STOPPING_S = 1.0  # a controlled stop may take this long
CAMERA_S = 0.06  # a picture is two to three periods old when it is judged
CUT_S = 0.04  # one tick until the answer is there, one until it is judged
LOOK_S = 0.005  # the board's own cut (docs/board.md)

# "bounded": torque may flow, but the board keeps the hoop below its limit and ends it with the fault.
Outcome = Literal["goes on", "pause", "stop", "cut", "bounded"]
# The moment from which a deadline counts: the fault's beginning, the first report that is 5 sigma from the truth, or
# the hoop's true speed beyond the board's limit.
Since = Literal["fault", "departure", "overspeed"]


@dataclass(frozen=True)
class Kind:
    """One fault."""

    outcome: Outcome
    deadline_s: float
    causes: tuple[str, ...]  # any of these in the log or the recording, in the summary of the line, or none needed
    script: dict[str, Any] | None = None
    commands: tuple[dict[str, Any], ...] = ()  # of the operator; the first one's time is the fault's
    act: Callable[[Daemon], float] | None = None  # does it in real time, tells when
    since: Since = "fault"
    exit_code: int = 0
    pictures: bool = False  # without pictures there is nothing to see or to kill
    sim: dict[str, Any] = field(default_factory=dict)  # keys of the rig's section

    @property
    def realtime_only(self) -> bool:
        """A script cannot make it."""
        return self.act is not None


def scripted(kind: str, for_s: float = 1.0, **params: Any) -> dict[str, Any]:
    """A row of `sim.faults`."""
    return {"kind": kind, "at_s": AT_S, "for_s": for_s, "params": params}


def operator(*names: str, later_s: float = 0.0) -> tuple[dict[str, Any], ...]:
    """Rows of `sim.commands`, all in one tick."""
    return tuple({"at_s": AT_S + later_s, "name": name} for name in names)


def stop_and_continue(daemon: Daemon) -> float:
    at = daemon.signal(signal.SIGSTOP)
    time.sleep(0.5)
    daemon.signal(signal.SIGCONT)
    return at


def terminate(daemon: Daemon) -> float:
    return daemon.signal(signal.SIGTERM)


def kill(daemon: Daemon) -> float:
    return daemon.signal(signal.SIGKILL)


def fill_disk(daemon: Daemon) -> float:
    """No file of the daemon may grow: its writes fail as on a full disk."""
    size = max(path.stat().st_size for path in daemon.record.iterdir())
    resource.prlimit(daemon.process.pid, resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    return time.monotonic()


def flood(daemon: Daemon) -> float:
    with neighbour(FLOOD, daemon.endpoint, "2"):
        at = time.monotonic()
        time.sleep(2.0)
    return at


def freeze_subscriber(daemon: Daemon) -> float:
    with neighbour(SUBSCRIBER, daemon.endpoint) as subscriber:
        assert subscriber.stdout is not None
        subscriber.stdout.readline()
        subscriber.send_signal(signal.SIGSTOP)
        at = time.monotonic()
        time.sleep(2.0)
    return at


def kill_camera(daemon: Daemon) -> float:
    for camera in daemon.family("hoopd.sim.camera"):
        camera.kill()
    return time.monotonic()


NOTHING_TO_SAY = ("",)
LINE = ("bad CRC", "garbage bytes", "no answer", "not asked for")
STALLED = CAMERA_S + 0.1 + STOPPING_S
NO_BALL = CAMERA_S + 0.22

KINDS: dict[str, Kind] = {
    # the line and the board
    "bit flips": Kind("goes on", 0.0, LINE, scripted("bit_flips", every=6)),
    "lost frames": Kind("goes on", 0.0, LINE, scripted("lost_frames", rate=0.0, every=5)),
    "late frames": Kind("cut", 0.08, ("link_lost",), scripted("late_frames", delay_s=0.03)),
    "duplicated frames": Kind("goes on", 0.0, LINE, scripted("duplicated_frames")),
    "garbage": Kind("goes on", 0.0, LINE, scripted("garbage", rate=0.0, every=3)),
    "board silent": Kind("cut", 0.08, ("link_lost",), scripted("board_silent")),
    "board reset": Kind("cut", CUT_S, ("board_reset",), scripted("board_reset")),
    "board fault": Kind("cut", CUT_S, ("board_fault",), scripted("board_fault")),
    "drive blocked": Kind("cut", CUT_S, ("board_reset",), scripted("drive_blocked")),
    # the hoop turns at 14 rad/s then, and faster every second
    "board overspeed": Kind(
        "cut", LOOK_S, ("board_fault",), since="overspeed", sim={"board": {"overspeed_rad_s": 16.0}}
    ),
    "host mad": Kind("cut", LOOK_S, ("board_fault",), scripted("host_mad", 3.0), since="overspeed"),
    "host mad, in turn": Kind(
        "bounded", 1.0, ("hoop_overspeed",), scripted("host_mad", pattern="alternate", period_s=0.4)
    ),
    # sensors that lie
    "current implausible": Kind("cut", 0.24, ("current_implausible",), scripted("implausible_current", value=3.0)),
    "speed implausible": Kind("cut", 0.24, ("speed_implausible",), scripted("implausible_speed", value=30.0)),
    # the camera and the ball
    "camera stall": Kind("stop", STALLED, ("camera_lost",), scripted("camera_stall")),
    "camera program dies": Kind("stop", STALLED, ("camera_lost",), act=kill_camera, pictures=True),
    "late pictures": Kind("goes on", 0.0, ("camera_late",), scripted("late_pictures", delay_s=0.06)),
    "black pictures": Kind("pause", NO_BALL, ("ball_lost",), scripted("black_pictures")),
    "ball gone": Kind("pause", NO_BALL, ("ball_lost",), scripted("ball_gone")),
    "ball held": Kind(
        "stop", CAMERA_S + 1.0 + STOPPING_S, ("ball_implausible",), scripted("ball_held", 2.0, psi_rad=-0.4)
    ),
    "false red object": Kind("goes on", 0.0, NOTHING_TO_SAY, scripted("false_red_object"), pictures=True),
    # operators who race
    "disarm": Kind("cut", CUT_S, ("disarm",), commands=operator("disarm")),
    "arm, disarm": Kind("cut", CUT_S, ("disarm",), commands=operator("arm", "disarm")),
    "disarm, arm": Kind("cut", CUT_S, ("disarm",), commands=operator("disarm", "arm")),
    "disarm after arm": Kind(
        "cut",
        CUT_S,
        ("disarm",),
        commands=(*operator("disarm"), *operator("arm", later_s=0.5), *operator("disarm", later_s=0.52)),
    ),
    "stop, arm": Kind("stop", CUT_S + STOPPING_S, ("stop",), commands=operator("stop", "arm")),
    # the machine and its neighbours
    "disk full": Kind("goes on", 0.0, ("recorder_trouble",), act=fill_disk),
    "command flood": Kind("goes on", 0.0, NOTHING_TO_SAY, act=flood),
    "frozen subscriber": Kind("goes on", 0.0, NOTHING_TO_SAY, act=freeze_subscriber),
    "SIGSTOP, SIGCONT": Kind("cut", BOARD_TIMEOUT_S, ("board_timeout", "overrun_persistent"), act=stop_and_continue),
    "SIGTERM": Kind("stop", 0.02 + STOPPING_S, ("stop",), act=terminate),
    "SIGKILL": Kind("cut", BOARD_TIMEOUT_S, NOTHING_TO_SAY, act=kill, exit_code=-signal.SIGKILL),
}
