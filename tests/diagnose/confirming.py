"""What the tests of held-out data share: recordings of a friction, and what is confirmed of it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from diagnose.madeup import shipped_plant, stretch_with

from hoopd.diagnose.proof.confirmation import Confirmation, confirmation
from hoopd.diagnose.proof.fit_tables import Played, played
from hoopd.diagnose.proof.held_out import HeldOut
from hoopd.diagnose.search.candidates import Tried
from hoopd.diagnose.search.naming import Named
from hoopd.plants.effects.base import Effect
from hoopd.plants.effects.library import library
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.stretches import Stretch

PLANT = shipped_plant()
FRICTION = library(PLANT)["hoop.coulomb_friction"]
LIMIT = library(PLANT)["actuator.saturation"]
TILT = library(PLANT)["frame.tilt"]
SIZE = {f"{FRICTION.name}.Fc": 0.03}


def recorded(name: str, seed: int, friction: bool, seconds: float = 16.0) -> Stretch:
    effects, values = ([FRICTION], {**PLANT.values, **SIZE}) if friction else ([], PLANT.values)
    return stretch_with(PLANT, name, seed, seconds, effects, values)


def named_with(base: HypothesisFit, final: HypothesisFit, effect: Effect = FRICTION) -> Named:
    score: Any = SimpleNamespace(member=SimpleNamespace(effect=effect))
    gain = base.criterion - final.criterion
    one = Tried(effect, final, gain, gain, score)
    return Named(base, base, final, [one], [one], {effect.name: gain}, {effect.name: base})


def confirmed(named: Named, stretch: Stretch) -> tuple[Confirmation, dict[str, Played]]:
    held = HeldOut([stretch])
    wanted = {"base": named.base, "named": named.final}
    wanted |= {f"without {name}": one for name, one in named.without.items()}
    shown = played({name: run for name, one in wanted.items() if (run := held.of(one)) is not None})
    shown["final"] = shown["named"]
    return confirmation(named, held, shown, None, 12.0), shown
