"""Identification of linear and nonlinear models: `from hoopd.ident import arx, subspaceid, compare`.

Names are looked up when they are used: who asks for a test signal does not load the rest. Fits of a plant's own
equations are in `hoopd.plants`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

# Module by module, what it gives.
_GIVEN = {
    "data": "Data iddata experiments runs",
    "models": "Polynomials Innovations state_space innovations",
    "checks": "IdentificationWarning",
    "prediction": "simulate predict prediction_error estimate_x0 predictor_system error_system",
    "smoothing": "smoothed",
    "confidence": "response_spread pole_spread zero_spread",
    "measures": "fit_percent rms mse sse nrmse criteria aic aicc bic fpe parameters_of compare table",
    "residualtests": "residuals whiteness independence",
    "conditioning": "detrend trend applied scaled normalised ramp_in ramp_out joined merged predictor_data fill_gaps",
    "filtering": "prefilter filtered resample resampled_system resampled_covariance",
    "frequencydata": "FrequencyData frequency_axis transformed response between between_hz",
    "etfe": "empirical",
    "spectral": "tfest coherence power_spectrum correlation",
    "spectrogram": "model_spectrum noise_spectrum",
    "impulse": "impulseest",
    "bases": "laguerre kautz orthonormal leadlag add_poles pole fit_basis",
    "rationalfit": "rational fit_basis_response minimum_phase",
    "excitation": "two_levels linear_chirp step low_crest",
    "signals": "prbs chirp multisine steps crest_factor",
    "polynomial.arx": "arx varx",
    "polynomial.regression": "regressors",
    "polynomial.estimators": "least_squares total_least_squares weighted_total_least_squares frequency_weighted robust",
    "polynomial.ar": "ar arma arma_ssa driving_noise",
    "polynomial.plr": "plr",
    "polynomial.pem": "armax oe bj",
    "polynomial.ararx": "ararx",
    "polynomial.recursive": "RecursiveArx",
    "polynomial.orders": "scan",
    "polynomial.delay": "delay",
    "statespace.subspace": "subspaceid",
    "statespace.frequencysubspace": "frequency_subspace from_response",
    "statespace.okid": "okid",
    "statespace.era": "era era_of_data",
    "statespace.pem": "pem",
    "statespace.structured": "structured_pem",
    "statespace.nonlinear": "nonlinear_pem",
    "statespace.hammersteinwiener": "hammerstein_wiener",
    "statespace.stabilise": "stabilise",
    "statespace.similarity": "similarity_transform balanced reduced channels",
    "statespace.sampling": "sampled unsampled resampled sampled_cost",
    "statespace.uncertainty": "response_covariance pole_covariance",
}
_MODULES = {name: module for module, names in _GIVEN.items() for name in names.split()}

__all__ = sorted(_MODULES)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
