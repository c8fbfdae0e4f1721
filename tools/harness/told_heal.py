"""A healing whose diagnosis is told what it would find: dry friction that grows in a running loop.

Rules of this file: designing, proving and weighing are the real ones; only the diagnosis, which takes minutes, is told.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.healed_rig import HealedRun, heal_run
from hoopd.commands.heal_work import HealWorker
from hoopd.files.heal_policy import HealPolicy
from hoopd.files.model import EffectEntry, Parameter, model_text
from hoopd.heal.plan import HealPlan, HealWork
from hoopd.plants.model_file import load_model

POLICY = HealPolicy(schema="hoopd.policy/1", effects=["hoop.*"], pause_s=0.0)
FC = 0.012
MOVES = (0.1, -0.1, 0.05, -0.05, 0.15, -0.1)
QUICK = HealPlan(window_s=20.0, fresh_s=12.0, trial_s=12.0, round_s=12.0, pause_s=60.0)


class ToldWorker(HealWorker):
    """Is told what a diagnosis would find: designs on it, proves and weighs as ever."""

    def _diagnose(self, work: HealWork) -> dict[str, Any]:
        version, place = self.folder.read(work.number), self.folder.of(work.number)
        self._cut(work, place / "evidence.mcap")
        model = load_model(self.folder.of(version.before) / "model.yaml")
        known = [one for one in model.effects if one.name != "hoop.coulomb_friction"]
        grown = EffectEntry(name="hoop.coulomb_friction", parameters={"Fc": Parameter(value=FC, unit="N m")})
        effects = known if len(known) < len(model.effects) else [*known, grown]
        (place / "model.yaml").write_text(model_text(replace(model, effects=effects)))
        self._design(place)
        told = {"hoop.coulomb_friction": {"Fc": FC}}
        sure = {"hoop.coulomb_friction": 0.9}
        return {"kind": "physics", "reason": "told", "learn": True, "effects": told, "probabilities": sure}


def moved(duration_s: float) -> str:
    """References as an operator would ask for, every three seconds."""
    every = range(int(duration_s / 3.0) - 1)
    rows = (f"{{at_s: {2 + 3 * k}, name: reference, value: {MOVES[k % len(MOVES)]}}}" for k in every)
    return f"sim.commands=[{', '.join(rows)}]"


def friction(for_s: float = 0.0) -> str:
    """Dry friction that grows after 30 s."""
    return f"sim.effects=[{{name: hoop.coulomb_friction, parameters: {{Fc: {FC}}}, at_s: 30, for_s: {for_s}}}]"


def grown(folder: Path, duration_s: float, for_s: float = 0.0, **how: Any) -> HealedRun:
    """A run in which it does."""
    return heal_run(folder, friction(for_s), moved(duration_s), duration_s=duration_s, **how)
