"""An estimated model with what its data leave open, as whoever designs on it wants it: other models that may be true.

The coefficients lie within the ellipsoid (x - xhat)' P^-1 (x - xhat) < chi-square with a probability that is chosen;
models on its surface, at random and along its longest axes of response, are those that a design has to stand.

Rules of this file: by linearisation, as everything that a covariance says; the same seed gives the same models.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from hoopd.ident.confidence import coefficients_of
from hoopd.ident.models import Innovations

Array = NDArray[np.float64]

# Directions of the coefficients in standard deviations, each of its own, whose variance is below this share of the
# largest are rounding, such as changes of basis.
NOTHING = 1e-12


def possible_models(model: Any, count: int = 100, *, level: float = 0.95, seed: int = 0) -> list[Innovations]:
    """Give models on the surface of the ellipsoid that holds the true one with a probability.

    Both ends of every axis of the ellipsoid come first, then points at random.

    Parameters
    ----------
    model : any model
        A result of this package with a covariance.
    count : int
        Models; at least as many as the ellipsoid has ends are wanted to see all of its axes.
    level : float
        Probability.
    seed : int
        Of the points at random.

    Returns
    -------
    list of Innovations
        The estimate itself first, then `count` others.

    Raises
    ------
    ValueError
        A model without a covariance, or with one that is no number.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import arx, iddata, possible_models
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0], [1.0, -0.8], 0.1 * e)
    >>> gains = [one.system.dcgain() for one in possible_models(arx(iddata(y, u, 0.1), 1, 1))]
    >>> bool(min(gains) < 10.0 < max(gains)), len(gains)
    (True, 101)
    """
    known = coefficients_of(model)
    if known is None:
        raise ValueError("the model has no covariance: nothing tells how far off it may be")
    if not np.isfinite(known.covariance).all():
        raise ValueError("the model's covariance is no finite number: its data do not tell every coefficient")
    axes = _axes(known.covariance)
    others = (known.values + axes @ point for point in surface(axes.shape[1], count, level, seed))
    return [known.made(known.values), *(known.made(x) for x in others)]


def matrix_spread(model: Any) -> Array:
    """How far the matrices of a model move along each axis of its ellipsoid, by one standard deviation.

    Parameters
    ----------
    model : any model
        A result of this package; one without a covariance has no rows.

    Returns
    -------
    ndarray, shape (axes, size of a, b, c, d and k)
        Each row is a, b, c, d, k row by row, of the state space that the model's `state_space` is in.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.signal import lfilter
    >>> from hoopd.ident import arx, iddata
    >>> from hoopd.ident.uncertain import matrix_spread
    >>> u, e = np.random.default_rng(0).standard_normal((2, 1000))
    >>> y = lfilter([0.0, 2.0], [1.0, -0.8], u) + lfilter([1.0], [1.0, -0.8], 0.1 * e)
    >>> matrix_spread(arx(iddata(y, u, 0.1), 1, 1)).shape
    (2, 5)
    """
    known = coefficients_of(model)
    if known is None:
        return np.empty((0, 0))
    here = _flat(known.made(known.values))
    return np.array([_flat(known.made(known.values + axis)) - here for axis in _axes(known.covariance).T])


def surface(axes: int, count: int, level: float, seed: int) -> Iterator[Array]:
    """Give points (axes,) in standard deviations on the ellipsoid that holds the truth with a probability: both ends of
    every axis first, the longest first, then at random."""
    reach = np.sqrt(stats.chi2.ppf(level, axes))
    rng = np.random.default_rng(seed)
    ends = [sign * one for one in np.eye(axes)[::-1] for sign in (1.0, -1.0)]
    for i in range(count):
        point = ends[i] if i < len(ends) else rng.standard_normal(axes)
        yield reach * point / np.linalg.norm(point)


def _axes(covariance: Array) -> Array:
    """(m, axes) half axes of one standard deviation, the longest in standard deviations of the coefficients last.

    Coefficients have units of their own: the axes are those of the correlations, R = V diag(v) V', scaled back.
    """
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    free = sd > 0.0
    found = np.zeros((len(sd), int(free.sum())))
    variances, axes = np.linalg.eigh(covariance[np.ix_(free, free)] / np.outer(sd[free], sd[free]))
    found[free] = sd[free, None] * axes * np.sqrt(np.maximum(variances, 0.0))
    return found[:, variances > NOTHING * variances.max(initial=0.0)]


def _flat(model: Innovations) -> Array:
    return np.concatenate([np.ravel(one) for one in (model.a, model.b, model.c, model.d, model.k)])
