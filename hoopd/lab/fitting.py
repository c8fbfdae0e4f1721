"""Fits: from recordings to a model with intervals.

Rules of this file: thin over `hoopd.ident`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from hoopd.files.shipped import START_MODELS, defaults_folder
from hoopd.lab.models import Model, as_model
from hoopd.lab.pictures import Picture
from hoopd.lab.simulation import simulate
from hoopd.plants.fits.free_parameters import Prior
from hoopd.plants.fits.robust_least_squares import LOSSES
from hoopd.plants.hoop.fitting.fit import METHODS, FitSettings, FittedParameters, model_file, nominal_values
from hoopd.plants.hoop.fitting.fit import fit as fit_parameters
from hoopd.plants.hoop.fitting.identifiability import determined
from hoopd.plants.hoop.parameters import STRUCTURES
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
    model: Model | str | None = None,
    fix: Mapping[str, float] | Sequence[str] | str = (),
    free: Sequence[str] | str = (),
    prior: Mapping[str, tuple[float, float]] | None = None,
    channels: Sequence[str] | str = (),
    window: float | None = None,
    loss: str = "linear",
    method: str = "output",
) -> Fitted:
    """Fit the parameters of a structure to one recording or several.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        What was measured.
    structure : {"entries", "rolling", "published"}
        Of the model.
    model : Model or str, optional
        What it starts from; the shipped one of the structure unless given.
    fix : sequence of str, or mapping of str to float
        What is not fitted: by name at the start's value, or by {"mb": 0.06}.
    free : sequence of str
        What is fitted; all on which the recordings bear unless given.
    prior : mapping of str to (float, float), optional
        {name: (value, relative standard deviation)}.
    channels : sequence of str
        What is fitted to; psi and theta, or its rate where the model cannot follow theta, unless given.
    window : float, optional
        Length of the free runs in s; one over each recording unless given.
    loss : {"linear", "huber", "soft_l1", "cauchy"}
        Of the errors; linear is least squares.
    method : {"output", "prediction"}
        Free runs, or predictions from measurement to measurement.

    Returns
    -------
    Fitted
        The `model` with its 95 % `intervals`, and in `words` what the recordings do not determine.

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
    """
    together = (recordings,) if isinstance(recordings, Recording) else tuple(recordings)
    if not together or not all(isinstance(one, Recording) for one in together):
        raise ValueError("fit takes a recording or several: fit([lab.load('a.mcap'), lab.load('b.mcap')])")
    for value, known in ((structure, STRUCTURES), (loss, LOSSES), (method, METHODS)):
        if value not in known:
            raise ValueError(f"unknown {value!r}; known: {', '.join(known)}")
    base = as_model(model or defaults_folder() / START_MODELS[structure])
    nominal = nominal_values(base.file, structure)
    settings = FitSettings(
        structure=structure,
        free=_names(free),
        fixed=_fixed(fix, nominal),
        priors={name: _prior(name, one) for name, one in (prior or {}).items()},
        channels=_names(channels),
        window_s=window,
        loss=loss,
        method=method,
        encoder_counts=base.file.device.encoder_counts,
    )
    return Fitted(fit_parameters(together, nominal, settings), base, together)


def _names(given: Sequence[str] | str) -> tuple[str, ...]:
    """One name or several; a text is one name, not its letters."""
    return (given,) if isinstance(given, str) else tuple(given)


def _prior(name: str, given: tuple[float, float]) -> Prior:
    if not isinstance(given, tuple | list) or len(given) != 2 or not given[1] > 0.0:
        raise ValueError(f"prior: {name} needs (value, relative standard deviation above 0), not {given!r}")
    return Prior(*given)


def _fixed(fix: Mapping[str, float] | Sequence[str] | str, nominal: Mapping[str, float]) -> dict[str, float]:
    if isinstance(fix, Mapping):
        return {name: float(value) for name, value in fix.items()}
    names = _names(fix)
    unknown = [name for name in names if name not in nominal]
    if unknown:
        raise ValueError(f"fix: unknown {', '.join(unknown)}; known: {', '.join(nominal)}")
    return {name: nominal[name] for name in names}
