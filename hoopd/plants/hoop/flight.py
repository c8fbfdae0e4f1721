"""Free runs of a ball that may leave the hoop: rolling (or slipping) and free flight in turns.

It takes off where the normal force falls below zero. It lands where its distance from the axis comes back to Ro-Rb: its
speed across the hoop is lost, and the impulse of the contact makes it roll again, or as nearly as mu times the lost
momentum allows. What runs on through both (the hoop and its friction, lags, sensors) does so by the same effects.

Rules of this file: when the modes change and what carries over; how each moves stands in its plant.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.composite import LONGEST_STEP_S, Composite
from hoopd.plants.effects.base import Point
from hoopd.plants.free_run import FreeRun
from hoopd.plants.held_input import mean_torque, node_axis
from hoopd.plants.hoop.flying_plant import FlyingPlant

Array = NDArray[np.float64]

# At 2 ms a start is found to 1e-5 rad (the contact's force passes through zero); a landing is bisected so often.
SUBSTEPS, BISECTIONS = 10, 30
# A ball that is pressed on the hoop by half its weight (m/s^2) at two nodes has not left it in between; looked ahead by
# so many nodes.
PRESSED, AHEAD = 5.0, 50


class FlightRun(FreeRun):
    """Free runs with flights; `flights` are the times (s) of the last run's."""

    def __init__(self, composite: Composite) -> None:
        super().__init__(composite)
        effect = next(one for one in composite.effects if one.flight is not None)
        assert effect.flight is not None
        own = composite.declared
        self._flying: FlyingPlant = effect.flight(own)
        kept = [one for one in composite.effects if one.name not in self._flying.through_contact]
        self._rolling = Composite(own, composite.effects, substeps=1)
        self._air = Composite(self._flying.plant, kept, substeps=1)
        self._slip = next((one.key("mu") for one in composite.effects if one.name.endswith(".slip")), None)
        self._normal, self._off, self._on = self._modes()
        self.flights: list[tuple[float, float]] = []

    def run(self, values: Mapping[str, float], x0: ArrayLike, t: ArrayLike, u: ArrayLike | None = None) -> Array:
        """As `FreeRun.run`; of a flying ball psi is the direction in which it is seen."""
        t, u, _ = node_axis(t, u)
        course = _Course(self, values, self._start(np.asarray(x0, float), u))
        rows = [course.seen()]
        while len(rows) < len(t):
            safe = rows[:0] if course.flies else list(self._safely_on(values, course.z, t, u, len(rows) - 1))
            if safe:
                rows.extend(safe)
                course.z = safe[-1]
            else:
                self._node_by_node(course, values, t, u, len(rows) - 1)
                rows.append(course.seen())
        self.flights = course.flights(t[-1])
        return np.array(rows)

    def _safely_on(self, values: Mapping[str, float], z: Array, t: Array, u: Array, k: int) -> Array:
        """States after node k, as far as the ball is pressed on the hoop well."""
        ahead = self._forward(values, z, t, u, slice(k, k + AHEAD + 1))
        p = self._rolling.vector(values)
        normal = np.asarray(self._normal(ahead.T, p)).ravel()
        loose = np.flatnonzero(~(normal > PRESSED * p[self._rolling.names.index("mb")]))
        return ahead[1 : loose[0] if loose.size else None]

    def _node_by_node(self, course: _Course, values: Mapping[str, float], t: Array, u: Array, k: int) -> None:
        """Takes the course from node k to the next in small steps."""
        edges = np.linspace(t[k], t[k + 1], 1 + SUBSTEPS * int(np.ceil((t[k + 1] - t[k]) / LONGEST_STEP_S - 1e-9)))
        for j, torque in enumerate(mean_torque(edges, t, u, self._composite.delay_s(values))):
            course.step(float(torque), edges[j + 1] - edges[j], edges[j])

    def _between(self, when: Array, values: Mapping[str, float], p: Array, t: Array, u: Array, z: Array) -> Array:
        """States between the nodes: cubics through angles and rates, straight lines of what else there is."""
        k = np.clip(np.searchsorted(t, when, side="right") - 1, 0, len(t) - 2)
        h = (t[k + 1] - t[k])[:, None]
        s = np.clip((when - t[k])[:, None] / h, 0.0, 1.0)
        found = z[k] + s * (z[k + 1] - z[k])
        q = np.arange(0, self._composite.nx, 2)
        a, b, da, db = z[k][:, q], z[k + 1][:, q], z[k][:, q + 1] * h, z[k + 1][:, q + 1] * h
        # Hermite: q = a + s da + s^2 (3 (b-a) - 2 da - db) + s^3 (2 (a-b) + da + db)
        two, three = 3 * (b - a) - 2 * da - db, 2 * (a - b) + da + db
        found[:, q] = a + s * (da + s * (two + s * three))
        found[:, q + 1] = (da + s * (2 * two + 3 * s * three)) / h
        return found

    # ------------------------------------------------------------------------------------------ change of mode

    def _modes(self) -> tuple[ca.Function, ca.Function, ca.Function]:
        """Normal force (z, p); taking off (z, p) -> z in the air; landing (z in the air, p, mu) -> z."""
        z, p = ca.SX.sym("z", self._rolling.nz), ca.SX.sym("p", len(self._rolling.names))
        named = {name: p[i] for i, name in enumerate(self._rolling.names)}
        s = self._rolling.plant.point(z, named)
        normal = ca.Function("normal", [z, p], [self._flying.normal_force(s)])
        off = ca.Function("off", [z, p], [ca.densify(self._took_off(z, s))])
        air, mu = ca.SX.sym("air", self._air.nz), ca.SX.sym("mu")
        at = self._air.plant.point(air, named)
        return normal, off, ca.Function("on", [air, p, mu], [ca.densify(self._landed(air, at, mu))])

    def _took_off(self, z: Any, s: Point) -> Any:
        c = self._flying.contact(s)
        spin = c.by_theta * s.dtheta + c.by_psi * s.dpsi - (s.dslip if "slip" in s else 0.0)
        return ca.vertcat(z[: self._shared], 0.0, spin, s.p["Ro"] - s.p["Rb"], 0.0, z[self._rolling.nx :])

    def _landed(self, z: Any, s: Point, mu: Any) -> Any:
        c, rb = self._flying.contact(s), s.p["Rb"]
        by_theta = c.by_theta / c.theta_inertia if "theta" in self._rolling.plant.coordinates else 0.0
        by_psi = c.by_psi / c.psi_inertia
        slide = c.by_theta * s.dtheta + c.by_psi * s.dpsi - s.dspin
        # the impulse P after which nothing slides, at most mu m r':  hoop, path and spin change by it
        free = (c.by_theta * by_theta + c.by_psi * by_psi + 1.0 / c.spin_inertia) * rb
        most = mu * ca.fmax(s.p["mb"] * s.ddistance, 0.0)
        impulse = ca.fmin(ca.fmax(-slide / free, -most), most)
        change = {"theta": by_theta * rb * impulse, "psi": by_psi * rb * impulse, "slip": slide + free * impulse}
        own = {**{q: getattr(s, q) for q in self._rolling.plant.coordinates if q != "slip"}, "slip": 0.0}
        rate = {q: getattr(s, f"d{q}") for q in own if q != "slip"}
        state = [x for q in self._rolling.plant.coordinates for x in (own[q], rate.get(q, 0.0) + change[q])]
        return ca.vertcat(*state, z[self._air.nx :])

    @property
    def _shared(self) -> int:
        """States that rolling and flying plant begin with alike."""
        return self._air.nx - 4


class _Course:
    """One run: the mode, its state and when modes changed."""

    def __init__(self, owner: FlightRun, values: Mapping[str, float], z: Array) -> None:
        self._o, self.z, self.flies = owner, z, False
        self._p = {False: owner._rolling.vector(values), True: owner._air.vector(values)}
        self._track = values.get("Ro", owner._rolling.values["Ro"]) - values.get("Rb", owner._rolling.values["Rb"])
        # without slip in the model the contact holds whatever it has to
        self._mu = values.get(owner._slip, 1e9) if owner._slip else 1e9
        self._changes: list[float] = []

    def seen(self) -> Array:
        """The state as the rolling plant has it."""
        if not self.flies:
            return self.z
        o = self._o
        rolling = np.zeros(o._rolling.nz)
        rolling[: o._shared], rolling[o._rolling.nx :] = self.z[: o._shared], self.z[o._air.nx :]
        return rolling

    def step(self, torque: float, d: float, t: float) -> None:
        after = self._moved(torque, d, t)
        if self.flies and self._distance(after) > self._track:
            self._land(torque, d, t)
            return
        self.z = after
        if not self.flies and float(self._o._normal(after, self._p[False])) < 0.0:
            self.z, self.flies = self._o._off(after, self._p[False]).full().ravel(), True
            self._changes.append(t + d)

    def _land(self, torque: float, d: float, t: float) -> None:
        early, late = 0.0, d
        for _ in range(BISECTIONS):
            middle = (early + late) / 2
            if self._distance(self._moved(torque, middle, t)) > self._track:
                late = middle
            else:
                early = middle
        landed = self._o._on(self._moved(torque, late, t), self._p[False], self._mu)
        self.z, self.flies = landed.full().ravel(), False
        self._changes.append(t + late)
        self.z = self._moved(torque, d - late, t + late)

    def _moved(self, torque: float, d: float, t: float) -> Array:
        c = self._o._air if self.flies else self._o._rolling
        z = c.step_function(self.z, torque, np.zeros(c.nw), d, t, self._p[self.flies])
        return np.asarray(z.full().ravel())

    def _distance(self, z: Array) -> float:
        return float(z[self._o._air.nx - 2])

    def flights(self, end: float) -> list[tuple[float, float]]:
        """Begin and end of every flight, s."""
        times = [*self._changes, end] if self.flies else self._changes
        return list(zip(times[::2], times[1::2], strict=True))
