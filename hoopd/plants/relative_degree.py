"""How often an input is integrated on its way to what a channel reads: the relative degree of every channel.

Rules of this file: which quantity depends on which, read off the equations; no numbers.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.plant_with_effects import Composite


def relative_degrees(plant: Plant) -> dict[str, int | None]:
    """Give the relative degree of each channel of a plant.

    Parameters
    ----------
    plant : Plant
        A declaration.

    Returns
    -------
    dict of str to int or None
        By channel; None where no input moves it.

    Examples
    --------
    >>> from hoopd.plants.registry import plant_named
    >>> from hoopd.plants.relative_degree import relative_degrees
    >>> relative_degrees(plant_named("tanks")), relative_degrees(plant_named("drives"))
    ({'h1': 1, 'h2': 2}, {'speed': 1, 'tension': 2})
    >>> relative_degrees(plant_named("pendulum"))
    {'alpha': None}
    """
    composite = Composite(plant)
    x, u = ca.SX.sym("x", len(plant.states)), ca.SX.sym("u", max(1, len(plant.inputs)))
    p = {name: ca.SX.sym(name) for name in plant.values}
    rates = composite.rate_expression(x, u, ca.SX(0), p)
    by_state = _depends(rates, x)
    order = np.where(_depends(rates, u).any(axis=1) & bool(plant.inputs), 1.0, np.inf)
    for _ in plant.states:  # as long as a way through all of them
        order = np.minimum(order, 1.0 + np.where(by_state, order, np.inf).min(axis=1, initial=np.inf))
    point, found = plant.reading_point(x, p, ca.SX.sym("t")), dict[str, int | None]()
    for name, channel in plant.channels.items():
        read = channel.reading(point) if channel.reading is not None else getattr(point, channel.state)
        least = order[_depends(ca.SX(read), x)[0]].min(initial=np.inf)
        found[name] = int(least) if np.isfinite(least) else None
    return found


def _depends(values: ca.SX, on: ca.SX) -> NDArray[np.bool_]:
    """(values, on) whether one depends on the other."""
    return np.asarray(ca.DM(ca.jacobian(values, on).sparsity(), 1.0).full() != 0.0)
