"""Frequency responses of whatever is a model, as matrices of curves with their bands.

Rules of this file: responses come from `hoopd.ident` as they are; nothing is drawn here.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hoopd.ident import frequency_response, tfest
from hoopd.ident.confidence import response_spread
from hoopd.ident.data import Data, experiments
from hoopd.ident.delayed_model import DelayedModel
from hoopd.ident.identified_model import FreeModel
from hoopd.ident.model_forms import innovation_form, is_response
from hoopd.ident.models import Innovations
from hoopd.ident.spectral import FrequencyEstimate
from hoopd.plots.identification import Response

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Lowest frequency that is drawn, of half of the sampling frequency; of a continuous model, decades about its poles.
LOWEST_SHARE, DECADES = 1e-3, 2.0
POINTS = 300
# Coherence below which the data's own response tells nothing.
COHERENT = 0.1


class ResponseMatrix:
    """Responses h (ny, nu, nw) at w with the standard errors of relative gain and phase, where they are known."""

    def __init__(self, w: Array, h: Complex, gain: Array | None = None, phase: Array | None = None) -> None:
        self.w, self.h, self.gain, self.phase = w, h, gain, phase

    def entry(self, name: str, i: int, j: int, colour: str = "") -> Response:
        """The curve of one output and input."""
        gain = None if self.gain is None else self.gain[i, j]
        phase = None if self.phase is None else self.phase[i, j]
        return Response(name, self.w, self.h[i, j], gain, phase, colour)


def matrix_of(model: Any, w: Array) -> ResponseMatrix:
    """Of a model, with its standard errors; of an estimate or a response at the frequencies that it has."""
    if isinstance(model, FrequencyEstimate):
        return _estimated(model, w)
    if is_response(model):
        kept = np.asarray(model.omega) > 0.0
        return ResponseMatrix(np.asarray(model.omega)[kept], np.asarray(model.frdata)[:, :, kept])
    if isinstance(model, DelayedModel):
        return ResponseMatrix(w, np.moveaxis(model.response(w), 0, 2))
    if isinstance(model, FreeModel):
        raise TypeError(f"a {type(model).__name__} is nonlinear: it has no frequency response")
    spread = response_spread(model, w)
    if spread is None:
        own = model if not hasattr(model, "system") else model.system
        return ResponseMatrix(w, np.asarray(frequency_response(own, w).frdata))
    return ResponseMatrix(
        w, np.moveaxis(spread.h, 0, 2), np.moveaxis(spread.gain, 0, 2), np.moveaxis(spread.phase, 0, 2)
    )  # fmt: skip


def _estimated(found: FrequencyEstimate, w: Array) -> ResponseMatrix:
    """An estimate at its own frequencies within those that are drawn, gaps where it tells nothing."""
    kept = (found.w >= w[0]) & (found.w <= w[-1]) & (found.w > 0.0)
    h = np.where(found.coherence[kept].T[:, None, :] > COHERENT, found.system.frdata[:, :, kept], np.nan)
    relative = found.deviation[:, :, kept] / np.maximum(np.abs(h), np.finfo(float).tiny)
    return ResponseMatrix(found.w[kept], h, relative, relative)


def measured_matrix(data: Data | Sequence[Data], w: Array) -> ResponseMatrix:
    """The data's own response, no model in it."""
    found = _estimated(tfest(data), w)
    return ResponseMatrix(found.w, found.h)


def without_form(model: Any) -> bool:
    """Whether it is nonlinear, or known at frequencies alone."""
    return is_response(model) or (isinstance(model, FreeModel) and not isinstance(model, DelayedModel))


def _linear(model: Any) -> Innovations:
    return model.undelayed if isinstance(model, DelayedModel) else innovation_form(model)


def response_axis(models: Sequence[Any], data: Data | Sequence[Data] | None) -> Array:
    """Frequencies (nw,) in rad/s at which all of them are looked at."""
    steps = [] if data is None else [experiments(data)[0].dt]
    free = [one for one in models if without_form(one)]
    forms = [_linear(one) for one in models if not without_form(one)]
    steps += [one.dt for one in forms if one.dt > 0.0]
    if steps:
        return np.asarray(np.geomspace(LOWEST_SHARE, 1.0, POINTS) * np.pi / min(steps), dtype=float)
    if free:
        given = np.concatenate([np.asarray(getattr(one, "system", one).omega) for one in free])
        return np.asarray(np.geomspace(given[given > 0.0].min(), given.max(), POINTS), dtype=float)
    sizes = np.abs(np.concatenate([np.linalg.eigvals(one.a) for one in forms]))
    sizes = sizes[sizes > 0.0] if (sizes > 0.0).any() else np.ones(1)
    return np.asarray(
        np.geomspace(sizes.min() / 10.0**DECADES, sizes.max() * 10.0**DECADES, POINTS), dtype=float
    )  # fmt: skip
