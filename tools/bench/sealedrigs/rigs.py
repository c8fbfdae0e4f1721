"""Sealed rigs: every parameter a tenth off, and one or two effects of the library in sizes of the concealed cases.

Rules of this file: a rig follows from its seed; what is drawn here is seen by the rig and the judge alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from concealed.effects import ALL, SINGLES
from concealed.hidden import log_uniform

from hoopd.files.model import EffectEntry, ModelFile, Parameter, model_text
from hoopd.files.shipped import defaults_folder
from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.model_file import effects_plant, load_model

OFF = 0.1
# Faults of single pictures are no physics of a rig; a push is in one recording alone.
NOT_OF_A_RIG = frozenset({"camera.late_frames", "camera.outliers", "external.disturbance", "actuator.torque_gain"})
# Sizes: from where a search begins to a part of what is physically possible at all.
MOST = 0.5
# What some sizes are told relative to: torque and speed that a loop asks for.
USUAL = {"peak": 0.45, "fastest": 30.0}


class SealedRig(NamedTuple):
    """What a rig has."""

    seed: int
    factors: dict[str, float]
    effects: dict[str, dict[str, float]]

    def model(self) -> ModelFile:
        """The truth as a model file, effects included."""
        nominal = load_model(defaults_folder() / "models" / "hoop.yaml")
        values = nominal.values()
        device = msgspec.structs.replace(
            nominal.device,
            ball_mass_kg=values["mb"] * self.factors["mb"],
            hoop_radius_m=values["Ro"] * self.factors["Ro"],
            ball_radius_m=values["Rb"] * self.factors["Rb"],
        )
        parameters = {
            name: Parameter(value=entry.value * self.factors[name], unit=entry.unit)
            for name, entry in nominal.parameters.items()
        }
        known = known_effects(effects_plant(nominal), list(self.effects))
        entries = [
            EffectEntry(
                name=name,
                parameters={
                    key: Parameter(value=value, unit=known[name].parameter(key).unit) for key, value in told.items()
                },
            )
            for name, told in self.effects.items()
        ]
        return msgspec.structs.replace(nominal, name="sealed", device=device, parameters=parameters, effects=entries)

    def write(self, path: Path) -> Path:
        """The model file of the rig."""
        path.write_text(model_text(self.model()))
        return path


def sealed_rig(seed: int) -> SealedRig:
    """One rig: each parameter a tenth larger or smaller, one effect, or two of different slots."""
    rng = np.random.default_rng([seed, 1789])
    factors = {name: 1.0 + OFF * float(rng.choice((-1.0, 1.0))) for name in ("mb", "Ro", "Rb", "Ib", "Ih", "bb", "bh")}
    names = [name for name in SINGLES if name not in NOT_OF_A_RIG]
    wanted, chosen = int(rng.integers(1, 3)), list[str]()
    while len(chosen) < wanted:
        name = str(rng.choice(names))
        if name.split(".", maxsplit=1)[0] not in {one.split(".")[0] for one in chosen}:
            chosen.append(name)
    return SealedRig(seed, factors, {name: _drawn(name, rng) for name in chosen})


def _drawn(name: str, rng: np.random.Generator) -> dict[str, float]:
    hidden = ALL[name]
    size = log_uniform(rng, hidden.first, max(MOST * hidden.cap, hidden.first))
    return {
        key: float(value) for key, value in hidden.at(size, {**USUAL, **hidden.fixed(rng)}).items() if key not in USUAL
    }
