"""One free run over every whole stretch: nominal, base and found effects, each with the parameters that simulate best.

Rules of this file: base and effects are refined in the same way on the same data; what is held out gets a start and
what belongs to its recording alone, nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoopd.diagnose.proof.fit_tables import noise_floor, nrmse
from hoopd.diagnose.proof.free_run_refinement import Refined, refine
from hoopd.diagnose.proof.simulation import Simulated
from hoopd.diagnose.record import Fit as Percent, Fits
from hoopd.diagnose.search.candidates import free_of_recordings
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.likelihood.stretches import Stretch

HELD_OUT = "(held out)"


def free_runs(
    nominal: HypothesisFit, base: HypothesisFit, final: HypothesisFit, heldout: Sequence[Stretch] = ()
) -> Fits:
    """Percent by recording and channel; of what is held out under `NAME (held out)`, its parameters frozen."""
    given = refined(nominal, free=())
    again = refined(base)
    found = again if final is base else refined(final)
    each = {"nominal": (given, nominal), "base": (again, base), "final": (found, final)}
    table = _percents({name: one.runs for name, (one, _) in each.items()}, final, "")
    if heldout:
        runs = {name: frozen(one, about, heldout).runs for name, (one, about) in each.items()}
        table |= _percents(runs, final, f" {HELD_OUT}")
    return table


def refined(found: HypothesisFit, free: Sequence[str] | None = None) -> Refined:
    """The fit's hypothesis with the parameters that simulate its stretches best.

    A long run leads the angle away from the measured one, and with it the phase of whatever follows the angle: once
    more with those effects held where they vanish, the better one counts.
    """
    stretches, free = [track.stretch for track in found.tracks], found.free if free is None else tuple(free)
    references = [track.z for track in found.tracks]
    best = refine(stretches, references, found.effects, found.values, free)
    waves = [e for e in found.effects if any(p.role == "phase" for p in e.parameters)]
    if not free or not waves:
        return best
    own = tuple(f"{e.name}." for e in waves)
    vanished = {e.key(p.name): p.neutral for e in waves for p in e.parameters if p.role == "amplitude"}
    rest = [name for name in free if not name.startswith(own)]
    other = refine(stretches, references, found.effects, {**found.values, **vanished}, rest)
    return min(best, other, key=lambda one: one.cost)


def frozen(found: Refined, about: HypothesisFit, stretches: Sequence[Stretch]) -> Refined:
    """The same parameters on other stretches: only starts, and phases of a recording that is new, are fitted."""
    known = {track.stretch.recording for track in about.tracks}
    own = [n for n in free_of_recordings(about.effects, stretches) if n.split("@", 1)[1] not in known]
    values = {**found.values, **{name: found.values.get(name.split("@")[0], 0.0) for name in own}}
    references = [Track(one).z for one in stretches]
    return refine(stretches, references, about.effects, values, own)


def _percents(runs: dict[str, list[Simulated]], final: HypothesisFit, mark: str) -> Fits:
    table: Fits = {}
    for recording in dict.fromkeys(run.windows.stretch.recording for run in runs["final"]):
        own = {n: [run for run in each if run.windows.stretch.recording == recording] for n, each in runs.items()}
        figures = {name: nrmse(each) for name, each in own.items()}
        floor = noise_floor(own["final"], final.noise) if recording in final.noise else {}
        table[recording + mark] = {
            channel: Percent(
                nominal=figures["nominal"].get(channel), base_refit=figures["base"].get(channel),
                with_effects=figures["final"].get(channel), noise_floor=floor.get(channel),
            )
            for channel in figures["final"]
            if np.isfinite(figures["final"][channel])
        }  # fmt: skip
    return table
