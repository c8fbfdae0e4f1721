"""The figures of `hoopd identify`: predictions, residuals, responses and roots with their 95 % regions.

Rules of this file: files out; the mathematics is in `hoopd.ident`, the drawing in `hoopd.plots`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.confidence import Estimated, pole_spread, response_spread, zero_spread, zeros_of
from hoopd.ident.data import Data
from hoopd.ident.frequencydata import frequency_response
from hoopd.ident.models import Innovations
from hoopd.ident.prediction import predict
from hoopd.ident.residualtests import ResidualReport
from hoopd.plots import style
from hoopd.plots.identification import Response, Roots, draw_residuals, draw_responses, draw_roots, draw_said

UNITS = {"theta": "rad", "dtheta": "rad/s", "psi": "rad"}
# Lowest frequency that is drawn, of half of the sampling frequency.
LOWEST_SHARE, POINTS = 1e-3, 600
# Samples ahead of the predictions that are drawn.
AHEAD = 10


def draw(
    model: Innovations, parts: Sequence[Estimated], method: str, shown: Data, how: str, report: ResidualReport,
    figure: Path,
) -> None:  # fmt: skip
    """Predictions into the file that was asked for; residuals, responses and roots beside it."""
    said = {method: predict(model, shown, AHEAD)}
    drawn = {
        "": draw_said(shown, said, f"{AHEAD} samples ahead", title=f"{method}, {how}", units=UNITS),
        "_residuals": draw_residuals(report),
        "_bode": draw_responses(_responses(model, parts), title=f"From the torque, {method}{_known(parts)}"),
        "_roots": draw_roots(_root_sets(model, parts), title=f"Poles and zeros, {method}{_known(parts)}"),
    }
    for ending, one in drawn.items():
        style.save(one, figure.with_name(f"{figure.stem}{ending}{figure.suffix}"))


def _known(parts: Sequence[Estimated]) -> str:
    return ", with 95 % regions" if pole_spread(parts[0]) is not None else ""


def _responses(model: Innovations, parts: Sequence[Estimated]) -> list[Response]:
    """From the torque to each output, over three decades up to half of the sampling frequency."""
    w = np.geomspace(LOWEST_SHARE, 1.0, POINTS) * np.pi / model.dt
    h = frequency_response(model.system, w).frdata
    spreads = [response_spread(one, w) for one in parts]
    out = []
    for i, name in enumerate(model.outputs):
        spread, row = (spreads[0], i) if len(parts) == 1 else (spreads[i], 0)
        sd = () if spread is None else (spread.gain[:, row, 0], spread.phase[:, row, 0])
        out.append(Response(f"{name} ({UNITS[name]} per N m)", w, h[i, 0], *sd))
    return out


def _root_sets(model: Innovations, parts: Sequence[Estimated]) -> list[Roots]:
    """Poles once where all outputs have them in common, zeros by output."""
    none = np.zeros(0, dtype=complex)
    poles = [pole_spread(one) for one in parts]
    out = []
    if len(parts) == 1:
        shared = poles[0]
        own = Roots("poles", poles_of(model), none) if shared is None else Roots(
            "poles", shared.roots, none, shared.covariances
        )  # fmt: skip
        out.append(own)
    for i, name in enumerate(model.outputs):
        part, row = (parts[0], i) if len(parts) == 1 else (parts[i], 0)
        spread, pole = zero_spread(part, row), poles[0 if len(parts) == 1 else i]
        zeros, sizes = (zeros_of(model, i), ()) if spread is None else (spread.roots, spread.covariances)
        if len(parts) == 1 or pole is None:
            out.append(Roots(f"zeros of {name}", none, zeros, (), sizes))
        else:
            out.append(Roots(f"poles and zeros of {name}", pole.roots, zeros, pole.covariances, sizes))
    return out


def poles_of(model: Innovations) -> NDArray[np.complex128]:
    """The slowest first."""
    return np.asarray(sorted(np.linalg.eigvals(model.a), key=lambda z: -abs(z)), dtype=complex)
