"""The hoop with its ball and numbers, with or without effects: a `NumericPlant` made from a structure's parameters.

Rules of this file: no equation is written here; what a call means stands in `numeric_plant`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import casadi as ca

from hoopd.plants.effects.base import Effect, Point, Values
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.declaration import hoop_plant
from hoopd.plants.hoop.equations import ExtraForce, symbols
from hoopd.plants.hoop.parameters import PARAMETER_UNITS, check_parameters
from hoopd.plants.numeric_plant import NumericPlant

KEPT = 64  # functions, two of a plant


class HoopPlant(NumericPlant):
    """State (theta, dtheta, psi, dpsi), input: the torque that is demanded of the drive."""

    def __init__(
        self,
        structure: str,
        parameters: Mapping[str, float],
        extra_forces: tuple[ExtraForce, ...] = (),
        extra_parameters: tuple[str, ...] = (),
        effects: FoundEffects | None = None,
    ) -> None:
        """`effects`: those that act on the state alone, beside forces that are given as functions."""
        self._structure, self._extra, self._found = structure, extra_forces, effects
        self._parameters = check_parameters(structure, parameters, extra_parameters)
        found = effects.effects() if effects else ()
        if effects and not all(effect.acts_now for effect in found):
            raise ValueError(f"not all of {', '.join(effects.names)} act on the state alone")
        plant = hoop_plant(structure, self._parameters, limit=effects.limit_nm if effects else None)
        values = {**(effects.values if effects else {}), **self._parameters}
        super().__init__(plant, (*found, *force_effects(extra_forces)), values)
        self.prepare()

    @classmethod
    def with_effects(cls, found: FoundEffects) -> HoopPlant:
        """The plant of a model file with effects that act on the state alone."""
        return cls(found.structure, found.base, effects=found)

    def _stepped(self, name: str, substeps: int, *, jacobian: bool) -> ca.Function:
        """As any plant's; of a plant without effects written out once for the same numbers."""
        if self._effects:
            return super()._stepped(name, substeps, jacobian=jacobian)
        return _written_out(self._structure, tuple(self._values.items()), name, substeps, jacobian)

    @property
    def structure(self) -> str:
        """rolling, published or entries."""
        return self._structure

    @property
    def parameters(self) -> Mapping[str, float]:
        """Names and values in SI units (`PARAMETER_UNITS`), read only."""
        return MappingProxyType(self._parameters)

    def with_parameters(self, **changes: float) -> HoopPlant:
        """The same plant with some parameters changed."""
        return HoopPlant(self._structure, {**self._parameters, **changes}, self._extra, self._names, self._found)

    def __reduce__(self) -> tuple[type[HoopPlant], tuple[Any, ...]]:
        return HoopPlant, (self._structure, self._parameters, self._extra, self._names, self._found)

    @property
    def _names(self) -> tuple[str, ...]:
        return tuple(name for name in self._parameters if name not in PARAMETER_UNITS[self._structure])


@lru_cache(maxsize=KEPT)
def _written_out(
    structure: str, numbers: tuple[tuple[str, float], ...], name: str, substeps: int, jacobian: bool
) -> ca.Function:
    """The step of a hoop and its ball with these numbers."""
    plant = NumericPlant(hoop_plant(structure, dict(numbers)), (), dict(numbers))
    return plant._stepped(name, substeps, jacobian=jacobian)


def force_effects(forces: tuple[ExtraForce, ...]) -> tuple[Effect, ...]:
    """Forces that are given as functions, as effects."""
    return tuple(Effect(f"extra.force_{i}", (), force=_by_coordinate(one)) for i, one in enumerate(forces))


def _by_coordinate(extra: ExtraForce) -> Callable[[Point, Values], dict[str, Any]]:
    def force(s: Point, e: Values) -> dict[str, Any]:
        # where the hoop or the ball alone moves, the other one is at rest
        x = (getattr(s, name) if name in s else ca.SX(0) for name in ("theta", "dtheta", "psi", "dpsi"))
        forces = dict(zip(("theta", "psi"), extra(symbols(list(x), s.u, s.p)), strict=True))
        return {q: one for q, one in forces.items() if f"d{q}" in s and q in s}

    return force
