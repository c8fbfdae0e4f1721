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

# What nobody tells is meant for samples of 20 ms.
OF_ANOTHER = "with --plant as many samples"


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
    low_hz: float | None = option("--low", text=f"chirp, multisine: lowest frequency in Hz; 0.3, {OF_ANOTHER}.")
    high_hz: float | None = option("--high", text=f"chirp, multisine: highest frequency in Hz; 5, {OF_ANOTHER}.")
    hold_s: float | None = option("--hold", text=f"steps: seconds of each; 0.4, {OF_ANOTHER}.")
    kick_s: float | None = option("--kick", text=f"decay: seconds of input; 0.2, {OF_ANOTHER}.")
    rest_s: float | None = option("--rest", text=f"decay: seconds without, after each kick; 8, {OF_ANOTHER}.")
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
