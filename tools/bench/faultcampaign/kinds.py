"""The kinds of faults of the campaign: what docs/explanations/fault_campaign.md lists in the same order.

Rules of this file: a kind is a row of a table; scripted ones run in both ways, those that need a process, a signal or a
neighbour in real time alone.
"""

from __future__ import annotations

import signal
from typing import Final

from . import acts
from .kind import (
    BOARD_TIMEOUT_S,
    CAMERA_S,
    CUT_S,
    LOOK_S,
    NOTHING_TO_SAY,
    STOPPING_S,
    Kind,
    operator,
    scripted,
)
from .lies import LIES, UNTOLD

LINE: Final = ("bad CRC", "garbage bytes", "no answer", "not asked for")
STALLED: Final = CAMERA_S + 0.1 + STOPPING_S
NO_BALL: Final = CAMERA_S + 0.22
STOPPED: Final = CUT_S + STOPPING_S

BOARD: Final = {
    "bit flips": Kind("goes on", 0.0, LINE, scripted("bit_flips", every=6)),
    "lost frames": Kind("goes on", 0.0, LINE, scripted("lost_frames", rate=0.0, every=5)),
    "late frames": Kind("cut", 0.08, ("link_lost",), scripted("late_frames", delay_s=0.03)),
    "duplicated frames": Kind("goes on", 0.0, LINE, scripted("duplicated_frames")),
    "garbage": Kind("goes on", 0.0, LINE, scripted("garbage", rate=0.0, every=3)),
    "board silent": Kind("cut", 0.08, ("link_lost",), scripted("board_silent")),
    "board reset": Kind("cut", CUT_S, ("board_reset",), scripted("board_reset")),
    "board fault": Kind("cut", CUT_S, ("board_fault",), scripted("board_fault")),
    "drive blocked": Kind("cut", CUT_S, ("board_reset",), scripted("drive_blocked")),
    # the hoop turns faster every second
    "board overspeed": Kind(
        "cut", LOOK_S, ("board_fault",), since="overspeed", sim={"board": {"overspeed_rad_s": 18.0}}
    ),
    "host mad": Kind("cut", LOOK_S, ("board_fault",), scripted("host_mad", 3.0), since="overspeed"),
    "host mad, in turn": Kind(
        "bounded", 1.0, ("hoop_overspeed",), scripted("host_mad", pattern="alternate", period_s=0.4)
    ),
}

CAMERA: Final = {
    "camera stall": Kind("stop", STALLED, ("camera_lost",), scripted("camera_stall")),
    "camera program dies": Kind("stop", STALLED, ("camera_lost",), act=acts.kill_camera, pictures=True),
    "late pictures": Kind("goes on", 0.0, ("camera_late",), scripted("late_pictures", delay_s=0.06)),
    "black pictures": Kind("pause", NO_BALL, ("ball_lost",), scripted("black_pictures")),
    "ball gone": Kind("pause", NO_BALL, ("ball_lost",), scripted("ball_gone")),
    "ball held": Kind(
        "stop", CAMERA_S + 1.0 + STOPPING_S, ("ball_implausible",), scripted("ball_held", 2.0, psi_rad=-0.4)
    ),
    "false red object": Kind("goes on", 0.0, NOTHING_TO_SAY, scripted("false_red_object"), pictures=True),
}

OPERATORS: Final = {
    "disarm": Kind("cut", CUT_S, ("disarm",), commands=operator("disarm")),
    "arm, disarm": Kind("cut", CUT_S, ("disarm",), commands=operator("arm", "disarm")),
    "disarm, arm": Kind("cut", CUT_S, ("disarm",), commands=operator("disarm", "arm")),
    "disarm after arm": Kind(
        "cut",
        CUT_S,
        ("disarm",),
        commands=(*operator("disarm"), *operator("arm", later_s=0.5), *operator("disarm", later_s=0.52)),
    ),
    "stop, arm": Kind("stop", STOPPED, ("stop",), commands=operator("stop", "arm")),
    "stop after arm": Kind(
        "stop",
        STOPPED,
        ("stop",),
        commands=(*operator("stop"), *operator("arm", later_s=1.3), *operator("stop", later_s=1.32)),
    ),
    "arm while stopping": Kind(
        "stop", STOPPED, ("stop",), commands=(*operator("stop"), *operator("arm", "clear", later_s=0.1))
    ),
    "disarm while stopping": Kind(
        "cut", CUT_S + 0.1, ("disarm",), commands=(*operator("stop"), *operator("disarm", "arm", later_s=0.1))
    ),
    "SIGTERM after arm": Kind("stop", STOPPED, ("stop",), act=acts.disarm_arm_terminate),
}

NEIGHBOURS: Final = {
    "disk full": Kind("goes on", 0.0, ("recorder_trouble",), act=acts.fill_disk),
    "command flood": Kind("goes on", 0.0, NOTHING_TO_SAY, act=acts.flood_commands),
    "socket flood": Kind("goes on", 0.0, NOTHING_TO_SAY, act=acts.flood_socket),
    "idle connections": Kind("goes on", 0.0, NOTHING_TO_SAY, act=acts.idle_connections),
    "huge queries": Kind("goes on", 0.0, NOTHING_TO_SAY, act=acts.huge_queries),
    "disarm in all floods": Kind("cut", 0.1, ("disarm",), act=acts.disarm_in_all_floods),
    "frozen subscriber": Kind("goes on", 0.0, NOTHING_TO_SAY, act=acts.freeze_subscriber),
    "SIGSTOP, SIGCONT": Kind(
        "cut", BOARD_TIMEOUT_S, ("board_timeout", "overrun_persistent"), act=acts.stop_and_continue
    ),
    "SIGTERM": Kind("stop", 0.02 + STOPPING_S, ("stop",), act=acts.terminate),
    "SIGKILL": Kind("cut", BOARD_TIMEOUT_S, NOTHING_TO_SAY, act=acts.kill, exit_code=-signal.SIGKILL),
}

KINDS: Final[dict[str, Kind]] = {**BOARD, **LIES, **CAMERA, **OPERATORS, **NEIGHBOURS, **UNTOLD}
