"""Prediction-error fits of the hoop: its structures, and the noise levels of the daemon's filter.

Rules of this file: it tells `plants.likelihood.prediction_error` what the hoop is; no mathematics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hoopd.plants.fits.runs import Run
from hoopd.plants.hoop.equations import ExtraForce
from hoopd.plants.hoop.fitting.filter_noise import NoiseModel
from hoopd.plants.hoop.fitting.hoop_output_error import HoopSystem
from hoopd.plants.likelihood import prediction_error
from hoopd.plants.likelihood.prediction_error import PredictionSolution


def fit_prediction_error(
    structure: str,
    values: Mapping[str, float],
    names: Sequence[str],
    runs: Sequence[Run],
    *,
    noise: NoiseModel | None = None,
    extra_forces: tuple[ExtraForce, ...] = (),
    **options: Any,
) -> PredictionSolution:
    """Parameters `names` of a structure (start: `values`) from runs prepared with the channels theta, dtheta, psi;
    options as in `plants.likelihood.prediction_error`."""
    system = HoopSystem(structure, values, extra_forces)
    return prediction_error.fit_prediction_error(system, names, runs, noise or NoiseModel(), **options)
