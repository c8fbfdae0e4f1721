"""Options of `hoopd simulate`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import REQUIRED, option
from hoopd.commands.options.shared import (
    SLICE,
    age_option,
    columns_option,
    figure_option,
    hold_option,
    json_option,
    plant_option,
)


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """Run a model or a plant freely with the inputs of a recording, and compare with what was measured."""

    model: Path | None = option(
        "--model",
        text="Model file of `hoopd fit` or `diagnose`, or a shipped one: models/hoop.yaml, models/thesis.yaml.",
        metavar="MODEL",
    )
    plant: str | None = plant_option()
    recording: str = option(
        "--input", text=f"Recording whose inputs are applied: {SLICE}.", metavar="REC", default=REQUIRED
    )
    figure: Path | None = figure_option()
    columns: str | None = columns_option()
    hold: str = hold_option()
    age: str = age_option()
    x0: str | None = option(
        "--x0",
        text="Start (states by name, SI units) instead of an estimated one, the rest 0.",
        metavar="psi=0.4,dtheta=0",
    )
    step_s: float = option("--step", text="Longest integration step in seconds.", default=0.01)
    moving: str = option(
        "--moving", text="What moves: both, hoop, ball, or auto: as the recording shows.", default="auto"
    )
    without_effects: bool = option("--without-effects", text="Leave the model's effects out.", default=False)
    out: Path | None = option(
        "--out", text="Write the simulated run (.csv, .mcap, .mat or .h5).", metavar="FILE", python=False
    )
    json_path: Path | None = json_option()
