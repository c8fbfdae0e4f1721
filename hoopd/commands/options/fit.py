"""Options of `hoopd fit`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, names_of, option
from hoopd.commands.options.shared import (
    SLICE,
    age_option,
    columns_option,
    figure_option,
    hold_option,
    holdout_option,
    json_option,
    plant_option,
)


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Fit the plant's parameters to recordings, with 95 % intervals (docs/guides/fit.md)."""

    recordings: tuple[str, ...] = argument(f"Recordings to fit: {SLICE}.", metavar="REC...")
    holdout: tuple[str, ...] = holdout_option(
        "Recording that judges the model, never fitted; repeatable.", python=False
    )
    structure: str = option(
        "--structure",
        text="entries: eight coefficients; rolling, published: masses, radii, inertias, frictions.",
        default="entries",
    )
    method: str = option(
        "--method",
        text="output: free runs; prediction: a Kalman filter's innovations, with noise levels.",
        default="output",
    )
    model: Path | None = option("--model", text="What it starts from; a shipped one by default.", metavar="MODEL")
    fix: tuple[str, ...] = option(
        "--fix",
        text="Not fitted, e.g. mb=0.0608 (kg); NAME alone: at its start; repeatable.",
        metavar="NAME[=VALUE]",
        default=(),
    )
    prior: tuple[str, ...] = option(
        "--prior",
        text="Known beforehand, e.g. Rb=0.0104:0.02: SIGMA relative (of J, K, L2: absolute); repeatable.",
        metavar="NAME=VALUE:SIGMA",
        default=(),
    )
    free: tuple[str, ...] = option(
        "--free",
        text="Only these are fitted, separated by commas; of another plant's effect SLOT.EFFECT.PARAMETER.",
        metavar="NAMES",
        default="",
        read=names_of,
    )
    channels: tuple[str, ...] = option(
        "--channels",
        text="What is compared: theta, theta_rate, dtheta, psi, or channels of another plant; chosen by itself else.",
        metavar="NAMES",
        default="",
        read=names_of,
    )
    window_s: float | None = option("--window", text="Runs of so many seconds, each with its own start.")
    loss: str = option("--loss", text="linear, huber, soft_l1 or cauchy.", default="linear")
    plant: str | None = plant_option()
    columns: str | None = columns_option()
    hold: str = hold_option()
    age: str = age_option()
    kinematics: bool = option(
        "--kinematics", text="Which kinematics the recordings support (several fits).", default=False, python=False
    )
    out: Path | None = option("--out", text="Write the model here.", metavar="MODEL", python=False)
    figure: Path | None = figure_option()
    json_path: Path | None = json_option()
