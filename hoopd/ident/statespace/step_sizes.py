"""How large a variable is, and the steps of its differences: a capacity of 1e-9 F wants other ones than an angle.

Rules of this file: a variable that is zero, or nearly so, tells nothing of its size; what it does is tried then, with
steps so small that they do next to nothing.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Relative, of differences: the error of central ones is of order STEP^2.
STEP = 1e-5
# A variable that has come this much nearer to zero than its size keeps the steps that it had there.
NEAR = 1e-3
# The first step that is tried, of a variable and of one that is zero, what the next ones are longer by, and the last.
FIRST, OF_ZERO, LONGER, LONGEST = 1e-5, 1e-20, 1e4, 1.0
# A step is felt where it changes this share: four digits of it stand above rounding.
FELT = 1e-11


def difference_steps(z: Array, sizes: Array) -> Array:
    """Steps (m,) of differences at z, in the units of the variables."""
    return np.asarray(STEP * np.maximum(np.abs(z), NEAR * sizes))


def scales(sizes: Array) -> Array:
    """Powers of two (m,) below sizes: a search in variables that are divided by them rounds none of them."""
    return np.asarray(np.exp2(np.floor(np.log2(sizes))))


def variable_sizes(share: Callable[[Array], Array], z: Array, bounds: tuple[Array, Array]) -> Array:
    """Sizes (m,) of variables: each itself, or where that is zero or changes nothing, what would change everything.

    Parameters
    ----------
    share : callable
        Of changed variables (m, sets), giving the share (sets,) of what they make that is another one; what is not
        finite counts as felt.
    z : ndarray, shape (m,)
        The variables, each in a unit of its own.
    bounds : tuple of ndarray, shape (m,)
        Least and largest values; none is tried outside them.

    Returns
    -------
    ndarray, shape (m,)
        In the same units, above zero. Where nothing is felt at all the variable itself, for a zero 1 or what lies
        between its bounds.
    """
    own = np.abs(z)
    between = np.where(bounds[1] > bounds[0], np.minimum(bounds[1] - bounds[0], 1.0), 1.0)
    sizes, steps = np.where(z == 0.0, between, own), np.where(z == 0.0, OF_ZERO, FIRST * own)
    left = np.arange(len(z))
    while True:
        inward = np.where(z + steps <= bounds[1], steps, -steps)
        left = left[(steps <= np.maximum(LONGEST, own))[left] & (z + inward >= bounds[0])[left]]
        if not len(left):
            return sizes
        moved = np.repeat(z[:, None], len(left), axis=1)
        moved[left, np.arange(len(left))] += inward[left]
        with np.errstate(all="ignore"):
            changed = share(moved)
        known = np.isfinite(changed) & (changed >= FELT)
        at, whole = left[known], steps[left[known]] / changed[known]
        # a variable that is felt by a part of itself is no zero, however little it does
        sizes[at] = np.maximum(own[at], np.where(steps[at] < own[at], np.minimum(whole, own[at] / NEAR), whole))
        left = left[changed < FELT]
        steps[left] *= LONGER
