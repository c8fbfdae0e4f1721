"""Identification of linear and nonlinear models: `from hoopd.ident import arx, subspaceid, compare`.

Names are looked up when they are used: who asks for a test signal does not load the rest. Type checkers and editors
read the imports below, which run for them alone; a test holds that both say the same. Fits of a plant's own equations
are in `hoopd.plants`, figures of models in `hoopd.plots`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hoopd.ident.bases import (
        add_poles as add_poles,
    )
    from hoopd.ident.bases import (
        kautz as kautz,
    )
    from hoopd.ident.bases import (
        laguerre as laguerre,
    )
    from hoopd.ident.bases import (
        leadlag as leadlag,
    )
    from hoopd.ident.bases import (
        orthonormal as orthonormal,
    )
    from hoopd.ident.bases import (
        pole as pole,
    )
    from hoopd.ident.basis_fit import (
        fit_basis as fit_basis,
    )
    from hoopd.ident.conditioning import (
        apply as apply,
    )
    from hoopd.ident.conditioning import (
        concatenate as concatenate,
    )
    from hoopd.ident.conditioning import (
        merge as merge,
    )
    from hoopd.ident.conditioning import (
        normalize as normalize,
    )
    from hoopd.ident.conditioning import (
        predictor_data as predictor_data,
    )
    from hoopd.ident.conditioning import (
        ramp_in as ramp_in,
    )
    from hoopd.ident.conditioning import (
        ramp_out as ramp_out,
    )
    from hoopd.ident.conditioning import (
        scale as scale,
    )
    from hoopd.ident.confidence import (
        pole_spread as pole_spread,
    )
    from hoopd.ident.confidence import (
        response_spread as response_spread,
    )
    from hoopd.ident.confidence import (
        zero_spread as zero_spread,
    )
    from hoopd.ident.continuous_transfer import srivc as srivc
    from hoopd.ident.data import Data as Data
    from hoopd.ident.data import experiments as experiments
    from hoopd.ident.data import iddata as iddata
    from hoopd.ident.data import runs as runs
    from hoopd.ident.delayed_model import DelayedModel as DelayedModel
    from hoopd.ident.doubts import IdentificationWarning as IdentificationWarning
    from hoopd.ident.empirical_response import etfe as etfe
    from hoopd.ident.excitation import (
        linear_chirp as linear_chirp,
    )
    from hoopd.ident.excitation import (
        low_crest as low_crest,
    )
    from hoopd.ident.excitation import (
        step as step,
    )
    from hoopd.ident.excitation import (
        two_levels as two_levels,
    )
    from hoopd.ident.filtering import (
        idfilt as idfilt,
    )
    from hoopd.ident.filtering import (
        prefilter as prefilter,
    )
    from hoopd.ident.filtering import (
        resample as resample,
    )
    from hoopd.ident.filtering import (
        resample_covariance as resample_covariance,
    )
    from hoopd.ident.filtering import (
        resample_system as resample_system,
    )
    from hoopd.ident.forecasting import forecast as forecast
    from hoopd.ident.frequencydata import (
        FrequencyData as FrequencyData,
    )
    from hoopd.ident.frequencydata import (
        between as between,
    )
    from hoopd.ident.frequencydata import (
        between_hz as between_hz,
    )
    from hoopd.ident.frequencydata import (
        fft as fft,
    )
    from hoopd.ident.frequencydata import (
        frequency_axis as frequency_axis,
    )
    from hoopd.ident.frequencydata import (
        frequency_response as frequency_response,
    )
    from hoopd.ident.gaps import (
        fill_gaps as fill_gaps,
    )
    from hoopd.ident.impulse import impulseest as impulseest
    from hoopd.ident.information_criteria import (
        aic as aic,
    )
    from hoopd.ident.information_criteria import (
        aicc as aicc,
    )
    from hoopd.ident.information_criteria import (
        bic as bic,
    )
    from hoopd.ident.information_criteria import (
        criteria as criteria,
    )
    from hoopd.ident.information_criteria import (
        fpe as fpe,
    )
    from hoopd.ident.information_criteria import (
        parameters_of as parameters_of,
    )
    from hoopd.ident.measures import (
        fit_percent as fit_percent,
    )
    from hoopd.ident.measures import (
        mse as mse,
    )
    from hoopd.ident.measures import (
        nrmse as nrmse,
    )
    from hoopd.ident.measures import (
        rms as rms,
    )
    from hoopd.ident.measures import (
        sse as sse,
    )
    from hoopd.ident.model_comparison import (
        compare as compare,
    )
    from hoopd.ident.model_comparison import (
        table as table,
    )
    from hoopd.ident.model_forms import innovation_form as innovation_form
    from hoopd.ident.models import (
        Innovations as Innovations,
    )
    from hoopd.ident.models import (
        Polynomials as Polynomials,
    )
    from hoopd.ident.models import (
        innovations as innovations,
    )
    from hoopd.ident.models import (
        state_space as state_space,
    )
    from hoopd.ident.polynomial.ar import ar as ar
    from hoopd.ident.polynomial.ar import arma as arma
    from hoopd.ident.polynomial.ar import arma_ssa as arma_ssa
    from hoopd.ident.polynomial.ar import driving_noise as driving_noise
    from hoopd.ident.polynomial.ararx import ararx as ararx
    from hoopd.ident.polynomial.arx import arx as arx
    from hoopd.ident.polynomial.arx import varx as varx
    from hoopd.ident.polynomial.delay import delay as delay
    from hoopd.ident.polynomial.estimators import (
        frequency_weighted as frequency_weighted,
    )
    from hoopd.ident.polynomial.estimators import (
        least_squares as least_squares,
    )
    from hoopd.ident.polynomial.estimators import (
        robust as robust,
    )
    from hoopd.ident.polynomial.estimators import (
        total_least_squares as total_least_squares,
    )
    from hoopd.ident.polynomial.estimators import (
        weighted_total_least_squares as weighted_total_least_squares,
    )
    from hoopd.ident.polynomial.lpv import lpv_arx as lpv_arx
    from hoopd.ident.polynomial.orders import scan as scan
    from hoopd.ident.polynomial.pem import armax as armax
    from hoopd.ident.polynomial.pem import bj as bj
    from hoopd.ident.polynomial.pem import oe as oe
    from hoopd.ident.polynomial.plr import plr as plr
    from hoopd.ident.polynomial.recursive import RecursiveArx as RecursiveArx
    from hoopd.ident.polynomial.regression import regressors as regressors
    from hoopd.ident.prediction import (
        estimate_x0 as estimate_x0,
    )
    from hoopd.ident.prediction import (
        predict as predict,
    )
    from hoopd.ident.prediction import (
        prediction_error as prediction_error,
    )
    from hoopd.ident.prediction import (
        simulate as simulate,
    )
    from hoopd.ident.predictor_systems import error_system as error_system
    from hoopd.ident.predictor_systems import predictor_system as predictor_system
    from hoopd.ident.rationalfit import (
        fit_basis_response as fit_basis_response,
    )
    from hoopd.ident.rationalfit import (
        minimum_phase as minimum_phase,
    )
    from hoopd.ident.rationalfit import (
        rational as rational,
    )
    from hoopd.ident.resampling import c2d as c2d
    from hoopd.ident.resampling import d2c as d2c
    from hoopd.ident.resampling import d2d as d2d
    from hoopd.ident.residualtests import independence as independence
    from hoopd.ident.residualtests import residuals as residuals
    from hoopd.ident.residualtests import whiteness as whiteness
    from hoopd.ident.result_summary import summary as summary
    from hoopd.ident.signals import (
        chirp as chirp,
    )
    from hoopd.ident.signals import (
        crest_factor as crest_factor,
    )
    from hoopd.ident.signals import (
        multisine as multisine,
    )
    from hoopd.ident.signals import (
        prbs as prbs,
    )
    from hoopd.ident.signals import (
        steps as steps,
    )
    from hoopd.ident.simulated_example import example_data as example_data
    from hoopd.ident.smoothing import smooth as smooth
    from hoopd.ident.smoothing import state_filter as state_filter
    from hoopd.ident.spectral import (
        coherence as coherence,
    )
    from hoopd.ident.spectral import (
        correlation as correlation,
    )
    from hoopd.ident.spectral import (
        power_spectrum as power_spectrum,
    )
    from hoopd.ident.spectral import (
        tfest as tfest,
    )
    from hoopd.ident.spectrogram import model_spectrum as model_spectrum
    from hoopd.ident.spectrogram import noise_spectrum as noise_spectrum
    from hoopd.ident.stacked_models import stack as stack
    from hoopd.ident.statespace.era import era as era
    from hoopd.ident.statespace.era import era_of_data as era_of_data
    from hoopd.ident.statespace.frequencysubspace import (
        frequency_subspace as frequency_subspace,
    )
    from hoopd.ident.statespace.frequencysubspace import (
        from_response as from_response,
    )
    from hoopd.ident.statespace.hammersteinwiener import hammerstein_wiener as hammerstein_wiener
    from hoopd.ident.statespace.lpv import lpv_pem as lpv_pem
    from hoopd.ident.statespace.nonlinear import nonlinear_pem as nonlinear_pem
    from hoopd.ident.statespace.okid import okid as okid
    from hoopd.ident.statespace.pbsid import pbsid as pbsid
    from hoopd.ident.statespace.pem import pem as pem
    from hoopd.ident.statespace.sampling import sampled_cost as sampled_cost
    from hoopd.ident.statespace.similarity import (
        balance as balance,
    )
    from hoopd.ident.statespace.similarity import (
        channels as channels,
    )
    from hoopd.ident.statespace.similarity import (
        reduce as reduce,
    )
    from hoopd.ident.statespace.similarity import (
        similarity_transform as similarity_transform,
    )
    from hoopd.ident.statespace.stabilise import stabilize as stabilize
    from hoopd.ident.statespace.structured import structured_pem as structured_pem
    from hoopd.ident.statespace.subspace import subspaceid as subspaceid
    from hoopd.ident.statespace.uncertainty import (
        pole_covariance as pole_covariance,
    )
    from hoopd.ident.statespace.uncertainty import (
        response_covariance as response_covariance,
    )
    from hoopd.ident.step_responses import impulse_response as impulse_response
    from hoopd.ident.step_responses import step_response as step_response
    from hoopd.ident.structure_search import identify as identify
    from hoopd.ident.trends import (
        detrend as detrend,
    )
    from hoopd.ident.trends import (
        trend as trend,
    )
    from hoopd.ident.uncertain import possible_models as possible_models
    from hoopd.ident.vectorfit import rational_matrix as rational_matrix

# Module by module, what it gives.
_GIVEN = {
    "data": "Data iddata experiments runs",
    "simulated_example": "example_data",
    "models": "Polynomials Innovations state_space innovations",
    "model_forms": "innovation_form",
    "stacked_models": "stack",
    "structure_search": "identify",
    "result_summary": "summary",
    "doubts": "IdentificationWarning",
    "prediction": "simulate predict prediction_error estimate_x0",
    "predictor_systems": "predictor_system error_system",
    "smoothing": "smooth state_filter",
    "uncertain": "possible_models",
    "continuous_transfer": "srivc",
    "polynomial.lpv": "lpv_arx",
    "statespace.lpv": "lpv_pem",
    "confidence": "response_spread pole_spread zero_spread",
    "forecasting": "forecast",
    "step_responses": "impulse_response step_response",
    "measures": "fit_percent rms mse sse nrmse",
    "information_criteria": "criteria aic aicc bic fpe parameters_of",
    "model_comparison": "compare table",
    "residualtests": "residuals whiteness independence",
    "conditioning": "apply scale normalize ramp_in ramp_out concatenate merge predictor_data",
    "trends": "detrend trend",
    "gaps": "fill_gaps",
    "delayed_model": "DelayedModel",
    "resampling": "c2d d2c d2d",
    "filtering": "prefilter idfilt resample resample_system resample_covariance",
    "frequencydata": "FrequencyData frequency_axis fft frequency_response between between_hz",
    "empirical_response": "etfe",
    "spectral": "tfest coherence power_spectrum correlation",
    "spectrogram": "model_spectrum noise_spectrum",
    "impulse": "impulseest",
    "bases": "laguerre kautz orthonormal leadlag add_poles pole",
    "basis_fit": "fit_basis",
    "vectorfit": "rational_matrix",
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
    "statespace.pbsid": "pbsid",
    "statespace.era": "era era_of_data",
    "statespace.pem": "pem",
    "statespace.structured": "structured_pem",
    "statespace.nonlinear": "nonlinear_pem",
    "statespace.hammersteinwiener": "hammerstein_wiener",
    "statespace.stabilise": "stabilize",
    "statespace.similarity": "similarity_transform balance reduce channels",
    "statespace.sampling": "sampled_cost",
    "statespace.uncertainty": "response_covariance pole_covariance",
}
_MODULES = {name: module for module, names in _GIVEN.items() for name in names.split()}

# What was called otherwise: an old name says the one that the field has.
_FORMER = {
    "applied": "apply",
    "balanced": "balance",
    "empirical": "etfe",
    "filtered": "idfilt",
    "joined": "concatenate",
    "merged": "merge",
    "normalised": "normalize",
    "reduced": "reduce",
    "resampled": "d2d",
    "resampled_covariance": "resample_covariance",
    "resampled_system": "resample_system",
    "response": "frequency_response",
    "sampled": "c2d",
    "scaled": "scale",
    "smoothed": "smooth",
    "stabilise": "stabilize",
    "transformed": "fft",
    "unsampled": "d2c",
}

__all__ = [
    "Data",
    "DelayedModel",
    "FrequencyData",
    "IdentificationWarning",
    "Innovations",
    "Polynomials",
    "RecursiveArx",
    "add_poles",
    "aic",
    "aicc",
    "apply",
    "ar",
    "ararx",
    "arma",
    "arma_ssa",
    "armax",
    "arx",
    "balance",
    "between",
    "between_hz",
    "bic",
    "bj",
    "c2d",
    "channels",
    "chirp",
    "coherence",
    "compare",
    "concatenate",
    "correlation",
    "crest_factor",
    "criteria",
    "d2c",
    "d2d",
    "delay",
    "detrend",
    "driving_noise",
    "era",
    "era_of_data",
    "error_system",
    "estimate_x0",
    "etfe",
    "example_data",
    "experiments",
    "fft",
    "fill_gaps",
    "fit_basis",
    "fit_basis_response",
    "fit_percent",
    "forecast",
    "fpe",
    "frequency_axis",
    "frequency_response",
    "frequency_subspace",
    "frequency_weighted",
    "from_response",
    "hammerstein_wiener",
    "iddata",
    "identify",
    "idfilt",
    "impulse_response",
    "impulseest",
    "independence",
    "innovation_form",
    "innovations",
    "kautz",
    "laguerre",
    "leadlag",
    "least_squares",
    "linear_chirp",
    "low_crest",
    "lpv_arx",
    "lpv_pem",
    "merge",
    "minimum_phase",
    "model_spectrum",
    "mse",
    "multisine",
    "noise_spectrum",
    "nonlinear_pem",
    "normalize",
    "nrmse",
    "oe",
    "okid",
    "orthonormal",
    "parameters_of",
    "pbsid",
    "pem",
    "plr",
    "pole",
    "pole_covariance",
    "pole_spread",
    "possible_models",
    "power_spectrum",
    "prbs",
    "predict",
    "prediction_error",
    "predictor_data",
    "predictor_system",
    "prefilter",
    "ramp_in",
    "ramp_out",
    "rational",
    "rational_matrix",
    "reduce",
    "regressors",
    "resample",
    "resample_covariance",
    "resample_system",
    "residuals",
    "response_covariance",
    "response_spread",
    "rms",
    "robust",
    "runs",
    "sampled_cost",
    "scale",
    "scan",
    "similarity_transform",
    "simulate",
    "smooth",
    "srivc",
    "sse",
    "stabilize",
    "stack",
    "state_filter",
    "state_space",
    "step",
    "step_response",
    "steps",
    "structured_pem",
    "subspaceid",
    "summary",
    "table",
    "tfest",
    "total_least_squares",
    "trend",
    "two_levels",
    "varx",
    "weighted_total_least_squares",
    "whiteness",
    "zero_spread",
]


# What other toolboxes call by names that this package does not have.
_ELSEWHERE = {
    "advice": "the warnings of a model's `summary()`",
    "arxstruc": "`scan(data, na, nb, delay)`",
    "delayest": "`delay(data)`",
    "getcov": "a model's `covariance` and `deviations()`",
    "getpvec": "a model's `values` and `deviations()`",
    "idfrd": "`frequency_response(model, w)` and python-control's FRD",
    "idpoly": "`Polynomials`",
    "idss": "`Innovations`",
    "impulse": "`hoopd.plots.impulse(model)`",
    "misdata": "`fill_gaps(data).data`, or `smooth(model, data)` by a model",
    "n4sid": "`subspaceid(data, order)`",
    "nlhw": "`hammerstein_wiener`",
    "nlarx": "`nonlinear_pem` of a model that you write",
    "present": "what `print(model)` says",
    "procest": "`srivc(data, poles, zeros)`",
    "recursiveARX": "`RecursiveArx`",
    "selstruc": "`scan(...).best(criterion)`",
    "sim": "`simulate(model, data)`",
    "spa": "`tfest(data)`, by the name of ControlSystemIdentification.jl",
    "ssest": "`subspaceid(data, order)`, refined by `pem(data, order)`",
    "ssregest": "`subspaceid(data, order)`",
}


def __getattr__(name: str) -> Any:
    if name in _FORMER:
        raise AttributeError(f"{__name__}.{name} is called {__name__}.{_FORMER[name]} now")
    if name in _ELSEWHERE:
        raise AttributeError(f"{__name__} has no {name}: it is {_ELSEWHERE[name]} here")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
