"""The gains of a controller file of kind `excitation`: the table of an experiment and its limits.

Rules of this file: plain data to object and back; a recording that holds the file's text repeats the experiment.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from hoopd.core.controllers import Controller
from hoopd.core.excitation import Excitation, ExcitationLimits
from hoopd.core.limits import TORQUE_LIMIT_NM

MAX_TICKS = 60_000  # twenty minutes: the header of a recording holds every value
Ticks = Annotated[int, Meta(ge=0, le=MAX_TICKS)]


class AroundEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The law that holds the ball meanwhile: kind and gains of its own controller file."""

    kind: Literal["lqg", "lqg_linear", "pid", "lead", "transfer_function"]
    gains: dict[str, Any]


class ExcitationEntry(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """`gains` of an excitation."""

    table_nm: Annotated[list[float], Meta(min_length=1, max_length=MAX_TICKS)]  # one value a tick
    torque_nm: Annotated[float, Meta(gt=0, le=TORQUE_LIMIT_NM)]
    hoop_speed_rad_s: Annotated[float, Meta(gt=0, le=200)]
    ball_angle_rad: Annotated[float, Meta(gt=0, le=3.2)] | None = None  # None: there is no ball
    soft_start_ticks: Ticks = 0
    soft_end_ticks: Ticks = 0
    centring_nm_per_rad_s: Annotated[float, Meta(ge=0, le=0.05)] = 0.0
    around: AroundEntry | None = None


def excitation_entry(gains: dict[str, Any]) -> ExcitationEntry:
    """Checked gains; ValueError names the one that is wrong."""
    try:
        return msgspec.convert(gains, ExcitationEntry, strict=True)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None


def excitation_of(entry: ExcitationEntry, around: Controller | None) -> Excitation:
    """The law; ValueError when its numbers do not fit each other."""
    angle = float("inf") if entry.ball_angle_rad is None else entry.ball_angle_rad
    return Excitation(
        entry.table_nm,
        ExcitationLimits(entry.torque_nm, entry.hoop_speed_rad_s, angle),
        soft_start_ticks=entry.soft_start_ticks,
        soft_end_ticks=entry.soft_end_ticks,
        centring_nm_per_rad_s=entry.centring_nm_per_rad_s,
        around=around,
    )
