"""What only the sizes of disturbances tell of parameters: a scale of states that nobody measures.

Where a channel reads a charge over a capacity, half the capacity with half the charge shows the same, and so do an
inductance and a resistance twice as large. All that changes is how large the disturbances are, which nobody knows, and
which the fit estimates itself. With their levels held the normal equations take them for a measure. Where a direction
of the parameters is told much worse than each of them alone, the changes of the whitened innovations by parameters and
levels (the filter's gains move along)

    g_i = de/dp_i,    d_k = de/dlog(level_k),    G freed of all that D can do

say what is told beside the levels: G'G.

Rules of this file: a fit in, numbers out; nothing is fitted again.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.kalman_filter import Noise, gains

Array = NDArray[np.float64]

# Directions are looked at where one is told by less than this share of what tells each parameter alone; and one is of
# levels where less than half of what seems to tell it is left without them.
WEAK, LEFT = 0.01, 0.5
# Steps of the differences: of the logarithm of a level, and of a parameter in deviations that it would have alone.
LEVEL_STEP, STEP = 0.02, 0.1


def told(found: HypothesisFit) -> Array:
    """What the recordings tell of the free parameters.

    Parameters
    ----------
    found : HypothesisFit
        A fit with its whitened rows.

    Returns
    -------
    Array, shape (m, m)
        The products of its rows; where a direction is told by levels alone, of what is left without them.
    """
    rows = found.stacked()[:, 1:]
    information = rows.T @ rows
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    weakest = _weakest(information, size)
    if weakest >= WEAK:
        return np.asarray(information)
    levels = _of_levels(found)
    changes = np.column_stack([_by(found, i, STEP / size[i]) * size[i] / STEP for i in range(len(size))])
    changes -= levels @ np.linalg.lstsq(levels, changes, rcond=None)[0]
    left = changes.T @ changes
    return np.asarray(left if _weakest(left, size) < LEFT * weakest else information)


def _weakest(information: Array, size: Array) -> float:
    """Of all directions the one that is told worst, over what tells each parameter alone; 1 without any."""
    return float(np.linalg.eigvalsh(information / np.outer(size, size))[0]) if len(size) else 1.0


def _of_levels(found: HypothesisFit) -> Array:
    """(rows, k) changes of the whitened innovations by the logarithm of each level of a disturbance."""
    columns = []
    for recording, noise in found.noise.items():
        for j in range(len(noise.force)):
            up, down = (_innovations(found, {recording: _scaled(noise, j, s)}) for s in (LEVEL_STEP, -LEVEL_STEP))
            columns.append((up - down) / (2.0 * LEVEL_STEP))
    return np.column_stack(columns)


def _scaled(noise: Noise, j: int, by: float) -> Noise:
    force = noise.force.copy()
    force[j] *= np.exp(by)
    return noise._replace(force=force)


def _by(found: HypothesisFit, i: int, step: float) -> Array:
    """(rows,) change of the whitened innovations by a small step of a parameter."""
    name = found.free[i]
    up, down = (_innovations(found, {}, {name: found.values[name] + d}) for d in (step, -step))
    return np.asarray((up - down) / 2.0)


def _innovations(found: HypothesisFit, noise: Mapping[str, Noise], values: Mapping[str, float] | None = None) -> Array:
    """(rows,) with other levels or parameters, along the same reference."""
    parts = []
    for i, track in enumerate(found.tracks):
        columns = found.columns[i] if values is None else track.columns({**found.values, **values}, ())
        gain = gains(columns.model, noise.get(track.stretch.recording, found.noise[track.stretch.recording]))
        parts.append(track.whitened(columns, gain)[:, 0])
    return np.concatenate(parts)
