"""The effects that make a free run better, as the record tells them: evidence of a simulation, no names of a verdict.

Rules of this file: the set is chosen on the training stretches alone; held-out ones and whole recordings give figures
of that set, nothing is chosen on them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from hoopd.diagnose.proof.fit_tables import nrmse
from hoopd.diagnose.proof.free_run_refinement import Refined
from hoopd.diagnose.proof.free_run_selection import Selected, Selection
from hoopd.diagnose.proof.free_runs import HELD_OUT
from hoopd.diagnose.record import Fit as Percent, Fits, FreeRunChoice, FreeRunEffect, Quantity
from hoopd.plants.effects.base import Effect
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.stretches import Stretch

WHOLE = "(fitted on all of it)"
CHOSEN_ON = "the training stretches, each parameter charged; nothing was chosen on held-out data"


def free_choice(
    final: HypothesisFit,
    heldout: Sequence[Stretch],
    library: Mapping[str, Effect],
    seed: int = 0,
    whole: Sequence[Stretch] = (),
) -> FreeRunChoice:
    """From the named set; `whole`: recordings whose parts are fitted and held out, for the in-sample figures."""
    selection = Selection([track.stretch for track in final.tracks], heldout, library, seed)
    chosen = selection.run(final.effects, final.values)
    base = Selected((), selection.grown((), final.values))
    table = percents(base.refined, chosen.refined, "")
    gained = None
    if heldout:
        before, after = selection.on_heldout(base), selection.on_heldout(chosen)
        table |= percents(before, after, f" {HELD_OUT}")
        gained = 1.0 - after.cost / before.cost
    if whole:
        table |= _in_sample(Selection(whole, (), library, seed), chosen)
    found = effects_of(chosen, final.names)
    return FreeRunChoice(effects=found, heldout_share=gained, fits=table, chosen_on=CHOSEN_ON)


def _in_sample(selection: Selection, chosen: Selected) -> Fits:
    """Base and chosen set, everything fitted on whole recordings."""
    base = selection.grown((), chosen.refined.values)
    again = selection.fitted(chosen.effects, chosen.refined.values, base) if chosen.effects else base
    return percents(base, again, f" {WHOLE}")


def effects_of(chosen: Selected, named: Sequence[str]) -> list[FreeRunEffect]:
    """In the order in which they came; of those that were named before, no step tells a chance."""
    steps = {step.effect: step for step in chosen.steps if step.taken}
    found = []
    for effect in chosen.effects:
        step = steps.get(effect.name)
        found.append(
            FreeRunEffect(
                name=effect.name,
                named=effect.name in named,
                parameters=_parameters(effect, chosen.refined),
                error_share=None if step is None else step.fitted,
                chance=None if step is None else step.chance,
            )
        )
    return found


def _parameters(effect: Effect, found: Refined) -> dict[str, Quantity]:
    units = {effect.key(p.name): p for p in effect.parameters}
    own = {name: value for name, value in found.values.items() if name.split("@")[0] in units}
    return {
        name.removeprefix(f"{effect.name}."): Quantity(
            value=value, unit=units[name.split("@")[0]].unit, ci95=None, nominal=units[name.split("@")[0]].neutral
        )
        for name, value in own.items()
    }


def percents(base: Refined, chosen: Refined, mark: str) -> Fits:
    """Of both, by recording and channel."""
    table: Fits = {}
    for recording in dict.fromkeys(run.windows.stretch.recording for run in chosen.runs):
        before, after = (
            nrmse([run for run in one.runs if run.windows.stretch.recording == recording]) for one in (base, chosen)
        )
        table[recording + mark] = {
            channel: Percent(nominal=None, base_refit=before.get(channel), with_effects=value, noise_floor=None)
            for channel, value in after.items()
            if np.isfinite(value)
        }
    return table
