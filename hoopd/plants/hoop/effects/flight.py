"""Free runs of a ball that may leave the hoop: rolling (or slipping) and free flight in turns.

It takes off where the normal force falls below zero. It lands where its distance from the axis comes back to Ro-Rb: its
speed across the hoop is lost, and the impulse of the contact makes it roll again, or as nearly as mu times the lost
momentum allows. What runs on through both (the hoop and its friction, lags, sensors) does so by the same effects.

Rules of this file: when the modes change and what carries over; how each moves stands in its plant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.free_run import FreeRun
from hoopd.plants.held_input import mean_torque
from hoopd.plants.hoop.effects.flying_plant import FlyingPlant
from hoopd.plants.plant_with_effects import LONGEST_STEP_S, Composite

Array = NDArray[np.float64]

# At 2 ms a start is found to 1e-5 rad (the contact's force passes through zero); a landing is bisected so often.
SUBSTEPS, BISECTIONS = 10, 30
# A ball that is pressed on the hoop by half its weight (m/s^2) at two nodes has not left it in between; looked ahead by
# so many nodes.
PRESSED, AHEAD = 5.0, 50


class FlightRun(FreeRun):
    """Free runs with flights; `flights` are the times (s) of the last run's. Derivatives are those of a ball that rolls
    throughout."""

    def __init__(
        self,
        plant: Plant,
        effects: Sequence[Effect],
        free: Sequence[str] = (),
        *,
        values: Mapping[str, float] | None = None,
        step_s: float | None = None,
    ) -> None:
        super().__init__(plant, effects, free, values=values, step_s=step_s)
        effect = next(one for one in effects if one.flight is not None)
        assert effect.flight is not None
        self._flying: FlyingPlant = effect.flight(plant)
        through = [one for one in effects if one.name not in self._flying.through_contact]
        self._rolling = Composite(plant, effects, substeps=1)
        self._air = Composite(self._flying.plant, through, substeps=1)
        self._slip = next((one.key("mu") for one in effects if one.name.endswith(".slip")), None)
        self._normal, self._off, self._on = self._modes()
        self.flights: list[tuple[float, float]] = []

    def _run(
        self, values: dict[str, float], x0: Array, nodes: Array, t: Array, u: Array, derivatives: bool
    ) -> tuple[Array, Array]:
        """As of any free run; of a flying ball psi is the direction in which it is seen."""
        if derivatives:
            return super()._run(values, x0, nodes, t, u, derivatives)
        course = _Course(self, values, self._start(x0, u))
        rows = [course.seen()]
        while len(rows) < len(nodes):
            safe = rows[:0] if course.flies else list(self._safely_on(values, course.z, nodes[len(rows) - 1 :], t, u))
            if safe:
                rows.extend(safe)
                course.z = safe[-1]
            else:
                self._node_by_node(course, values, nodes[len(rows) - 1 : len(rows) + 1], t, u)
                rows.append(course.seen())
        self.flights = course.flights(nodes[-1])
        return np.array(rows), np.zeros((len(nodes), self.composite.nz, 0))

    def _safely_on(self, values: Mapping[str, float], z: Array, nodes: Array, t: Array, u: Array) -> Array:
        """States after the first of the nodes, as far as the ball is pressed on the hoop well."""
        ahead = self._forward(values, z, nodes[: AHEAD + 1], t, u)
        p = self._rolling.vector(values)
        normal = np.asarray(self._normal(ahead.T, p)).ravel()
        loose = np.flatnonzero(~(normal > PRESSED * p[self._rolling.names.index("mb")]))
        return ahead[1 : loose[0] if loose.size else None]

    def _node_by_node(self, course: _Course, values: Mapping[str, float], nodes: Array, t: Array, u: Array) -> None:
        """Takes the course from one node to the next in small steps."""
        edges = np.linspace(
            nodes[0], nodes[1], 1 + SUBSTEPS * int(np.ceil((nodes[1] - nodes[0]) / LONGEST_STEP_S - 1e-9))
        )
        for j, torque in enumerate(mean_torque(edges, t, u[:, 0], self.composite.delay_s(values))):
            course.step(float(torque), edges[j + 1] - edges[j], edges[j])

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
