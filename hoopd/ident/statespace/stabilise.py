"""The nearest way to a stable discrete model: its Schur form with the poles outside moved in.

Rules of this file: poles well inside stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

Array = NDArray[np.float64]


def stabilize(a: Array, margin: float = 0.01) -> Array:
    """Give the matrix nearest to a given one by Schur form whose eigenvalues lie inside the circle of radius 1 -
    margin.

    By the complex Schur form a = z t z*: a pole of modulus 1 < r <= 2 goes to 2 - r, one beyond 2 to 0, and what is
    then still outside that circle to its edge; the angle stays. A real matrix stays real.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        Dynamics.
    margin : float
        Distance of the poles to the unit circle.

    Returns
    -------
    ndarray, shape (n, n)
        Stable dynamics.

    Examples
    --------
    >>> import numpy as np
    >>> from hoopd.ident import stabilize
    >>> stabilize(np.array([[1.2, 1.0], [0.0, 0.5]])).round(6)
    array([[0.8, 1. ],
           [0. , 0.5]])
    """
    return _scaled(a, lambda r: min(_reflected(r), 1.0 - margin) if r > 1.0 - margin else r)


def bounded(a: Array, most: float) -> Array:
    """`a` with every eigenvalue of larger modulus drawn radially to `most`."""
    return _scaled(a, lambda r: min(r, most))


def _reflected(r: float) -> float:
    return r if r <= 1.0 else max(2.0 - r, 0.0)


def _scaled(a: Array, to: Callable[[float], float]) -> Array:
    t, z = linalg.schur(a, output="complex")
    poles = np.diag(t).copy()
    size = np.abs(poles)
    wanted = np.array([to(float(r)) for r in size])
    if np.array_equal(size, wanted):
        return np.array(a, dtype=float)
    np.fill_diagonal(t, poles * wanted / np.maximum(size, 1e-300))
    return np.asarray((z @ t @ z.conj().T).real)
