"""A ball at rest on top of the inner hoop: its regulator behind the daemon's filter, and from where it is held.

A run begins with a ball that hands hold near the top and let go with a push, of which the filter learns by the camera.
The region is an ellipsoid of hoop speed, angle from the top and ball speed, V(x) = x' P x <= level with the P of the
regulator's own cost, as large as simulated runs that begin on it are held.

Rules of this file: the law, runs of the closed loop and what they say; the model comes from `inner_model`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.core.controllers import Log, Measurement
from hoopd.core.estimator import EkfSettings
from hoopd.core.limits import Limiter
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.loop.closed_loop import ClosedLoopRun, FreeBall, Scenario, simulate
from hoopd.plants.hoop.loop.writeback import estimator_with
from hoopd.plants.hoop.maneuver.inner_model import TOP, InnerModel
from hoopd.plants.hoop.maneuver.tracking import TrackingWeights, resting_gains

Array = NDArray[np.float64]

# A hoop that may turn, a ball that may not.
TOP_WEIGHTS = TrackingWeights(dtheta_rad_s=20.0, psi_rad=0.15, dpsi_rad_s=2.0, torque_nm=0.08)
# States of the ellipsoid.
ROWS = (1, 2, 3)
# Runs on a level, how long each is looked at, and how finely the level is found: of the one from 0.6 rad, which nothing
# holds. Of the largest level that was held the region has a share: other noise loses a ball that this one does not.
DIRECTIONS, LOOKED_S, HALVINGS, LARGEST_RAD, SHARE = 40, 2.0, 6, 0.6, 2 / 3
# Held, at the end: within a fifth of a radian of the top, and a hoop that does not run away.
HELD_RAD, HELD_HOOP_RAD_S = 0.2, 20.0


class TopLaw:
    """State feedback around the top that the ball is nearest to."""

    def __init__(self, gains: Array) -> None:
        self.gains = np.asarray(gains, float)

    def update(self, measurement: Measurement) -> tuple[float, Log]:
        """u = -K (x - top)."""
        x = measurement.x
        top = pi + 2.0 * pi * round((float(x[2]) - pi) / (2.0 * pi))
        return -float(self.gains @ (x - np.array([0.0, 0.0, top, 0.0]))), {}

    def reset(self) -> None:
        """It has no memory."""

    def tune(self, key: str, value: float) -> bool:
        """Nothing has a name."""
        return False


@dataclass(frozen=True)
class Balance:
    """The regulator of the top on a model, and the loop around it.

    Attributes
    ----------
    model : InnerModel
        Hoop and ball as the law and the filter know them.
    settings : EkfSettings
        Of the filter.
    torque_nm : float
        Largest torque, N m.
    tick_s : float
        Length of a tick in s.
    """

    model: InnerModel
    settings: EkfSettings
    torque_nm: float
    tick_s: float = 0.02
    weights: TrackingWeights = TOP_WEIGHTS

    @cached_property
    def regulator(self) -> tuple[Array, Array]:
        """P (4, 4) and gains (4,)."""
        p, gains = resting_gains(self.model.step(self.tick_s), TOP, self.weights)
        return p, np.array([0.0, *gains[1:]])

    def run(self, start: Array, seconds: float, seed: int = 0, true: FoundEffects | None = None) -> ClosedLoopRun:
        """A ball let go near the top.

        Parameters
        ----------
        start : ndarray, shape (3,)
            Hoop speed (rad/s), angle from the top (rad), ball speed (rad/s).
        seconds : float
            From then on.
        seed : int
            Of the sensors' noise.
        true : FoundEffects, optional
            Of another plant than the model's.
        """
        found = self.model.found
        scenario = Scenario(
            duration_s=seconds,
            psi0_rad=pi + float(start[1]),
            pushed=(float(start[0]), float(start[2])),
            period_s=self.tick_s,
            seed=seed,
        )
        limiter = Limiter(self.torque_nm, self.torque_nm)
        law, filter_ = TopLaw(self.regulator[1]), estimator_with(found, self.settings)
        return simulate(FreeBall(true or found, inner=True), law, filter_, limiter, scenario)

    def holds(self, start: Array, seconds: float, seed: int = 0, true: FoundEffects | None = None) -> bool:
        """Whether the ball is held from there."""
        run = self.run(start, seconds, seed, true)
        off = abs(float(run.psi[-1]) - pi)
        return off < HELD_RAD and abs(float(run.dtheta[-1])) < HELD_HOOP_RAD_S

    def region(self, seed: int = 0, directions: int = DIRECTIONS) -> BalanceRegion:
        """A share of the largest level whose runs are all held."""
        p = self.regulator[0][np.ix_(ROWS, ROWS)]
        low, high = 0.0, float(p[1, 1]) * LARGEST_RAD**2
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            starts = BalanceRegion(p, middle).drawn(directions, seed, on_its_edge=True)
            if all(self.holds(one, LOOKED_S, seed + k) for k, one in enumerate(starts)):
                low = middle
            else:
                high = middle
        return BalanceRegion(p, SHARE * low)


class BalanceRegion(NamedTuple):
    """x' P x <= level of (hoop speed, angle from the top, ball speed)."""

    p: Array  # (3, 3)
    level: float

    def drawn(self, count: int, seed: int, *, on_its_edge: bool = False) -> Array:
        """(count, 3) points, evenly in it or on its edge."""
        rng = np.random.default_rng([seed, 7])
        ways = rng.standard_normal((count, 3))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        radii = np.ones(count) if on_its_edge else rng.uniform(size=count) ** (1 / 3)
        # P = L L',  x = L'^-1 y
        inside = np.linalg.solve(np.linalg.cholesky(self.p).T, (ways * radii[:, None]).T).T
        return np.asarray(inside * np.sqrt(self.level))

    @property
    def half_widths(self) -> Array:
        """Largest of each state in it."""
        return np.asarray(np.sqrt(self.level * np.diag(np.linalg.inv(self.p))))
