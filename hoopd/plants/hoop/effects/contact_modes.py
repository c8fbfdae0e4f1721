"""The modes of a ball that may leave the hoop, and what carries over from one to the next.

It takes off where the normal force falls below zero. It lands where its distance from the axis comes back to Ro-Rb: its
speed across the hoop is lost, and the impulse of the contact makes it roll again, or as nearly as mu times the lost
momentum allows. What runs on through both (the hoop and its friction, lags, sensors) does so by the same effects.

Rules of this file: guards and resets, step by step; how each mode moves stands in its plant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.hoop.effects.flying_plant import FlyingPlant
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

BISECTIONS = 30  # of a landing within a step


class ContactModes:
    """Rolling and flying plant with their effects, guard and resets."""

    def __init__(self, plant: Plant, effects: Sequence[Effect]) -> None:
        """`effects`: one of them lets the ball take off."""
        effect = next(one for one in effects if one.flight is not None)
        assert effect.flight is not None
        self._flying: FlyingPlant = effect.flight(plant)
        through = [one for one in effects if one.name not in self._flying.through_contact]
        self.rolling = Composite(plant, effects, substeps=1)
        self.air = Composite(self._flying.plant, through, substeps=1)
        self.slip = next((one.key("mu") for one in effects if one.name.endswith(".slip")), None)
        self.normal, self.off, self.on = self._functions()

    def _functions(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        """Normal force (z, p); taking off (z, p) -> z in the air; landing (z in the air, p, mu) -> z."""
        z, p = ca.SX.sym("z", self.rolling.nz), ca.SX.sym("p", len(self.rolling.names))
        named = {name: p[i] for i, name in enumerate(self.rolling.names)}
        s = self.rolling.plant.point(z, named)
        normal = ca.Function("normal", [z, p], [self._flying.normal_force(s)])
        off = ca.Function("off", [z, p], [ca.densify(self._took_off(z, s))])
        air, mu = ca.SX.sym("air", self.air.nz), ca.SX.sym("mu")
        at = self.air.plant.point(air, named)
        return normal, off, ca.Function("on", [air, p, mu], [ca.densify(self._landed(air, at, mu))])

    def _took_off(self, z: Any, s: Point) -> Any:
        c = self._flying.contact(s)
        spin = c.by_theta * s.dtheta + c.by_psi * s.dpsi - (s.dslip if "slip" in s else 0.0)
        return ca.vertcat(z[: self.shared], 0.0, spin, s.p["Ro"] - s.p["Rb"], 0.0, z[self.rolling.nx :])

    def _landed(self, z: Any, s: Point, mu: Any) -> Any:
        c, rb = self._flying.contact(s), s.p["Rb"]
        by_theta = c.by_theta / c.theta_inertia if "theta" in self.rolling.plant.coordinates else 0.0
        by_psi = c.by_psi / c.psi_inertia
        slide = c.by_theta * s.dtheta + c.by_psi * s.dpsi - s.dspin
        # the impulse P after which nothing slides, at most mu m r':  hoop, path and spin change by it
        free = (c.by_theta * by_theta + c.by_psi * by_psi + 1.0 / c.spin_inertia) * rb
        most = mu * ca.fmax(s.p["mb"] * s.ddistance, 0.0)
        impulse = ca.fmin(ca.fmax(-slide / free, -most), most)
        change = {"theta": by_theta * rb * impulse, "psi": by_psi * rb * impulse, "slip": slide + free * impulse}
        own = {**{q: getattr(s, q) for q in self.rolling.plant.coordinates if q != "slip"}, "slip": 0.0}
        rate = {q: getattr(s, f"d{q}") for q in own if q != "slip"}
        state = [x for q in self.rolling.plant.coordinates for x in (own[q], rate.get(q, 0.0) + change[q])]
        return ca.vertcat(*state, z[self.air.nx :])

    @property
    def shared(self) -> int:
        """States that rolling and flying plant begin with alike."""
        return self.air.nx - 4


class ContactCourse:
    """One run: the mode, its state and when modes changed."""

    def __init__(self, modes: ContactModes, values: Mapping[str, float], z: Array) -> None:
        self._o, self.z, self.flies = modes, z, False
        self._p = {False: modes.rolling.vector(values), True: modes.air.vector(values)}
        self._track = values.get("Ro", modes.rolling.values["Ro"]) - values.get("Rb", modes.rolling.values["Rb"])
        # without slip in the model the contact holds whatever it has to
        self._mu = values.get(modes.slip, 1e9) if modes.slip else 1e9
        self._changes: list[float] = []

    def seen(self) -> Array:
        """The state as the rolling plant has it."""
        if not self.flies:
            return self.z
        o = self._o
        rolling = np.zeros(o.rolling.nz)
        rolling[: o.shared], rolling[o.rolling.nx :] = self.z[: o.shared], self.z[o.air.nx :]
        return rolling

    @property
    def distance(self) -> float:
        """Of the ball's centre from the axis, in shares of what it is on the hoop."""
        return self._distance(self.z) / self._track if self.flies else 1.0

    def step(self, torque: float, d: float, t: float) -> None:
        """Go on by d seconds from t; a change of mode within them is found."""
        after = self._moved(torque, d, t)
        if self.flies and self._distance(after) > self._track:
            self._land(torque, d, t)
            return
        self.z = after
        if not self.flies and float(self._o.normal(after, self._p[False])) < 0.0:
            self.z, self.flies = self._o.off(after, self._p[False]).full().ravel(), True
            self._changes.append(t + d)

    def _land(self, torque: float, d: float, t: float) -> None:
        early, late = 0.0, d
        for _ in range(BISECTIONS):
            middle = (early + late) / 2
            if self._distance(self._moved(torque, middle, t)) > self._track:
                late = middle
            else:
                early = middle
        landed = self._o.on(self._moved(torque, late, t), self._p[False], self._mu)
        self.z, self.flies = landed.full().ravel(), False
        self._changes.append(t + late)
        self.z = self._moved(torque, d - late, t + late)

    def _moved(self, torque: float, d: float, t: float) -> Array:
        c = self._o.air if self.flies else self._o.rolling
        z = c.step_function(self.z, torque, np.zeros(c.nw), d, t, self._p[self.flies])
        return np.asarray(z.full().ravel())

    def _distance(self, z: Array) -> float:
        return float(z[self._o.air.nx - 2])

    def flights(self, end: float) -> list[tuple[float, float]]:
        """Begin and end of every flight, s."""
        times = [*self._changes, end] if self.flies else self._changes
        return list(zip(times[::2], times[1::2], strict=True))
