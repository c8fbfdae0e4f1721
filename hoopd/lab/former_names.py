"""Functions under their former names, each with a warning that tells the new one.

Rules of this file: every function calls another one of the lab, and does nothing else.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

from hoopd.lab.fitting import fit
from hoopd.lab.plant_fits import FittedPlant, PlantRun
from hoopd.lab.simulation import simulate
from hoopd.plants.declaration import Plant
from hoopd.plants.registry import resolve_plant
from hoopd.recording.recording import Recording


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
    """Fit parameters of any plant, as `fit` with `plant` does.

    Parameters
    ----------
    plant : Plant or str
        A declaration, a registered name or a plant file.
    recordings : Recording or sequence of Recording
        What was measured.
    fix, prior, window, loss, method : optional
        As of `fit`.
    free : sequence of str, optional
        As of `fit`, but an empty one fits the starts alone.

    Returns
    -------
    FittedPlant
        Values, 95 % intervals, percent of fit.

    Examples
    --------
    >>> fit_plant("falling", lab.load("fall.csv", "h=Height:m", plant="falling"))  # doctest: +SKIP
    """
    warnings.warn("lab.fit_plant(PLANT, ...) is now lab.fit(..., plant=PLANT)", DeprecationWarning, stacklevel=2)
    declared = resolve_plant(plant) if isinstance(plant, str) else plant
    held = {name: declared.values[name] for name in declared.free} if free is not None and not free else {}
    found = fit(
        recordings, plant=declared, fix={**held, **(fix or {})}, free=free or (), prior=prior, window=window, loss=loss,
        method=method,
    )  # fmt: skip
    assert isinstance(found, FittedPlant)
    return found


def simulate_plant(
    plant: Plant | str, recording: Recording, x0: Mapping[str, float] | None = None, *, step: float | None = None
) -> PlantRun:
    """Run any plant freely under a recording's inputs, as `simulate` with `plant` does.

    Parameters
    ----------
    plant : Plant or str
        A declaration, a registered name or a plant file.
    recording : Recording
        With the plant's inputs.
    x0, step : optional
        As of `simulate`.

    Returns
    -------
    PlantRun
        What the sensors would have shown, and percent of fit by channel.

    Examples
    --------
    >>> simulate_plant("tanks", lab.load("pump.csv", "q=Pump", plant="tanks"))  # doctest: +SKIP
    """
    warnings.warn(
        "lab.simulate_plant(PLANT, ...) is now lab.simulate(plant=PLANT, input=...)", DeprecationWarning, stacklevel=2
    )
    found = simulate(None, recording, x0, plant=plant, step=step)
    assert isinstance(found, PlantRun)
    return found
