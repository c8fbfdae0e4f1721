"""Fits: from recordings to a model with intervals.

Rules of this file: `hoopd fit` on recordings in memory; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hoopd.commands.fit import fitted
from hoopd.commands.fit_options import settings_of, start_model
from hoopd.commands.fit_plant import fitted_plant
from hoopd.commands.options.declaration import from_python
from hoopd.commands.options.fit import FitOptions
from hoopd.lab.models import Model, as_model, check_of_hoop, model_of
from hoopd.lab.pictures import Picture
from hoopd.lab.plant_fits import FittedPlant
from hoopd.lab.simulation import simulate
from hoopd.plants.declaration import Plant
from hoopd.plants.hoop.fitting.fit import FittedParameters, model_file, nominal_values
from hoopd.plants.hoop.fitting.identifiability import determined
from hoopd.plants.plant_model import PlantModel
from hoopd.plots.parameters import draw_intervals
from hoopd.recording.recording import Recording


@dataclass(frozen=True, repr=False)
class Fitted:
    """A fit; `.model` is what every other function takes."""

    fit: FittedParameters  # values, intervals, correlations, residuals
    base: Model
    recordings: tuple[Recording, ...]

    def __repr__(self) -> str:
        return f"Fitted({self.model!r})"

    @cached_property
    def model(self) -> Model:
        """The fitted model."""
        return Model(model_file(self.fit, self.base.file, "fitted"))

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """95 % intervals of what was fitted."""
        return self.fit.intervals

    @cached_property
    def words(self) -> list[str]:
        """What the recordings do not determine, in words."""
        return determined(self.fit.solution, self.fit.uncertainty, self.fit.structure).words

    def table(self) -> str:
        """Parameters, 95 % intervals and units as text."""
        return self.model.table()

    def plot(self) -> Picture:
        """The first recording and the fitted model's free run over it."""
        return simulate(self.model, self.recordings[0]).plot()

    def plot_intervals(self, truth: Model | None = None) -> Picture:
        """95 % intervals, each relative to its value; `truth`: the numbers that made the recording, where known."""
        true = None if truth is None else truth.parameters
        return Picture(draw_intervals(self.fit.values, self.intervals, true))


def fit(
    recordings: Recording | Sequence[Recording],
    structure: str = "entries",
    *,
    plant: Plant | str | None = None,
    model: Model | PlantModel | Path | str | None = None,
    fix: Mapping[str, float] | Sequence[str] | str = (),
    free: Sequence[str] | str = (),
    prior: Mapping[str, tuple[float, float]] | None = None,
    channels: Sequence[str] | str = (),
    window: float | None = None,
    loss: str = "linear",
    method: str = "output",
) -> Fitted | FittedPlant:
    """Fit the parameters of any plant to one recording or several.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        What was measured.
    structure : {"entries", "rolling", "published"}
        Of the hoop's model.
    plant : Plant or str, optional
        A declaration, a registered name or a plant file; the model's unless given.
    model : Model, str or Path, optional
        What it starts from; the plant's nominal values (of the hoop the shipped model of the structure) unless given.
    fix : sequence of str, or mapping of str to float
        What is not fitted: by name at the start's value, or by {"mb": 0.06}.
    free : sequence of str
        What is fitted; of the hoop all on which the recordings bear, of another plant its own choice unless given.
    prior : mapping of str to (float, float), optional
        {name: (value, standard deviation)}; relative where the parameter is positive.
    channels : sequence of str
        What is fitted to; of the hoop psi and theta, or its rate where the model cannot follow theta, of another plant
        all of its channels unless given.
    window : float, optional
        Length of the free runs in s; one over each recording unless given.
    loss : {"linear", "huber", "soft_l1", "cauchy"}
        Of the errors; linear is least squares.
    method : {"output", "prediction"}
        Free runs, or predictions from measurement to measurement.

    Returns
    -------
    Fitted or FittedPlant
        The `model` with its 95 % `intervals`; of the hoop in `words` what the recordings do not determine.

    Raises
    ------
    ValueError
        A name that there is not.
    InputError
        Nothing to fit.

    Examples
    --------
    >>> import hoopd.lab as lab
    >>> fitted = lab.fit(lab.experiment("prbs", duration=6, seed=1))
    >>> low, high = fitted.intervals["K2"]
    >>> low < fitted.model.parameters["K2"] < high
    True
    >>> import numpy as np
    >>> from hoopd.recording import from_signals
    >>> t = np.arange(0.0, 2.0, 0.02)
    >>> fall = from_signals(t, {}, {"h": 40.0 - 9.81 / 2 * t**2})
    >>> found = lab.fit(fall, plant="falling", free="g")
    >>> round(found.values["g"], 4), found.plant.values["m"]
    (9.81, 1.0)
    """
    together = (recordings,) if isinstance(recordings, Recording) else tuple(recordings)
    if not together or not all(isinstance(one, Recording) for one in together):
        raise ValueError("fit takes a recording or several: fit([lab.load('a.mcap'), lab.load('b.mcap')])")
    asked = from_python(
        FitOptions, recordings=(), structure=structure, fix=fix, free=free, prior=_priors(prior or {}),
        channels=channels, window=window, loss=loss, method=method,
    )  # fmt: skip
    if (other := model_of(plant, model)) is not None:
        return FittedPlant(fitted_plant(other, together, asked), other, together)
    if isinstance(model, PlantModel):
        raise ValueError("fit starts from a model of the hoop by name or path: lab.model('hoop')")
    base = as_model(start_model(asked) if model is None else model)
    nominal, settings = nominal_values(base.file, structure), settings_of(asked, base.file)
    check_of_hoop(together)
    return Fitted(fitted(together, nominal, settings), base, together)


def _priors(given: Mapping[str, tuple[float, float]]) -> list[str]:
    """As the command line says them."""
    for name, one in given.items():
        if not isinstance(one, tuple | list) or len(one) != 2 or not one[1] > 0.0:
            raise ValueError(f"prior: {name} needs (value, standard deviation above 0), not {one!r}")
    return [f"{name}={value}:{sigma}" for name, (value, sigma) in given.items()]
