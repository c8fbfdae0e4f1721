"""Whether a model is stable, and whether it simulates about as well as it predicts.

Rules of this file: the data of the fit are looked at, some thousands of samples of each; only words come out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data
from hoopd.ident.doubts import warn
from hoopd.ident.prediction import prediction_error

Array = NDArray[np.float64]

# Simulation errors larger than the outputs' own change, and so many times those one step ahead, are told.
NO_BETTER_THAN_THE_MEAN, TIMES = 1.05, 3.0
MOST_SAMPLES = 6_000


def check_simulation(model: Any, each: Sequence[Data]) -> None:
    """Warn of a model that predicts and cannot simulate: it lives by the outputs that correct it."""
    ahead, simulated = relative_errors(model, each)
    if _worse(ahead, simulated):
        fits = " and ".join(_percent(one) for one in (ahead, simulated))
        warn(
            f"the model predicts and does not simulate: fit one step ahead and in simulation {fits}; it is no model of "
            "what the inputs do (another order or horizon, refine, or focus='simulation' if it is to simulate)"
        )


def simulates_worse(model: Any, each: Sequence[Data]) -> bool:
    """Whether `check_simulation` would warn."""
    return _worse(*relative_errors(model, each))


def relative_errors(model: Any, each: Sequence[Data]) -> tuple[float, float]:
    """|y - yhat| / |y - mean|, mean over the outputs, one step ahead and in simulation; infinite where it runs away."""
    parts = [one[:MOST_SAMPLES] for one in each]
    with np.errstate(all="ignore"):
        size = np.sqrt(sum(np.nansum(np.square(one.y - np.nanmean(one.y, axis=0)), axis=0) for one in parts))
        found = []
        for horizon in (1, np.inf):
            e = [prediction_error(model, one, horizon) for one in parts]
            if any(not np.isfinite(one[np.isfinite(part.y)]).all() for one, part in zip(e, parts, strict=True)):
                found.append(np.inf)
                continue
            off = np.sqrt(sum(np.nansum(np.square(one), axis=0) for one in e))
            found.append(float(np.mean(off / np.maximum(size, 1e-300))))
    return found[0], found[1]


def _worse(ahead: float, simulated: float) -> bool:
    return not simulated <= max(NO_BETTER_THAN_THE_MEAN, TIMES * ahead)


def _percent(error: float) -> str:
    return f"{100.0 * (1.0 - error):.0f} %" if error < 100.0 else "beyond every bound"
