"""Output-error fits of the hoop: its structures, with both moving, the hoop alone or the ball in a held hoop.

Rules of this file: it tells `plants.fits.output_error` what the hoop is; no mathematics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from hoopd.plants.fits import output_error
from hoopd.plants.fits.arbitrary_zero import Place, ZeroedSystem
from hoopd.plants.fits.free_parameters import Scale
from hoopd.plants.fits.output_error import Problem, Solution
from hoopd.plants.fits.runs import Run
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.equations import ExtraForce
from hoopd.plants.hoop.fitting.free_parameters import scale_of
from hoopd.plants.hoop.recordings.fit_data import STATES
from hoopd.plants.hoop.simulate import HoopModel
from hoopd.plants.plant_with_effects import Composite


@dataclass(frozen=True)
class HoopSystem:
    """A structure with its numbers, and what it has beside its equations, held."""

    structure: str
    values: Mapping[str, float]
    extra_forces: tuple[ExtraForce, ...] = ()
    effects: FoundEffects | None = None

    # where theta stands in a start and in a model's run
    THETA: ClassVar[Place] = Place(0, (STATES["theta"],))

    @property
    def columns(self) -> Mapping[str, int]:
        """Of the states theta, dtheta, psi, dpsi; a rate is theta's."""
        return STATES

    def model(self, moving: str, free: Sequence[str]) -> HoopModel:
        """moving: both, hoop or ball."""
        return HoopModel(self.structure, self.values, free, self.extra_forces, self.effects, moving=moving)

    def composite(self, moving: str, free: Sequence[str]) -> Composite:
        """The equations of what moves."""
        return self.model(moving, free).composite

    def start_columns(self, moving: str) -> list[int]:
        """Of the states that move among the four."""
        return self.model(moving, ()).columns

    def scale(self, names: Sequence[str]) -> Scale:
        return scale_of(self.structure, names, self.values)

    def free_starts(self, run: Run) -> list[int]:
        return free_starts(run)


def free_starts(run: Run) -> list[int]:
    """Components of the initial state that the run's channels see."""
    hoop = [0, 1] if "theta" in run.series else [1]
    return {"both": [*hoop, 2, 3], "hoop": hoop, "ball": [2, 3]}[run.moving]


def hoop_problem(structure: str, values: Mapping[str, float], runs: Sequence[Run], scale: Scale) -> Problem:
    """Residuals and derivatives of a structure's runs."""
    return Problem(HoopSystem(structure, values), runs, scale)


def fit_output_error(
    structure: str,
    values: Mapping[str, float],
    names: Sequence[str],
    runs: Sequence[Run],
    *,
    extra_forces: tuple[ExtraForce, ...] = (),
    effects: FoundEffects | None = None,
    zero: float = 0.0,
    **options: Any,
) -> Solution:
    """Parameters `names` of a structure (start: `values`); `zero`: of the recording's theta against that of the
    effects; options as in `plants.fits.output_error`."""
    system = HoopSystem(structure, values, extra_forces, effects)
    turned = ZeroedSystem(system, system.THETA, zero) if zero else system
    return output_error.fit_output_error(turned, names, runs, **options)
