"""Denominators A(s) by the numbers that are searched, with derivatives.

Rules of this file: s is scaled so that the band lies around 1; coefficients run from the highest power, the first is 1.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Smallest damping of a stable factor, beside its frequency: where exp(p) would run away to 0.
LEAST = 1e-9


class Denominator(Protocol):
    """A(s) of degree n by n numbers, its leading coefficient 1."""

    start: Array

    def at(self, s: Complex, x: Array) -> tuple[Complex, Complex]:
        """A (nw,) and d log A (nw, n)."""

    def coefficients(self, x: Array) -> Array:
        """(n + 1,) from the highest power."""


class Free:
    """By its coefficients, from the lowest power."""

    def __init__(self, start: Array) -> None:
        self.start = start

    @classmethod
    def of(cls, a: Array) -> Free:
        """Begun at a polynomial."""
        return cls(a[:0:-1].copy())

    def at(self, s: Complex, x: Array) -> tuple[Complex, Complex]:
        powers = powers_of(s, len(x))
        value = powers @ np.append(x, 1.0)
        return value, powers[:, :-1] / value[:, None]

    def coefficients(self, x: Array) -> Array:
        return np.append(1.0, x[::-1])


class Stable:
    """By the logarithms of the coefficients of factors s^2 + e^p s + e^q and s + e^r: stable whatever they are."""

    def __init__(self, start: Array) -> None:
        self.start = start

    @classmethod
    def of(cls, a: Array) -> Stable:
        """Begun at a polynomial, its roots of the right half plane mirrored."""
        roots = np.roots(a)
        roots = np.where(roots.real > 0.0, -roots.conj(), roots)
        pairs, reals = roots[roots.imag > 0.0], np.sort(roots[roots.imag == 0.0].real)
        left = [(-2.0 * one.real, abs(one) ** 2) for one in pairs]
        left += [(-one - other, one * other) for one, other in zip(reals[::2], reals[1::2], strict=False)]
        values = [max(c, LEAST * max(q, 1.0)) for pair in left for c, q in ((pair[0], pair[1] ** 0.5), (pair[1], 1.0))]
        values += [max(-reals[-1], LEAST)] if len(reals) % 2 else []
        return cls(np.log(np.array(values)))

    def at(self, s: Complex, x: Array) -> tuple[Complex, Complex]:
        value, slopes = np.ones(len(s), complex), np.empty((len(s), len(x)), complex)
        for i in range(0, len(x) - 1, 2):
            factor = s**2 + np.exp(x[i]) * s + np.exp(x[i + 1])
            slopes[:, i], slopes[:, i + 1] = np.exp(x[i]) * s / factor, np.exp(x[i + 1]) / factor
            value = value * factor
        if len(x) % 2:
            slopes[:, -1] = np.exp(x[-1]) / (s + np.exp(x[-1]))
            value = value * (s + np.exp(x[-1]))
        return value, slopes

    def coefficients(self, x: Array) -> Array:
        a = np.ones(1)
        for i in range(0, len(x) - 1, 2):
            a = np.convolve(a, [1.0, np.exp(x[i]), np.exp(x[i + 1])])
        return np.convolve(a, [1.0, np.exp(x[-1])]) if len(x) % 2 else a


def powers_of(s: Complex, n: int) -> Complex:
    """1, s .. s^n, (nw, n + 1)."""
    return np.asarray(np.vander(s, n + 1, increasing=True))
