"""A frequency response as a model: simulated through the discrete Fourier transform, from rest.

The response is taken as linear in its real and imaginary part between its frequencies. Below the lowest it goes to a
real value, above the highest it stays, and a warning tells when the inputs have power there.

Rules of this file: a response knows no noise, so a prediction is the simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.data import Data, driving_data
from hoopd.ident.doubts import warn
from hoopd.ident.estimation_report import EstimationReport
from hoopd.ident.identified_model import FreeModel

if TYPE_CHECKING:
    import control as ct

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Share of an input's power outside of the response's frequencies from which it is told.
OUTSIDE = 0.05


@dataclass(frozen=True, repr=False)
class ResponseModel(FreeModel):
    """A python-control FRD that simulates."""

    frequency_response: ct.FRD
    report: EstimationReport | None = None

    @property
    def system(self) -> ct.FRD:
        """The response."""
        return self.frequency_response

    def simulate(self, data: Data | ArrayLike, x0: Any = "estimate", *, seed: int | None = None) -> Array:
        """Outputs (n, ny) from the inputs alone, from rest."""
        if seed is not None:
            raise ValueError("a frequency response does not know the covariance of its noise: there is none to draw")
        if not isinstance(x0, str):
            raise ValueError("a frequency response has no state: it is simulated from rest")
        frd = self.frequency_response
        own = driving_data(data, frd.noutputs, frd.ninputs, float(frd.dt or 0.0) or None)
        if own.nu != frd.ninputs or own.ny != frd.noutputs:
            raise ValueError(
                f"the model has {frd.noutputs} outputs and {frd.ninputs} inputs, the data have {own.ny} and {own.nu}"
            )
        # as many zeros behind, so that the end does not run into the beginning
        size = 2 * own.n
        w = np.asarray(2.0 * np.pi * np.fft.rfftfreq(size, own.dt), dtype=float)
        u = np.fft.rfft(own.u, size, axis=0)
        _judge(frd, w, u)
        y = (_between(frd, w, own.dt).transpose(2, 0, 1) @ u[:, :, None])[:, :, 0]
        return np.asarray(np.fft.irfft(y, size, axis=0)[: own.n])

    def predict(self, data: Data, horizon: float = 1, x0: Any = "estimate") -> Array:
        """The simulation, whatever the horizon: nothing is known of the noise."""
        return self.simulate(data, x0)


def _between(frd: ct.FRD, w: Array, dt: float) -> Complex:
    """(ny, nu, k) at w rad/s."""
    known, h = np.asarray(frd.omega, float), np.asarray(frd.frdata, complex)
    if known[0] > 0.0:
        known, h = np.append(0.0, known), np.concatenate([h[:, :, :1].real, h], axis=2)
    if known[-1] < np.pi / dt:
        known, h = np.append(known, np.pi / dt), np.concatenate([h, h[:, :, -1:]], axis=2)
    flat = h.reshape(-1, len(known))
    found = [np.interp(w, known, row.real) + 1j * np.interp(w, known, row.imag) for row in flat]
    return np.asarray(found, dtype=complex).reshape(*h.shape[:2], len(w))


def _judge(frd: ct.FRD, w: Array, u: Complex) -> None:
    low, high = float(frd.omega[0]), float(frd.omega[-1])
    power = np.abs(u) ** 2
    outside = (w < low) | (w > high)
    share = float(power[outside].sum() / max(power.sum(), np.finfo(float).tiny))
    if share > OUTSIDE:
        warn(
            f"the response is known from {low:.3g} to {high:.3g} rad/s, and {100.0 * share:.0f} % of the inputs' power "
            "lies outside: it is carried on there"
        )
