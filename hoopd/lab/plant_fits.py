"""Fits and free runs of any declared plant.

Rules of this file: thin over `hoopd.plants.fits`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from hoopd.lab.pictures import Picture
from hoopd.plants.declaration import Plant
from hoopd.plants.fits import plant_fit
from hoopd.plants.fits.free_parameters import Prior
from hoopd.plants.fits.plant_fit import ChannelFit, PlantFit
from hoopd.plants.fits.plant_runs import PlantSystem
from hoopd.plants.fits.plant_simulation import PlantSimulation
from hoopd.plants.fits.plant_simulation import simulate_plant as simulate_system
from hoopd.plants.registry import resolve_plant
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
    """A fit; `.plant` is what every other function takes."""

    fit: PlantFit
    recordings: tuple[Recording, ...]

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
        return simulate_plant(self.plant, self.recordings[0]).plot()


def fit_plant(
    plant: Plant | str,
    recordings: Recording | Sequence[Recording],
    *,
    fix: Mapping[str, float] | None = None,
    free: Sequence[str] | None = None,
    prior: Mapping[str, tuple[float, float]] | None = None,
    window: float | None = None,
    loss: str = "linear",
    method: str = "output",
) -> FittedPlant:
    """Fit parameters of any plant to one recording or several.

    Parameters
    ----------
    plant : Plant or str
        A declaration, a registered name or a plant file.
    recordings : Recording or sequence of Recording
        With the plant's inputs and at least one of its channels.
    fix : mapping of str to float, optional
        Not fitted, {"M": 95}.
    free : sequence of str, optional
        Fitted in place of the plant's own choice; an empty one fits the starts alone.
    prior : mapping of str to tuple, optional
        Known beforehand: value, and relative standard deviation of a positive parameter, else the absolute one.
    window : float, optional
        Runs of so many s with a start each.
    loss : {"linear", "huber", "soft_l1", "cauchy"}
        All but the first bear outliers.
    method : {"output", "prediction"}
        Free runs, or the likelihood of a filter's innovations.

    Returns
    -------
    FittedPlant
        Values, 95 % intervals, percent of fit.

    Raises
    ------
    InputError
        When there is nothing to fit, or a name is none.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.recording import from_signals
    >>> t = np.arange(0.0, 2.0, 0.02)
    >>> fall = from_signals(t, {}, {"h": 40.0 - 9.81 / 2 * t**2})
    >>> found = fit_plant("falling", fall, free=("g",))
    >>> round(found.values["g"], 4), found.plant.values["m"]
    (9.81, 1.0)
    """
    declared = resolve_plant(plant) if isinstance(plant, str) else plant
    together = (recordings,) if isinstance(recordings, Recording) else tuple(recordings)
    names = [name for name in (declared.free if free is None else free) if name not in (fix or {})]
    beliefs = {name: Prior(*one) for name, one in (prior or {}).items()}
    found = plant_fit.fit_plant(
        declared, together, names, method, values=fix, priors=beliefs, window_s=window, loss=loss
    )  # fmt: skip
    return FittedPlant(found, together)


def simulate_plant(
    plant: Plant | str, recording: Recording, x0: Mapping[str, float] | None = None, *, step: float | None = None
) -> PlantRun:
    """Run any plant freely under a recording's inputs.

    Parameters
    ----------
    plant : Plant or str
        A declaration, a registered name or a plant file.
    recording : Recording
        With the plant's inputs.
    x0 : mapping of str to float, optional
        States at the start, the rest 0; those that fit the recording best unless given.
    step : float, optional
        Longest integration step in s; half the plant's usual sample time unless given.

    Returns
    -------
    PlantRun
        What the sensors would have shown, and percent of fit by channel.

    Raises
    ------
    InputError
        An input that is missing, a name that is no state, or a run that leaves every bound.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.recording import from_signals
    >>> pump = from_signals(np.arange(0.0, 60.0), {"q": np.full(60, 5e-5)})
    >>> bool(simulate_plant("tanks", pump).recorded.channels["h1"].values[-1] > 0.05)
    True
    """
    declared = resolve_plant(plant) if isinstance(plant, str) else plant
    return PlantRun(simulate_system(PlantSystem(declared, step_s=step), recording, x0), recording, declared.name)
