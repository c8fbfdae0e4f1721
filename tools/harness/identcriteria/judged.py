"""What criteria share: figures against bounds, responses of polynomials in q^-1."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import wraps

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.doubts import IdentificationWarning

Array = NDArray[np.float64]
Figures = dict[str, float | bool]
Criterion = Callable[[int], Figures]

OMEGA = np.logspace(-3, np.log10(np.pi), 30)


def quiet(function: Criterion) -> Criterion:
    """Without the warnings that belong to criteria on bad data or methods."""

    @wraps(function)
    def wrapped(seed: int) -> Figures:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IdentificationWarning)
            return function(seed)

    return wrapped


def response(numerator: Array, denominator: Array, omega: Array = OMEGA) -> NDArray[np.complex128]:
    """Of polynomials in q^-1."""
    z = np.exp(-1j * omega)
    return np.asarray(np.polyval(numerator[::-1], z) / np.polyval(denominator[::-1], z))


def frt(model: tuple[Array, Array], true: tuple[Array, Array]) -> float:
    """Largest difference of log10 squared gain."""
    gains = [np.log10(np.abs(response(np.asarray(n), np.asarray(d))) ** 2) for n, d in (model, true)]
    return float(np.abs(gains[0] - gains[1]).max())


def passed(figures: dict[str, float], **bounds: float) -> Figures:
    """The figures, and whether each is below its bound."""
    found: Figures = {name: float(value) for name, value in figures.items()}
    found["passed"] = all(figures[name] < bound for name, bound in bounds.items())
    return found
