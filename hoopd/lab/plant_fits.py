"""Fits and free runs of any declared plant.

Rules of this file: what `lab.fit` and `lab.simulate` return of other plants than the hoop; thin over
`hoopd.plants.fits`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from hoopd.lab.pictures import Picture
from hoopd.plants.declaration import Plant
from hoopd.plants.fits.plant_fit import ChannelFit, PlantFit
from hoopd.plants.fits.plant_simulation import PlantSimulation, simulate_plant
from hoopd.plants.plant_model import PlantModel, with_parameters
from hoopd.plots.plant import draw_comparison
from hoopd.recording.recording import Recording


@dataclass(frozen=True, repr=False)
class PlantRun:
    """A free run over a recording; `.percent` says how well it repeats each channel."""

    run: PlantSimulation
    recording: Recording
    name: str

    @property
    def recorded(self) -> Recording:
        """What the sensors would have shown."""
        return self.run.simulated

    @property
    def percent(self) -> dict[str, float]:
        """Percent of fit by channel."""
        return {channel: one.nrmse_percent for channel, one in self.run.percent.items()}

    def __repr__(self) -> str:
        return (
            f"PlantRun({self.name}, {', '.join(f'{c} {p:.1f} %' for c, p in self.percent.items()) or 'not measured'})"
        )

    def plot(self) -> Picture:
        """Inputs, measured against simulated, what is left."""
        return Picture(draw_comparison(self.name, self.recording, self.recorded, self.percent))


@dataclass(frozen=True, repr=False)
class FittedPlant:
    """A fit; `.model` is what every other function takes."""

    fit: PlantFit
    base: PlantModel
    recordings: tuple[Recording, ...]

    @property
    def model(self) -> PlantModel:
        """The fitted model, effects and all."""
        file = with_parameters(self.base, self.values, self.intervals, "fitted").file
        return replace(self.base, plant=self.plant, file=file)

    @property
    def plant(self) -> Plant:
        """The plant with the values found as its nominal ones."""
        declared = self.fit.system.plant
        return replace(declared, values={name: self.fit.values[name] for name in declared.values})

    @property
    def values(self) -> Mapping[str, float]:
        """Every parameter."""
        return self.fit.values

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """95 % intervals of what was fitted."""
        return self.fit.intervals

    @property
    def percent(self) -> dict[str, dict[str, ChannelFit]]:
        """Fit by recording and channel."""
        return self.fit.percent

    def __repr__(self) -> str:
        return f"FittedPlant({self.plant.name}, {', '.join(self.intervals) or 'starts alone'})"

    def table(self) -> str:
        """Parameters, 95 % intervals and units as text."""
        units = self.plant.units
        rows = [
            f"{name:12} {self.values[name]:12.6g} {units.get(name, ''):8} {low:.6g} to {high:.6g}"
            for name, (low, high) in self.intervals.items()
        ]
        return "\n".join(rows or ["no parameter was fitted"])

    def plot(self) -> Picture:
        """The first recording and the fitted plant's free run over it."""
        first = self.recordings[0]
        return PlantRun(simulate_plant(self.fit.fitted, first), first, self.plant.name).plot()
