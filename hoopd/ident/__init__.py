"""Identification of linear and nonlinear models: `from hoopd.ident import arx, subspaceid, compare`.

Names are looked up when they are used: who asks for a test signal does not load the rest. Type checkers and editors
read the imports below, which run for them alone; a test holds that both say the same. Fits of a plant's own equations
are in `hoopd.plants`, figures of models in `hoopd.plots`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hoopd.ident.other_names import ELSEWHERE, FORMER

if TYPE_CHECKING:
    from hoopd.ident.bases import (
        add_poles as add_poles,
        kautz as kautz,
        laguerre as laguerre,
        leadlag as leadlag,
        orthonormal as orthonormal,
        pole as pole,
    )
    from hoopd.ident.basis_fit import fit_basis as fit_basis
    from hoopd.ident.conditioning import (
        apply as apply,
        concatenate as concatenate,
        merge as merge,
        normalize as normalize,
        predictor_data as predictor_data,
        ramp_in as ramp_in,
        ramp_out as ramp_out,
        scale as scale,
    )
    from hoopd.ident.confidence import (
        pole_spread as pole_spread,
        response_spread as response_spread,
        zero_spread as zero_spread,
    )
    from hoopd.ident.continuous_transfer import srivc as srivc
    from hoopd.ident.data import Data as Data, experiments as experiments, iddata as iddata, runs as runs
    from hoopd.ident.delayed_model import DelayedModel as DelayedModel
    from hoopd.ident.doubts import IdentificationWarning as IdentificationWarning
    from hoopd.ident.empirical_response import etfe as etfe
    from hoopd.ident.excitation import (
        linear_chirp as linear_chirp,
        low_crest as low_crest,
        step as step,
        two_levels as two_levels,
    )
    from hoopd.ident.filtering import (
        idfilt as idfilt,
        prefilter as prefilter,
        resample as resample,
        resample_covariance as resample_covariance,
        resample_system as resample_system,
    )
    from hoopd.ident.forecasting import forecast as forecast
    from hoopd.ident.frequencydata import (
        FrequencyData as FrequencyData,
        between as between,
        between_hz as between_hz,
        fft as fft,
        frequency_axis as frequency_axis,
        frequency_response as frequency_response,
    )
    from hoopd.ident.gaps import fill_gaps as fill_gaps
    from hoopd.ident.impulse import impulseest as impulseest
    from hoopd.ident.information_criteria import (
        aic as aic,
        aicc as aicc,
        bic as bic,
        criteria as criteria,
        fpe as fpe,
        parameters_of as parameters_of,
    )
    from hoopd.ident.measures import fit_percent as fit_percent, mse as mse, nrmse as nrmse, rms as rms, sse as sse
    from hoopd.ident.model_comparison import compare as compare, table as table
    from hoopd.ident.model_forms import innovation_form as innovation_form
    from hoopd.ident.models import (
        Innovations as Innovations,
        Polynomials as Polynomials,
        innovations as innovations,
        state_space as state_space,
    )
    from hoopd.ident.polynomial.ar import ar as ar, arma as arma, arma_ssa as arma_ssa, driving_noise as driving_noise
    from hoopd.ident.polynomial.ararx import ararx as ararx
    from hoopd.ident.polynomial.arx import arx as arx, varx as varx
    from hoopd.ident.polynomial.delay import delay as delay
    from hoopd.ident.polynomial.estimators import (
        frequency_weighted as frequency_weighted,
        least_squares as least_squares,
        robust as robust,
        total_least_squares as total_least_squares,
        weighted_total_least_squares as weighted_total_least_squares,
    )
    from hoopd.ident.polynomial.lpv import lpv_arx as lpv_arx
    from hoopd.ident.polynomial.orders import scan as scan
    from hoopd.ident.polynomial.pem import armax as armax, bj as bj, oe as oe
    from hoopd.ident.polynomial.plr import plr as plr
    from hoopd.ident.polynomial.recursive import RecursiveArx as RecursiveArx
    from hoopd.ident.polynomial.regression import regressors as regressors
    from hoopd.ident.prediction import (
        estimate_x0 as estimate_x0,
        predict as predict,
        prediction_error as prediction_error,
        simulate as simulate,
    )
    from hoopd.ident.predictor_systems import error_system as error_system, predictor_system as predictor_system
    from hoopd.ident.rationalfit import (
        fit_basis_response as fit_basis_response,
        minimum_phase as minimum_phase,
        rational as rational,
    )
    from hoopd.ident.resampling import c2d as c2d, d2c as d2c, d2d as d2d
    from hoopd.ident.residualtests import independence as independence, residuals as residuals, whiteness as whiteness
    from hoopd.ident.result_summary import summary as summary
    from hoopd.ident.signals import (
        chirp as chirp,
        crest_factor as crest_factor,
        multisine as multisine,
        prbs as prbs,
        steps as steps,
    )
    from hoopd.ident.simulated_example import example_data as example_data
    from hoopd.ident.smoothing import smooth as smooth, state_filter as state_filter
    from hoopd.ident.spectral import (
        coherence as coherence,
        correlation as correlation,
        power_spectrum as power_spectrum,
        tfest as tfest,
    )
    from hoopd.ident.spectrogram import model_spectrum as model_spectrum, noise_spectrum as noise_spectrum
    from hoopd.ident.stacked_models import stack as stack
    from hoopd.ident.statespace.era import era as era, era_of_data as era_of_data
    from hoopd.ident.statespace.frequencysubspace import (
        frequency_subspace as frequency_subspace,
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
        channels as channels,
        reduce as reduce,
        similarity_transform as similarity_transform,
    )
    from hoopd.ident.statespace.stabilise import stabilize as stabilize
    from hoopd.ident.statespace.structured import structured_pem as structured_pem
    from hoopd.ident.statespace.subspace import subspaceid as subspaceid
    from hoopd.ident.statespace.uncertainty import (
        pole_covariance as pole_covariance,
        response_covariance as response_covariance,
    )
    from hoopd.ident.step_responses import impulse_response as impulse_response, step_response as step_response
    from hoopd.ident.structure_search import identify as identify
    from hoopd.ident.trends import detrend as detrend, trend as trend
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


__all__ = [*sorted(_MODULES)]  # noqa: PLE0604 - names in one place


def __getattr__(name: str) -> Any:
    if name in FORMER:
        raise AttributeError(f"{__name__}.{name} is called {__name__}.{FORMER[name]} now")
    if name in ELSEWHERE:
        raise AttributeError(f"{__name__} has no {name}: it is {ELSEWHERE[name]} here")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
