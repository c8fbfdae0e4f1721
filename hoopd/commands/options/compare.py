"""Options of `hoopd compare`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.running import camera_option, config_option, sets_option
from hoopd.commands.options.shared import figure_option, json_option


@dataclass(frozen=True, kw_only=True)
class CompareOptions:
    """Let two controllers take turns in one run, in random order, until it is clear which one is better."""

    accepted: Path = argument("The controller that acts: to it the run goes back.", metavar="A")
    candidate: Path = argument("The one that is tried.", metavar="B")
    sim: bool = option("--sim", text="On the simulated rig, as fast as it goes.", default=False, python=False)
    config: Path | None = config_option()
    sets: tuple[str, ...] = sets_option()
    blocks: int = option("--blocks", text="Blocks at most, an even number; each is one controller's turn.", default=20)
    settle_s: float = option("--settle", text="Seconds of each block that do not count.", default=2.0)
    hold_s: float = option("--hold", text="Seconds of each of a block's four references.", default=2.0)
    amplitude_rad: float = option("--amplitude", text="Ball angle in rad of the references.", default=0.1)
    by: str = option(
        "--by", text="What decides: ball (its error), or cost (of the design: torque is charged).", default="ball"
    )
    alpha: float = option("--alpha", text="How often two equal controllers may be called different.", default=0.05)
    seed: int = option("--seed", min=0, text="Seed of the order, and of the rig.", default=0)
    record: Path | None = option("--record", text="Existing folder for the recording (--sim).", python="folder")
    figure: Path | None = figure_option("Draw the pairs and the interval.")
    camera: str | None = camera_option()
    json_path: Path | None = json_option()
