"""How fast a plant moves away by itself: an upright pendulum, a ball in a magnet's field.

It is looked at where its recordings are, at rest there: a pendulum that hangs all the time moves away from nothing,
whatever its angle is counted from, and a magnet pulls where a current flows.

Rules of this file: a declaration in, a number out.
"""

from __future__ import annotations

from collections.abc import Hashable

import casadi as ca
import numpy as np

from hoopd.plants.declaration import Plant
from hoopd.plants.likelihood.composites import composite_of, key_of


def growth(plant: Plant) -> float:
    """Of the fastest motion that grows by itself.

    Parameters
    ----------
    plant : Plant
        Its `middles` say where it is looked at; what they do not name is zero.

    Returns
    -------
    float
        1/s, the largest real part of the linear plant's poles; 0 where none is positive.

    Examples
    --------
    >>> from hoopd.plants.growth import growth
    >>> from hoopd.plants.registry import plant_named
    >>> growth(plant_named("pendulum"))
    0.0
    """
    key = key_of(plant), tuple(sorted(plant.middles.items()))
    if key not in _known:
        _known[key] = _growth(plant)
    return _known[key]


def _growth(plant: Plant) -> float:
    composite = composite_of(plant, ())
    x = ca.SX.sym("x", composite.nx)
    u = ca.DM([plant.middles.get(one.name, 0.0) for one in plant.inputs])
    place = [plant.middles.get(name, 0.0) for name in composite.plant.states]
    rates = ca.densify(composite.rate_expression(x, ca.SX(u), 0.0, composite.values))
    linear = ca.Function("linear", [x], [ca.jacobian(rates, x)])(place).full()
    if not np.isfinite(linear).all():
        return 0.0  # no place at which it could be
    return float(np.max(np.linalg.eigvals(linear).real, initial=0.0))


_known: dict[Hashable, float] = {}
