"""Free runs of a ball that may leave the hoop: rolling (or slipping) and free flight in turns.

Rules of this file: one run over a time axis; when the modes change and what carries over stands in `contact_modes`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect
from hoopd.plants.free_run import FreeRun
from hoopd.plants.held_input import mean_torque
from hoopd.plants.hoop.effects.contact_modes import ContactCourse, ContactModes
from hoopd.plants.plant_with_effects import LONGEST_STEP_S

Array = NDArray[np.float64]

# At 2 ms a start is found to 1e-5 rad (the contact's force passes through zero).
SUBSTEPS = 10
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
        self._modes = ContactModes(plant, effects)
        self.flights: list[tuple[float, float]] = []

    def _run(
        self, values: dict[str, float], x0: Array, nodes: Array, t: Array, u: Array, derivatives: bool
    ) -> tuple[Array, Array]:
        """As of any free run; of a flying ball psi is the direction in which it is seen."""
        if derivatives:
            return super()._run(values, x0, nodes, t, u, derivatives)
        course = ContactCourse(self._modes, values, self._start(x0, u))
        rows = [course.seen()]
        while len(rows) < len(nodes):
            safe = (
                rows[:0] if not course.rolls else list(self._safely_on(values, course.z, nodes[len(rows) - 1 :], t, u))
            )
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
        p = self._modes.rolling.vector(values)
        normal = np.asarray(self._modes.normal(ahead.T, p, nodes[None, : len(ahead)])).ravel()
        loose = np.flatnonzero(~(normal > PRESSED * p[self._modes.rolling.names.index("mb")]))
        return ahead[1 : loose[0] if loose.size else None]

    def _node_by_node(
        self, course: ContactCourse, values: Mapping[str, float], nodes: Array, t: Array, u: Array
    ) -> None:
        """Takes the course from one node to the next in small steps."""
        edges = np.linspace(
            nodes[0], nodes[1], 1 + SUBSTEPS * int(np.ceil((nodes[1] - nodes[0]) / LONGEST_STEP_S - 1e-9))
        )
        for j, torque in enumerate(mean_torque(edges, t, u[:, 0], self.composite.delay_s(values))):
            course.step(float(torque), edges[j + 1] - edges[j], edges[j])
