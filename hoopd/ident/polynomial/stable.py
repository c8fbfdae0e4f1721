"""Roots of polynomials in q^-1 and their reflection into the unit circle.

Rules of this file: the leading coefficient is one and stays one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# A root this near the circle rings for a hundred thousand samples; farther out no filter starts from rest.
EDGE = 1.0 - 1e-5


def radius(polynomial: Array) -> float:
    """Largest magnitude of a root; zero for a constant."""
    if len(polynomial) == 1:
        return 0.0
    if len(polynomial) == 2:
        return abs(float(polynomial[1]))
    if len(polynomial) == 3:
        return _radius_of_two(float(polynomial[1]), float(polynomial[2]))
    return float(np.abs(np.roots(polynomial)).max(initial=0.0))


def _radius_of_two(p: float, q: float) -> float:
    """Of z^2 + p z + q."""
    inner = 0.25 * p * p - q
    return float(np.sqrt(q)) if inner < 0.0 else 0.5 * abs(p) + float(np.sqrt(inner))


def reflected(polynomial: Array, edge: float = EDGE) -> Array:
    """The polynomial with its roots beyond `edge` mirrored at the unit circle, at most `edge` from zero.

    Mirroring a root of C leaves the spectrum of the noise as it is, up to a factor.
    """
    if radius(polynomial) <= edge:
        return polynomial
    roots = np.roots(polynomial)
    size = np.maximum(np.abs(roots), 1e-300)
    inside = np.where(size > 1.0, 1.0 / size, size)
    found = np.real(np.poly(roots / size * np.minimum(inside, edge)))
    return np.concatenate([found, np.zeros(len(polynomial) - len(found))])
