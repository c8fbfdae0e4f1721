"""Does a model foretell the newest seconds better than the one that acts? The daemon's own filter on both.

    gain of a sample = (e^2 - e'^2) / 2 nats

with e the innovation over what the filter on the acting model expects, e' the same of the other one. Both have the same
noise levels, so that what their logarithms of the variances differ by is left out. A filter's process noise is
wider than the device's: the gain is told too small rather than too large. Seconds are summed up on their own, because
what lasts makes neighbouring samples alike; a gain is clear when it is of some nats and two standard errors of its
seconds' scatter.

Rules of this file: a recording and two files in, numbers out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hoopd.core.drift import MOST, SETTLE_S
from hoopd.core.records import CameraSample, DriverSample
from hoopd.files.controller import load_controller, settings_of
from hoopd.plants.hoop.loop.closed_loop import WIRE_S
from hoopd.plants.hoop.loop.writeback import estimator_with
from hoopd.plants.model_file import effects_of, load_model
from hoopd.recording.recording import Recording

Array = NDArray[np.float64]

LEAST_NATS, LEAST_ERRORS = 3.0, 2.0
BLOCK_S = 1.0
LEAST_BLOCKS = 5


@dataclass(frozen=True)
class FilterEvidence:
    """Of one model over another: nats in all, standard errors that this is from none, seconds that were looked at, and
    which share it is of all that the acting one's filter is surprised by (1/2 of the sum of e^2)."""

    nats: float = 0.0
    errors: float = 0.0
    seconds: float = 0.0
    share: float = 0.0

    @property
    def pace(self) -> float:
        """Nats a second."""
        return self.nats / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def is_clear(self) -> bool:
        """Whether the other model is better on data that nobody fitted."""
        return self.nats >= LEAST_NATS and self.errors >= LEAST_ERRORS


def filter_evidence(recording: Recording, acting: Path, other: Path) -> FilterEvidence:
    """What a version's model gains over the acting one's; each a folder with controller.yaml and model.yaml.

    Parameters
    ----------
    recording : Recording
        Of the hoop, by the daemon: what neither model was fitted to.
    acting, other : Path
        Folders of versions.

    Returns
    -------
    FilterEvidence
        Nats that `other` gains.
    """
    surprises = squared_surprises(recording, acting) / 2.0
    gains = surprises - squared_surprises(recording, other) / 2.0
    counted = recording.t - recording.t[0] >= SETTLE_S
    blocks = ((recording.t - recording.t[0]) / BLOCK_S).astype(int)
    sums = np.array([np.nansum(gains[counted & (blocks == one)]) for one in np.unique(blocks[counted])])
    if len(sums) < LEAST_BLOCKS:
        return FilterEvidence(seconds=len(sums) * BLOCK_S)
    scatter = float(sums.std(ddof=1) / np.sqrt(len(sums)))
    mean = float(sums.mean())
    errors = mean / scatter if scatter > 0.0 else 0.0
    nats, all_of_it = float(sums.sum()), float(np.nansum(surprises[counted]))
    return FilterEvidence(nats, errors, len(sums) * BLOCK_S, nats / all_of_it if all_of_it > 0.0 else 0.0)


def squared_surprises(recording: Recording, version: Path) -> Array:
    """(n,) sums over the sensors of squared innovations over what the filter expects, each at most (5 sigma)^2."""
    file = load_controller(version / "controller.yaml")
    estimator = estimator_with(effects_of(load_model(version / "model.yaml")), settings_of(file))
    found, before, applied = np.zeros(len(recording)), 0.0, float(recording.t[0])
    for row, (t, u) in enumerate(zip(recording.t.tolist(), recording.column("u").tolist(), strict=True)):
        estimate = estimator.update(t, before, applied, _driver(recording, row), _camera(recording, row))
        surprise = np.clip(np.array(estimate.surprise), -MOST, MOST)
        found[row] = float(np.nansum(surprise**2))
        before, applied = (u if np.isfinite(u) else 0.0), t + WIRE_S
    return found


def _driver(recording: Recording, row: int) -> DriverSample | None:
    angle, speed = recording.channels["theta"], recording.channels["dtheta"]
    values = float(angle.t[row]), float(angle.values[row]), float(speed.values[row])
    if not all(map(np.isfinite, values)):
        return None
    return DriverSample(values[0], row % 256, 1, 0, values[1], values[2], 0.0, 0)


def _camera(recording: Recording, row: int) -> CameraSample | None:
    ball = recording.channels["psi"]
    taken, angle = float(ball.t[row]), float(ball.values[row])
    if not (np.isfinite(taken) and np.isfinite(angle)):
        return None
    return CameraSample(row, taken, float(recording.t[row]), angle, 1.0, 0.0, 0.0)
