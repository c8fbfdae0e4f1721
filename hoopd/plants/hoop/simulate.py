"""Free runs of the hoop with its ball, with or without effects: `FreeRun` with the four states of the hoop.

What comes back of a plant with effects are readings: theta, dtheta and psi as the sensors give them (late, wrong,
lagging), and dpsi as it is.

Rules of this file: `free_run` simulates; the torque is held between two nodes. One object belongs to one thread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.free_run import FreeRun
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.equations import ExtraForce
from hoopd.plants.hoop.parameters import PARAMETER_UNITS
from hoopd.plants.hoop.plant import force_effects
from hoopd.plants.plant_with_effects import Composite
from hoopd.plants.trajectory import Trajectory

Array = NDArray[np.float64]

# Classical Runge-Kutta at 10 ms misses the converged psi by 2.4e-8 rad over a 20 ms step at full speed (test of
# step-halving), 1e4 times below the encoder's step.
STEP_S = 0.010
STATES = ("theta", "dtheta", "psi", "dpsi")


class HoopModel:
    """The plant with some parameters left free: what a fit simulates again and again."""

    def __init__(
        self,
        structure: str,
        values: Mapping[str, float],
        free: Sequence[str] = (),
        extra_forces: tuple[ExtraForce, ...] = (),
        effects: FoundEffects | None = None,
        *,
        moving: str = "both",
        step_s: float = STEP_S,
    ) -> None:
        """`values`: every parameter of the structure (and of the forces); `free`: which of them a run is told anew;
        `effects`: those that what moves does not feel are left out; `moving`: both, hoop (no ball) or ball (hoop
        held)."""
        unknown = [name for name in free if name not in values]
        missing = [name for name in PARAMETER_UNITS[structure] if name not in values]
        if unknown or missing:
            raise ValueError(f"unknown parameters {unknown}, missing {missing}")
        if effects and extra_forces:
            raise ValueError("forces are either effects or functions, not both")
        plant = hoop_plant(structure, values, moving, effects.limit_nm if effects else None)
        found = effects.effects(plant) if effects else force_effects(extra_forces)
        self.structure, self.values, self.free = structure, dict(values), tuple(free)
        # the base's own numbers, also where the effects were found on others
        known = {**(effects.values if effects else {}), **values}
        self._model = FreeRun(plant, found, free, values=known, step_s=step_s)
        self.step_s, self._read = self._model.step_s, bool(effects)
        # where a state of the hoop stands among the plant's own, and where a reading takes its place
        moved = self.composite.plant
        self._states = {i: STATES.index(name) for i, name in enumerate(moved.states) if name in STATES}
        self._readings = {i: STATES.index(moved.state_of(name)) for i, name in enumerate(moved.channels)}

    @classmethod
    def with_effects(
        cls, found: FoundEffects, free: Sequence[str] = (), *, moving: str = "both", step_s: float = STEP_S
    ) -> HoopModel:
        """What was found, on the base that it was found on."""
        return cls(found.structure, found.base, free, effects=found, moving=moving, step_s=step_s)

    @property
    def composite(self) -> Composite:
        """The hoop with its effects."""
        return self._model.composite

    @property
    def columns(self) -> list[int]:
        """Where the states of the composite stand among the four; of one that an effect added nowhere."""
        return list(self._states.values())

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        """States (n, 4), with effects as they are read, at the nodes t (n,) s from x0 (4,).

        u: torque (n-1,) N m held between them.
        """
        return self._four(p, np.asarray(x0, float), t, u, derivatives=False).x

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Trajectory:
        """The same with exact derivatives: S' = df/dx S + df/dp, taken through the integration steps themselves."""
        return self._four(p, np.asarray(x0, float), t, u, derivatives=True)

    def _four(self, p: ArrayLike, x0: Array, t: ArrayLike, u: ArrayLike, *, derivatives: bool) -> Trajectory:
        m = len(self.free)
        if not self._read and self.composite.plant.states == STATES:
            x, by = self._model.states(p, x0, t, u, derivatives=derivatives)
            return Trajectory(x, by[:, :, :m], by[:, :, m:])
        tables = self._simulated(p, self._start(x0), t, u, derivatives=derivatives)
        n = len(tables[0][0])
        # what does not move stays where it began
        x, by = np.tile(x0, (n, 1)), np.zeros((n, 4, m + 4 if derivatives else 0))
        if derivatives:
            by[:, range(4), range(m, m + 4)] = 1.0
        columns = [*range(m), *(m + own for own in self._states)]
        places = [*range(m), *(m + column for column in self._states.values())]
        for values, slopes, table in tables:
            for own, column in table.items():
                x[:, column] = values[:, own]
                if derivatives:
                    by[:, column] = 0.0
                    by[:, column, places] = slopes[:, own, columns]
        return Trajectory(x, by[:, :, :m], by[:, :, m:])

    def _simulated(
        self, p: ArrayLike, start: Array, t: ArrayLike, u: ArrayLike, *, derivatives: bool
    ) -> list[tuple[Array, Array, dict[int, int]]]:
        """States, and readings where they differ: values, their derivatives and the hoop's columns."""
        if not self._read:
            return [(*self._model.states(p, start, t, u, derivatives=derivatives), self._states)]
        simulate = self._model.run_with_sensitivity if derivatives else self._model.run
        found = simulate(p, start, t, u)
        return [
            (found.states, found.states_by, self._states),
            (found.readings, found.readings_by, self._readings),
        ]

    def _start(self, x0: Array) -> Array:
        """The plant's start (nx,) of the hoop's (4,); a state that an effect added begins at zero."""
        start = np.zeros(self.composite.nx)
        for own, column in self._states.items():
            start[own] = x0[column]
        return start
