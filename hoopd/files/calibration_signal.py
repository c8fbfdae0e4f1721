"""The test signal of a calibration: a few seconds of small torques on top of the law that holds the ball.

Rules of this file: plain text in, plain text out; the same text always; its limits are narrower than the law's.
"""

from __future__ import annotations

from itertools import accumulate, repeat

import msgspec

from hoopd.files.controller import parse_controller
from hoopd.files.excitation import AroundEntry, ExcitationEntry
from hoopd.files.reading import InputError
from hoopd.files.yaml_text import text_of

SECONDS = 8.0
HOLD_S = 0.08  # of one value: long enough to move the hoop, short enough that the ball stays where it is
AMPLITUDE_NM = 0.03  # on the rig: 3 rad/s of the hoop, 0.1 rad of the ball
SOFT_S = 0.5
# What ends it: some four times what it does on the model.
TORQUE_NM, HOOP_SPEED_RAD_S, BALL_ANGLE_RAD = 0.2, 12.0, 0.35
NAME = "calibration"


def signal_around(law: str, path: object) -> str:
    """A controller file that plays the signal around a law; InputError for a law that holds no ball.

    Parameters
    ----------
    law : text of the controller file in force
    path : what a message calls it
    """
    base = parse_controller(law, path)
    if base.kind == "excitation" or base.kind == "maneuver":  # noqa: PLR1714  # so that the type is narrowed
        raise InputError(path, "kind", f"{base.kind}: holds no ball")
    limits = msgspec.structs.replace(base.limits, torque_nm=min(base.limits.torque_nm, TORQUE_NM))
    ticks, hold = round(SECONDS / base.sample_time_s), round(HOLD_S / base.sample_time_s)
    soft = round(SOFT_S / base.sample_time_s)
    gains = ExcitationEntry(
        table_nm=[AMPLITUDE_NM * _sign(k // hold) for k in range(ticks)],
        torque_nm=limits.torque_nm,
        hoop_speed_rad_s=HOOP_SPEED_RAD_S,
        ball_angle_rad=BALL_ANGLE_RAD,
        soft_start_ticks=soft,
        soft_end_ticks=soft,
        around=AroundEntry(kind=base.kind, gains=base.gains),
    )
    file = msgspec.structs.replace(
        base, name=NAME, kind="excitation", gains=msgspec.to_builtins(gains), limits=limits,
        notes=f"{SECONDS:g} s of {AMPLITUDE_NM:g} N m around {base.name}, to calibrate",
    )  # fmt: skip
    return text_of(msgspec.to_builtins(file), default_flow_style=None, width=120)


def _shifted(register: int, _: object) -> int:
    # x^7 + x^6 + 1: all 127 states but zero
    return (register << 1 | (register >> 6 ^ register >> 5) & 1) & 0x7F


_REGISTERS = [*accumulate(repeat(None, 126), _shifted, initial=1)]


def _sign(place: int) -> float:
    """Of a maximum-length sequence of two levels."""
    return 1.0 if _REGISTERS[place % len(_REGISTERS)] & 1 else -1.0
