"""How fast a plant moves away by itself: an upright pendulum, a ball in a magnet's field.

What such a plant is simulated for has to be shorter than it takes to forget where it began: over many times of its
growth every model is as wrong as its start, and the one that simulates best is one that does not fall.

Rules of this file: numbers of a declaration in, numbers out; a plant is looked at where all its states and inputs are
zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from hoopd.plants.declaration import Plant
from hoopd.plants.likelihood.composites import composite_of, key_of
from hoopd.plants.scales import motion_scale

# Windows in which a model is simulated, of a plant whose motion is as fast as the hoop's.
WINDOW_S = 2.0
# Times of its growth for which a plant that moves away is simulated.
E_FOLDS = 3.0
# A plant that moves away more slowly than in so many windows does not.
SLOW = 10.0


def growth(plant: Plant) -> float:
    """Of the fastest motion that grows by itself, 1/s; 0 where none does.

    Examples
    --------
    >>> from hoopd.plants.growth import growth
    >>> from hoopd.plants.registry import plant_named
    >>> growth(plant_named("pendulum"))
    0.0
    """
    key = key_of(plant)
    if key not in _known:
        _known[key] = _growth(plant)
    return _known[key]


def window_scale(plant: Plant) -> float:
    """Lengths of windows over those that the constants are written for: times of the motion, and no more than a few of
    its growth."""
    usual, fastest = motion_scale(plant), growth(plant)
    return usual if fastest == 0.0 else min(usual, E_FOLDS / fastest / WINDOW_S)


def window_of(plants: Sequence[Plant]) -> float:
    """Seconds of a window of simulation: that of the fastest of several plants."""
    return WINDOW_S * min(map(window_scale, plants))


def growth_sentence(plants: Sequence[Plant]) -> str:
    """That a plant moves away by itself, and what follows; empty where none does."""
    fastest = max(map(growth, plants), default=0.0)
    if fastest == 0.0:
        return ""
    return (
        f"left alone the plant moves away, e times as far every {1.0 / fastest:.2g} s: windows of simulation last "
        f"{window_of(plants):.2g} s, and one run over a whole recording says little of a model."
    )


def _growth(plant: Plant) -> float:
    found = composite_of(plant, ())
    x, u = ca.SX.sym("x", found.nx), ca.SX.zeros(found.nu)
    rates = ca.densify(found.rate_expression(x, u, 0.0, found.values))
    here = ca.Function("here", [x], [ca.jacobian(rates, x)])(np.zeros(found.nx)).full()
    if not np.isfinite(here).all():
        return 0.0  # no place at which it could be
    fastest = float(np.max(np.linalg.eigvals(here).real, initial=0.0))
    return fastest if fastest * SLOW * WINDOW_S * motion_scale(plant) > 1.0 else 0.0


_known: dict[int, float] = {}
