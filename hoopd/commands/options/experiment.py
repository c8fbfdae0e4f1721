"""Options of `hoopd experiment`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.running import (
    arm_option,
    camera_option,
    config_option,
    sets_option,
    speed_option,
)
from hoopd.commands.options.shared import figure_option, json_option
from hoopd.core.limits import TORQUE_LIMIT_NM


@dataclass(frozen=True, kw_only=True)
class ExperimentOptions:
    """Play a test signal within the limits of the hoop, or simulate it on another plant, and record it."""

    kind: str = argument("prbs, chirp, multisine, steps or decay.", metavar="KIND")
    sim: bool = option("--sim", text="On the simulated rig.", default=False, python=False)
    plant: str | None = option(
        "--plant", text="Simulate it on another plant: a registered name, or a plant file; sizes in its units."
    )
    at: str = option(
        "--at",
        text="With --plant: inputs about which to move, and states at the start.",
        metavar="NAME=VALUE,...",
        default="",
    )
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    duration_s: float | None = option("--duration", text="Seconds of signal; 20, for decay 34.")
    amplitude_nm: float | None = option(
        "--amplitude",
        text="Torque in N m, of another plant its first input in its unit; what the model lets through else.",
    )
    model: Path | None = option(
        "--model", text="Model that foresees what the signal does; the filter's else.", metavar="FILE"
    )
    use_share: float = option(
        "--use", min=0.05, max=1.0, text="Of the limits, what the signal may use on the model.", default=0.8
    )
    seed: int = option("--seed", min=0, text="Seed of the signal, and of the rig.", default=0)
    clock_ticks: int = option("--clock", min=1, max=1000, text="prbs: ticks that a value is held.", default=1)
    low_hz: float = option("--low", text="chirp, multisine: lowest frequency in Hz.", default=0.3)
    high_hz: float = option("--high", text="chirp, multisine: highest frequency in Hz.", default=5.0)
    hold_s: float = option("--hold", text="steps: seconds of each.", default=0.4)
    kick_s: float = option("--kick", text="decay: seconds of input.", default=0.2)
    rest_s: float = option("--rest", text="decay: seconds without, after each kick.", default=8.0)
    torque_limit_nm: float = option("--max-torque", min=0.001, max=TORQUE_LIMIT_NM, text="Limit in N m.", default=0.3)
    speed_limit_rad_s: float = option(
        "--max-speed", min=0.1, text="Hoop speed in rad/s that ends the experiment.", default=45.0
    )
    angle_limit_rad: float = option(
        "--max-angle", min=0.01, max=3.2, text="Ball angle in rad that ends the experiment.", default=1.25
    )
    soft_start_s: float = option(
        "--soft-start", min=0.0, max=60.0, text="Seconds in which the amplitude rises.", default=1.0
    )
    soft_end_s: float = option("--soft-end", min=0.0, max=60.0, text="Seconds in which it falls.", default=0.5)
    centring_nm_per_rad_s: float = option(
        "--centring", min=0.0, max=0.05, text="Feedback that slows the hoop, N m per rad/s.", default=0.0
    )
    around: Path | None = option("--around", text="On top of this holding law.", metavar="CONTROLLER")
    signal_out: Path | None = option(
        "--signal-out",
        text="Write the signal for `hoopd controller --experiment` of a running daemon; nothing is played.",
        metavar="FILE",
        python=False,
    )
    no_ball: bool = option("--no-ball", text="There is no ball in the hoop; no camera needed.", default=False)
    record: Path | None = option("--record", text="Existing folder for the recording.", python=False)
    out: Path | None = option("--out", text="The recording's file (.mcap).", metavar="FILE", python="file")
    figure: Path | None = figure_option("Draw what was recorded.")
    speed: str = speed_option()
    camera: str | None = camera_option()
    arm: bool = arm_option()
    json_path: Path | None = json_option()
