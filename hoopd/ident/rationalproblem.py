"""How far a rational function lies from a measured response, by the weighted logarithm.

Rules of this file: one input and output; w in rad/s; polynomials run from the highest power.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import control as ct
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.ident.estimation_report import EstimationReport
from hoopd.ident.identified_model import IdentifiedModel

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Weight = Literal["log", "equal"] | ArrayLike


@dataclass(frozen=True, repr=False)
class RationalFit(IdentifiedModel):
    """The system, log(system/data) (nw,) nepers + j rad at w (nw,) rad/s, and the weighted root mean square of it."""

    system: ct.TransferFunction | ct.StateSpace
    w: Array
    error: Complex
    rms: float
    report: EstimationReport | None = field(default=None, compare=False)


class RationalProblem(NamedTuple):
    """`data` l at w, s = jw/unit, and the square roots of the weights."""

    w: Array
    data: Complex
    s: Complex
    unit: float
    root: Array

    @classmethod
    def of(cls, response: ct.FRD, weight: Weight) -> RationalProblem:
        """Of the positive frequencies of a response; ValueError where it is zero or not finite."""
        if response.ninputs != 1 or response.noutputs != 1:
            raise ValueError("a rational function is fitted to one input and output: take one entry of the response")
        axis, kept = np.asarray(response.omega, float), np.asarray(response.omega) > 0.0
        w, values = axis[kept], np.asarray(response.frdata[0, 0], complex)[kept]
        if not len(w) or not np.isfinite(values).all() or (values == 0.0).any():
            raise ValueError("the response must be finite and nowhere zero: leave those frequencies out")
        shares = _shares(w, weight, kept)
        unit = float(np.exp(np.mean(np.log(w[[0, -1]]))))
        return cls(w, values, 1j * w / unit, unit, np.sqrt(shares / np.sum(shares)))

    def misses(self, said: Complex, phase: bool) -> Array:
        """Weighted log(said/data); `said` (nw,)."""
        return self.parts(np.log(said / self.data), phase)

    def rms(self, b: Array, a: Array, phase: bool) -> float:
        """Of polynomials in s/unit."""
        return float(np.linalg.norm(self.misses(np.polyval(b, self.s) / np.polyval(a, self.s), phase)))

    def parts(self, values: Complex, phase: bool) -> Array:
        """Weighted real parts, and the imaginary ones under them when the phase counts."""
        root = self.root if values.ndim == 1 else self.root[:, None]
        weighted = root * values
        return np.concatenate([weighted.real, weighted.imag]) if phase else np.asarray(weighted.real)

    def answered(self, b: Array, a: Array, phase: bool) -> RationalFit:
        """The fit of polynomials in s."""
        system = ct.tf(b, a)
        return self.answer(system, np.polyval(b, 1j * self.w) / np.polyval(a, 1j * self.w), phase)

    def answer(self, system: ct.TransferFunction | ct.StateSpace, said: Complex, phase: bool) -> RationalFit:
        """The fit of a system whose response is `said`."""
        rms = float(np.linalg.norm(self.misses(said, phase)))
        return RationalFit(system, self.w, np.log(said / self.data), rms)


def _shares(w: Array, weight: Weight, kept: NDArray[np.bool_]) -> Array:
    if isinstance(weight, str):
        if weight not in {"log", "equal"}:
            raise ValueError(f'the weight is "log", "equal" or an array, not {weight!r}')
        return np.gradient(np.log(w)) if weight == "log" and len(w) > 1 else np.ones(len(w))
    given = np.asarray(weight, dtype=float).reshape(-1)
    if len(given) != len(kept) or not (given >= 0.0).all() or not given.any():
        raise ValueError(f"{len(kept)} weights wanted, none negative and not all 0")
    return np.asarray(given[kept])


def solved(columns: Complex, target: Complex) -> Array:
    """Real least squares of complex rows, columns brought to one length."""
    rows = np.vstack([columns.real, columns.imag])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0.0] = 1.0
    x = np.linalg.lstsq(rows / scale, np.concatenate([target.real, target.imag]), rcond=None)[0]
    return np.asarray(x / scale)
