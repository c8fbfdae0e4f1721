"""Records of a model file (`hoopd.model/1`), and its text.

Rules of this file: what stands in the file and nothing more; whether a plant can have these numbers is judged where
plants are known (`plants.model_file`).
"""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from hoopd.core.limits import TORQUE_LIMIT_NM
from hoopd.files.records import Strict
from hoopd.files.yaml_text import text_of


class InnerHoop(Strict, frozen=True):
    """A hoop, or the U-shape of one, on whose outside the ball may roll."""

    radius_m: float  # Ri: axis to the contact circle


class DeviceConstants(Strict, frozen=True):
    """What is weighed and measured on the device, and the limits of its drive and encoder."""

    ball_mass_kg: float
    hoop_radius_m: float  # Ro: axis to the contact circle
    ball_radius_m: float  # Rb: the ball's rolling radius on its O-rings
    gravity_m_s2: float = 9.81
    torque_limit_nm: float = TORQUE_LIMIT_NM
    encoder_counts: int = 4096
    inner: InnerHoop | None = None  # a second hoop within, which turns with it

    def values(self) -> dict[str, float]:
        """By the names of the equations."""
        return {"mb": self.ball_mass_kg, "Ro": self.hoop_radius_m, "Rb": self.ball_radius_m, "g": self.gravity_m_s2}


class Parameter(Strict, frozen=True):
    """A number of the model: value and unit, 95 % interval where it was estimated, and what it started from."""

    value: float
    unit: str
    ci95: tuple[float, float] | None = None
    nominal: float | None = None


class EffectEntry(Strict, frozen=True):
    """A found effect (vocabulary of effects, `slot.name`) with its parameters, and where it was seen."""

    name: str
    parameters: dict[str, Parameter] = msgspec.field(default_factory=dict)
    # by theta, dtheta, psi, dpsi or u: [lowest, highest] of what was recorded; nothing is fed forward outside
    valid: dict[str, tuple[float, float]] = msgspec.field(default_factory=dict)


class ModelFile(Strict, frozen=True):
    """`hoopd.model/1` of the hoop."""

    schema: Literal["hoopd.model/1"]
    name: str
    structure: Literal["rolling", "published", "entries"]
    device: DeviceConstants
    parameters: dict[str, Parameter]
    effects: list[EffectEntry] = msgspec.field(default_factory=list)
    sample_time_s: float = 0.02
    plant: Literal["hoop"] = "hoop"

    def values(self) -> dict[str, float]:
        """Parameters by name; a parameter overrides the device constant of the same name."""
        return {**self.device.values(), **{name: entry.value for name, entry in self.parameters.items()}}


class PlantModelFile(Strict, frozen=True):
    """`hoopd.model/1` of any other plant: a registered name or a plant file, and its numbers."""

    schema: Literal["hoopd.model/1"]
    name: str
    plant: str
    parameters: dict[str, Parameter] = msgspec.field(default_factory=dict)  # the plant's own where they are not told
    effects: list[EffectEntry] = msgspec.field(default_factory=list)
    sample_time_s: float = 0.02

    def values(self) -> dict[str, float]:
        """Parameters by name."""
        return {name: entry.value for name, entry in self.parameters.items()}


def model_text(model: ModelFile | PlantModelFile) -> str:
    """The text of a model file, every number to its last bit."""
    lines: list[str] = []
    for key, value in msgspec.to_builtins(model).items():
        if isinstance(value, dict) and all(isinstance(one, dict) for one in value.values()):
            lines += [f"{key}:"] + [f"  {name}: {_flow(one)}" for name, one in value.items()]
        elif isinstance(value, list) and value:
            lines += [f"{key}:"] + [f"  - {_flow(one)}" for one in value]
        else:
            lines += [f"{key}: {_flow(value)}"]
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    """One line of YAML."""
    return text_of(value, default_flow_style=True, width=10**6).removesuffix("...\n").strip()
