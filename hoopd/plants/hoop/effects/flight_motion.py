"""How a ball in the air moves over a step: past the axis in the plane, else in the coordinates of the flying plant.

    (x, y) = r (sin psi, -cos psi),   (x', y') = r' (sin psi, -cos psi) + r psi' (cos psi, sin psi)

Direction and distance change the faster the nearer the ball comes to the axis, at the axis without bound; in the plane
nothing does, and gravity's parabola is exact. Forces are those on a ball in the same direction at its track, as fast:
gravity, a lean and a shaking frame are the same there, and whatever else acts is told so everywhere in the air.

Rules of this file: one step; the plant's equations stand in `flying_plant`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from hoopd.plants.hoop.effects.flying_plant import NEAREST_M
from hoopd.plants.integration_step import HoldingForces, Motion, StageTorques, runge_kutta
from hoopd.plants.plant_with_effects import Composite

# Beyond so many steps' way from the axis a step turns the direction by less than 1/16 rad, and a whole flight errs by
# less than 1e-6 of the ball's weight times its track in energy (4e-6 with ten).
NEAR_STEPS = 16.0
# And where the plant's equations no longer hold, whatever the step.
NEAR_M = 10.0 * NEAREST_M
# Least distance, m, that a direction is taken of: on the axis itself the ball has the one that it had.
ON_AXIS_M = 1e-12


class FlightMotion(Motion):
    """The flying plant's motion."""

    def step(
        self,
        x: Any,
        torques: StageTorques,
        w: Any,
        d: Any,
        t: Any,
        p: Mapping[str, Any],
        holding: HoldingForces | None = None,
    ) -> Any:
        """As `Motion.step`."""
        far = super().step(x, torques, w, d, t, p, holding)
        plane = _Plane(self, p)
        begin, values = plane.of(x), self._vector(p)
        stops = self._held(plane.at_track(begin, x), torques, w, d, t, values, holding)

        def rate(y: Any, at: Any, stage: int) -> Any:
            seen = plane.at_track(y, x)
            return plane.rate(y, seen, self._rate(seen, torques[stage], w, at, values, stops))

        end = runge_kutta(rate, begin, d, t)
        near = self._ended(plane.told(end, x), holding)
        way = ca.fmax(NEAR_M, NEAR_STEPS * d * ca.fmax(plane.speed(begin), plane.speed(end)))
        passes = ca.fmin(plane.distance(begin), plane.distance(end)) < way
        return ca.vertcat(*(ca.if_else(passes, near[i], far[i]) for i in range(self._nx)))


class _Plane:
    """A state of the flying plant whose direction, distance and rates are a place (x, y) and a speed (x', y')."""

    def __init__(self, motion: Motion, p: Mapping[str, Any]) -> None:
        states = motion.states
        self._psi, self._dpsi, self._r, self._dr = (
            states.index(one) for one in ("psi", "dpsi", "distance", "ddistance")
        )
        self._track = p["Ro"] - p["Rb"]

    def of(self, x: Any) -> Any:
        """From direction and distance."""
        psi, r = x[self._psi], ca.fmax(x[self._r], ON_AXIS_M)
        out, along = _axes(psi)
        return self._with(x, r * out, x[self._dr] * out + r * x[self._dpsi] * along)

    def at_track(self, y: Any, x: Any) -> Any:
        """The flying plant's state of a ball in the same direction, as fast, at its track."""
        return self._polar(y, x, self._track)

    def told(self, y: Any, x: Any) -> Any:
        """The flying plant's state, its direction the nearest to that of x."""
        return self._polar(y, x, self.distance(y))

    def _polar(self, y: Any, x: Any, r: Any) -> Any:
        place, speed, psi = y[[self._psi, self._r]], y[[self._dpsi, self._dr]], x[self._psi]
        out, along = _axes(psi)
        psi = psi + ca.atan2(ca.dot(place, along), ca.dot(place, out))
        out, along = _axes(psi)
        return self._put(y, psi, ca.dot(speed, along) / r, r, ca.dot(speed, out))

    def rate(self, y: Any, seen: Any, rate: Any) -> Any:
        """dy/dt from the flying plant's rate at the track."""
        out, along = _axes(seen[self._psi])
        r, dpsi = seen[self._r], seen[self._dpsi]
        # a = (r'' - r psi'^2) out + (r psi'' + 2 r' psi') along
        outwards = rate[self._dr] - r * dpsi**2
        sideways = r * rate[self._dpsi] + 2.0 * seen[self._dr] * dpsi
        return self._with(rate, y[[self._dpsi, self._dr]], outwards * out + sideways * along)

    def distance(self, y: Any) -> Any:
        """Of a place from the axis, m."""
        return ca.fmax(ca.hypot(y[self._psi], y[self._r]), ON_AXIS_M)

    def speed(self, y: Any) -> Any:
        """m/s."""
        return ca.hypot(y[self._dpsi], y[self._dr])

    def _with(self, x: Any, place: Any, speed: Any) -> Any:
        return self._put(x, place[0], speed[0], place[1], speed[1])

    def _put(self, x: Any, psi: Any, dpsi: Any, r: Any, dr: Any) -> Any:
        put = {self._psi: psi, self._dpsi: dpsi, self._r: r, self._dr: dr}
        return ca.vertcat(*(put.get(i, x[i]) for i in range(x.numel())))


class FlyingComposite(Composite):
    """The flying plant with its effects, as a run of the simulator takes it past the axis."""

    motion_class = FlightMotion


def _axes(psi: Any) -> tuple[Any, Any]:
    """Unit vectors outwards and along."""
    return ca.vertcat(ca.sin(psi), -ca.cos(psi)), ca.vertcat(ca.cos(psi), ca.sin(psi))
