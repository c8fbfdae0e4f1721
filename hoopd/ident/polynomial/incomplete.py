"""A polynomial model where outputs are missing, or where many short experiments start anywhere.

Rules of this file: C and F stay stable at every step; every experiment has a free start, or rest where that is asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hoopd.ident.data import Data
from hoopd.ident.gaplikelihood import MeasuredStretch, stretch
from hoopd.ident.gapsearch import GapOptimum, GapProblem, likeliest
from hoopd.ident.models import state_space
from hoopd.ident.polynomial.gaussnewton import PolynomialExperiment, stable
from hoopd.ident.polynomial.structure import Structure

Array = NDArray[np.float64]

# More starts than this share of the samples are not estimated beside the rest without a bias of it.
SHORT = 0.01


def wanted(own: Structure, each: Sequence[Data], *, free_start: bool) -> bool:
    """Whether the plain sum of squares would not be the likelihood: noise dynamics and gaps, or many short starts."""
    noisy = own.na + own.nc + own.nd > 0
    count = sum(int(np.isfinite(one.y).sum()) for one in each)
    many = free_start and len(each) > 1 and own.states * len(each) > SHORT * count
    return noisy and (many or not all(one.complete for one in each))


def bridged(each: Sequence[Data]) -> list[PolynomialExperiment]:
    """Experiments whose gaps are bridged by lines; good enough to begin with."""
    return [PolynomialExperiment(one.y[0], one.u) for one in map(_stretch, each)]


def search(own: Structure, each: Sequence[Data], candidates: Sequence[Array], *, free_start: bool) -> GapOptimum:
    """The likeliest coefficients from the likeliest of the candidates."""
    like = each[0]
    states = state_space(own.model(np.zeros(own.size), like)).nx
    problem = GapProblem(
        lambda x: state_space(replace(own.model(x, like), variance=1.0)), [_stretch(one) for one in each], free_start,
        states,
    )  # fmt: skip
    if problem.free <= own.size:
        raise ValueError(
            f"too few samples: {problem.count} outputs for {own.size + problem.count - problem.free} coefficients and "
            "initial states"
        )
    return likeliest(problem, candidates, lambda x: stable(own, x))


def _stretch(one: Data) -> MeasuredStretch:
    return stretch(one.y, one.u)
