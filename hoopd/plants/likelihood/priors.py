"""What is known of parameters before the data: ranges, wide priors, directions without information.

Rules of this file: names and numbers in, numbers out; no fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, ranges_of
from hoopd.plants.likelihood.recording_parameters import plain
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.scales import LEAST_SIZE, parameter_size

Array = NDArray[np.float64]

# Prior of a base parameter: this many times its nominal size, so that data without information leave it there.
PRIOR_SIZE = 3.0


def ranges(effects: Sequence[Effect], tracks: Sequence[Track]) -> dict[str, tuple[float, float]]:
    """Least and largest value by name; phases go round."""
    base = {name: bound for track in tracks for name, bound in track.stretch.plant.bounds.items()}
    return base | ranges_of(effects)


def prior(
    effects: Sequence[Effect], tracks: Sequence[Track], free: Sequence[str], values: Mapping[str, float]
) -> tuple[Array, Array]:
    """Weights (m,) and distance to the centre (m,): about the declared values as wide as is believed, or wide; of an
    effect its range."""
    weight, centre = np.zeros(len(free)), np.zeros(len(free))
    declared = {name: value for track in tracks for name, value in track.stretch.plant.values.items()}
    widths = {e.key(p.name): p.high - p.low for e in effects for p in e.parameters}
    usual = {name: size for track in tracks for name, size in _usual_sizes(track.stretch.plant).items()}
    believed = {n: share for track in tracks for n, share in track.stretch.plant.beliefs.items()}
    for i, name in enumerate(free):
        middle = declared.get(name, 0.0)
        width = believed.get(name, PRIOR_SIZE) * usual.get(name, LEAST_SIZE)
        if (known := plain(name)) in widths:
            width, middle = widths[known], values[name]
        weight[i], centre[i] = 1.0 / width**2, middle - values[name]
    return weight, centre


def _usual_sizes(plant: Plant) -> dict[str, float]:
    """Of the parameters that a plant leaves free."""
    return {name: parameter_size(plant, name) for name in plant.free}


def leaving(
    free: Sequence[str], values: Mapping[str, float], bounds: Mapping[str, tuple[float, float]], delta: Array
) -> NDArray[np.bool_]:
    """(m,) parameters that are on a bound and whose step points outwards."""
    out = np.zeros(len(delta), dtype=bool)
    for i, name in enumerate(free):
        low, high = bounds.get(plain(name), (-np.inf, np.inf))
        value = values[name]
        out[i] = (value <= low and delta[i] < 0.0) or (value >= high and delta[i] > 0.0)
    return out


def inverse(information: Array) -> Array:
    """Of a symmetric matrix (m, m) of numbers of very different sizes; 0 in directions without information."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    sizes = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(information * sizes, rcond=1e-12, hermitian=True) * sizes)
