"""Controllers of other plants than the hoop.

Rules of this file: thin over `hoopd.commands.plant_design`; channels, inputs and units are the plant's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hoopd.commands.plant_design import PlantDesign
from hoopd.commands.plant_design_record import figure_of, write
from hoopd.design.linear_law import LinearLaw
from hoopd.design.margins import Margins, margins
from hoopd.design.plant_loop import PlantLoopRun, StateFeedback
from hoopd.design.poles import Pole
from hoopd.files.plant_controller import PlantControllerFile
from hoopd.lab.pictures import Picture


@dataclass(frozen=True, repr=False)
class DesignedPlant:
    """A law for another plant than the hoop, with its loop."""

    design: PlantDesign
    model_path: Path | None = None

    def __repr__(self) -> str:
        file, model = self.controller_file, self.design.linear.model
        steered = f"{', '.join(file.inputs)} from {', '.join(file.channels)}"
        return f"DesignedPlant({file.name} for {model.name}: {steered}, every {file.sample_time_s:g} s)"

    @property
    def controller_file(self) -> PlantControllerFile:
        """Matrices, operating point, limits, by the plant's names."""
        return self.design.file

    @property
    def linear(self) -> LinearLaw:
        """Gains, sampled model and loop as python-control systems."""
        return self.design.law

    @property
    def feedback(self) -> NDArray[np.float64]:
        """K (inputs, states)."""
        return np.asarray(self.design.law.feedback)

    @property
    def margins(self) -> Margins | None:
        """Phase in rad, delay in s, factors of gain, largest |S| and |T|; None with several inputs."""
        return self.design.margins

    def margins_later(self, delay: float) -> Margins:
        """The same law in a loop that is `delay` s later; ValueError with several inputs."""
        if self.design.margins is None:
            raise ValueError("margins are those of one input")
        return margins(self.design.law.loop, delay)

    @property
    def poles(self) -> list[Pole]:
        """Of the closed loop, the slowest first."""
        return self.design.poles

    @property
    def notes(self) -> tuple[str, ...]:
        """What model and run leave out."""
        return self.design.notes

    @property
    def run(self) -> PlantLoopRun:
        """The plant, let go a tenth of its usual sizes beside the operating point."""
        return self.design.run

    def law(self) -> StateFeedback:
        """The law at its beginning: `.update({channel: value})` gives the inputs."""
        return StateFeedback(self.design.file)

    def plot(self) -> Picture:
        """That run, beside the linear model's."""
        return Picture(figure_of(self.design))

    def save(self, path: Path | str) -> Path:
        """Write `hoopd.controller/1` for a program of your own."""
        write(self.design, Path(path), self.model_path)
        return Path(path)
