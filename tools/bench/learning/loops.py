"""The loop after a campaign: the law on what was learned beside the one on the truth and the one of before.

Each holds the ball on the rig that has what was hidden, with the same references and seeds; the rig's plant is not the
generator's, but the numbers are. Costs are the design's own, of true states, against the hoop's speed by which the law
on the truth holds a reference.

A loop that the daemon cuts costs infinitely much: what its torque was until then is no price of holding a ball.

Rules of this file: a truth that only a library has words for; laws are `hoopd design lqg` on a model file.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from pathlib import Path
from statistics import fmean
from typing import Any

import msgspec
import numpy as np
from harness.loop_cost import JUDGED_S, USUAL, figures_of_run
from harness.rigrun import run_rig

from hoopd.commands.step_commands import run_step
from hoopd.files.model import EffectEntry, Parameter, model_text
from hoopd.files.shipped import defaults_folder
from hoopd.plants.effects.vocabulary import known_effects
from hoopd.plants.hoop.parameters import PARAMETER_UNITS
from hoopd.plants.model_file import effects_plant, load_model

SEEDS, STEP_S, MOST_RAD, BEFORE_S = 3, 3.0, 0.1, 5.0
LAST_TICKS = 50  # exactly no torque for so long: the drive is off


def loop_costs(answer: Mapping[str, Any], model: Path | None, folder: Path) -> dict[str, float]:
    """Cost of a tick with each law; `model`: what was learned, None where the law of before stays."""
    folder.mkdir()
    true = folder / "truth.yaml"
    true.write_text(truth_text(answer))
    laws = {"before": USUAL, "truth": law_on(true, folder / "on_truth.yaml")}
    laws["learned"] = USUAL if model is None else law_on(model, folder / "on_learned.yaml")
    return {
        name: fmean(_cost(law, true, folder / f"{name}_{k}", k, laws["truth"]) for k in range(SEEDS))
        for name, law in laws.items()
    }


def truth_text(answer: Mapping[str, Any]) -> str:
    """A model file of what the judge knows."""
    model = load_model(defaults_folder() / "models" / "hoop.yaml")
    units: Mapping[str, str] = PARAMETER_UNITS[model.structure]
    base = {name: Parameter(value=value, unit=units[name]) for name, value in answer["base"].items() if name in units}
    names = [one["name"] for one in answer["effects"]]
    declared = known_effects(effects_plant(model), names)
    effects = [
        EffectEntry(
            name=one["name"],
            parameters={
                p.name: Parameter(value=one["as_seen"][p.name], unit=p.unit)
                for p in declared[one["name"]].parameters
                if p.name in one["as_seen"]
            },
        )
        for one in answer["effects"]
    ]
    return model_text(msgspec.structs.replace(model, parameters=model.parameters | base, effects=effects))


def law_on(model: Path, path: Path) -> Path:
    """The controller that `hoopd design lqg` makes of a model."""
    run_step(["design", "lqg", "--model", model, "--out", path], path.with_suffix(".log"))
    return path


def _cost(law: Path, plant: Path, folder: Path, seed: int, held_by: Path) -> float:
    rng = np.random.default_rng([seed, 1])
    times = np.arange(BEFORE_S, BEFORE_S + JUDGED_S, STEP_S)
    told = ", ".join(f"{{at_s: {t:g}, name: reference, value: {rng.uniform(-MOST_RAD, MOST_RAD):.3f}}}" for t in times)
    sets = (f"sim.model={plant}", f"control.file={law}", f"sim.commands=[{told}]", "sim.psi_rad=0")
    run = run_rig(folder, *sets, duration_s=BEFORE_S + JUDGED_S, seed=seed)
    return figures_of_run(run, held_by).cost if np.any(run.u[-LAST_TICKS:]) else inf
