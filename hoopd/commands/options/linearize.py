"""Options of `hoopd linearize`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import option
from hoopd.commands.options.shared import figure_option, json_option, model_option, plant_option


@dataclass(frozen=True, kw_only=True)
class LinearizeOptions:
    """Linear model around an operating point (the bottom at rest), and what it says (docs/explanations/linear.md)."""

    model: Path | None = model_option(default=None)
    plant: str | None = plant_option()
    outputs: tuple[str, ...] = option(
        "--output",
        text="Measured: psi (unless told), theta, dtheta or dpsi, or channels of another plant; repeatable.",
        metavar="NAME",
        default=(),
        python="outputs",
    )
    at: str = option(
        "--at",
        text="Another plant: inputs that are held (0), and states near which to look for the equilibrium; one that "
        "needs an input that was not named is refused.",
        metavar="NAME=VALUE,...",
        default="",
    )
    held_rad: float | None = option("--psi", text="Ball held at this angle (rad), hoop turning.")
    turning_rad_s: float | None = option(
        "--hoop-speed", text="Hoop turning at this speed (rad/s), ball held up its side."
    )
    top: bool = option("--top", text="Ball at rest at the top.", default=False)
    sample_time_s: float | None = option("--sample-time", text="Hold the inputs over this time (s): the sampled plant.")
    delay_samples: int = option("--delay", text="Samples of delay in the sampled plant.", default=0)
    figure: Path | None = figure_option()
    plot: str | None = option(
        "--plot", text="What --figure shows: overview, bode, nyquist, poles or step.", python=False
    )
    json_path: Path | None = json_option()
