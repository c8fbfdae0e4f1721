"""Free runs of the hoop with found effects: what `simulate.Model` is without them.

What comes back are readings: theta, dtheta and psi as the sensors give them (late, wrong, lagging), and dpsi as it is.

Rules of this file: `free_run_model` simulates; the effects' numbers are held, parameters of the base may be free.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hoopd.plants.composite import Composite
from hoopd.plants.found_effects import Found
from hoopd.plants.free_run_model import FreeRunModel, SimulatedRun
from hoopd.plants.hoop.equations import ExtraForce
from hoopd.plants.hoop.simulate import STEP_S, Model
from hoopd.plants.trajectory import Trajectory

Array = NDArray[np.float64]

STATES = ("theta", "dtheta", "psi", "dpsi")


class EffectModel:
    """The interface of `simulate.Model`; `free`: base parameters that a run is told anew."""

    def __init__(self, found: Found, free: Sequence[str] = (), *, moving: str = "both", step_s: float = STEP_S) -> None:
        """`moving`: both, hoop or ball; effects that what moves does not feel are left out."""
        plant = found.plant_of(moving)
        self._model = FreeRunModel(plant, found.effects(plant), free, values=found.values, step_s=step_s)
        self.free, self.step_s = self._model.free, self._model.step_s
        moved = self.composite.plant
        # where a state of the hoop stands among the plant's own, and where a reading takes its place
        self._states = {i: STATES.index(name) for i, name in enumerate(moved.states) if name in STATES}
        self._readings = {i: STATES.index(moved.state_of(name)) for i, name in enumerate(moved.channels)}

    @property
    def composite(self) -> Composite:
        """The hoop with what was found."""
        return self._model.composite

    def run(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Array:
        """Readings (n, 4) at the nodes t (n,) s from x0 (4,) with torques u (n-1,) N m held between them."""
        return self._four(self._model.run(p, self._start(x0), t, u))[0]

    def run_with_sensitivity(self, p: ArrayLike, x0: ArrayLike, t: ArrayLike, u: ArrayLike) -> Trajectory:
        """The same with exact derivatives by the free parameters and the start."""
        x, by = self._four(self._model.run_with_sensitivity(p, self._start(x0), t, u))
        m = len(self.free)
        return Trajectory(x, by[:, :, :m], by[:, :, m:])

    def _start(self, x0: ArrayLike) -> Array:
        """The plant's start (nx,) of the hoop's (4,); a state that an effect added begins at zero."""
        start = np.zeros(self.composite.nx)
        for own, column in self._states.items():
            start[own] = np.asarray(x0, float)[column]
        return start

    def _four(self, found: SimulatedRun) -> tuple[Array, Array]:
        """Readings (n, 4) and derivatives (n, 4, m + 4)."""
        m, n = len(self.free), len(found.states)
        asked = found.states_by.shape[2] > 0
        out, by = np.zeros((n, 4)), np.zeros((n, 4, m + 4 if asked else 0))
        columns = [*range(m), *(m + own for own in self._states)]
        places = [*range(m), *(m + column for column in self._states.values())]
        for values, slopes, table in (
            (found.states, found.states_by, self._states),
            (found.readings, found.readings_by, self._readings),
        ):
            for own, column in table.items():
                out[:, column] = values[:, own]
                if asked:
                    by[:, column] = 0.0
                    by[:, column, places] = slopes[:, own, columns]
        return out, by


def model_of(
    structure: str,
    values: Mapping[str, float],
    free: Sequence[str] = (),
    extra_forces: tuple[ExtraForce, ...] = (),
    effects: Found | None = None,
    *,
    moving: str = "both",
    step_s: float = STEP_S,
) -> Model | EffectModel:
    """What simulates a plant again and again, with effects where there are some; ValueError for two kinds of forces."""
    if not effects:
        return Model(structure, values, free, extra_forces, moving=moving, step_s=step_s)
    if extra_forces:
        raise ValueError("forces are either effects or functions, not both")
    found = effects.on(structure, values)
    return EffectModel(found, free, moving=moving, step_s=step_s)
