"""Where the plant nears the end of the mode that its equations describe: a ball whose hoop hardly presses on it.

There the equations hold no more (it slips, or flies), whatever the parameters; what a fit makes of it is no physics of
the mode. A plant tells how far inside the mode a state is (`MotionMode.guard`); plants without a guard never leave it.

Rules of this file: it reads a fit; what is done with an interval is in `search.excluded_intervals`.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from hoopd.diagnose.quality.excluded_stretches import leaving_enough
from hoopd.diagnose.quality.unusual_energy import merged
from hoopd.diagnose.quality.unusual_intervals import MODE, Interval, UnusualSignal
from hoopd.plants.declaration import MotionMode, Plant
from hoopd.plants.likelihood.fitting import HypothesisFit
from hoopd.plants.likelihood.reference_track import Track
from hoopd.plants.scales import motion_scale

Array = NDArray[np.float64]

# Of the guard's usual size. Whether a ball that is pressed on with less than a tenth of its weight still rolls, forces
# decide that are not in the equations: a joint of the hoop, its bearing's vibration.
LEAST_MARGIN = 0.1
# Once the mode has ended it begins again with an impact, which no reading announces: a ball falls through its hoop
# within 0.2 s, and slips for a while.
LANDING_S = 0.3


def left_modes(fit: HypothesisFit) -> tuple[list[Interval], list[str]]:
    """Intervals in which a mode nears its end, as the fit's smoothed states go, and sentences for what stays in.

    A recording of which too little would be left keeps all of it, and is told of.
    """
    if any(effect.flight is not None for effect in fit.effects):
        return [], []  # the hypothesis has the next mode, too
    found = [one for track in fit.tracks for one in _of_track(track, fit)]
    out = leaving_enough([track.stretch for track in fit.tracks], found)
    kept = {one.recording: one for one in found if one not in out}
    return out, [_sentence(one, [each for each in found if each.recording == name]) for name, one in kept.items()]


def _of_track(track: Track, fit: HypothesisFit) -> list[Interval]:
    """Of one stretch, every mode with a guard."""
    stretch, values = track.stretch, track.local(fit.values)
    found = []
    for mode in stretch.plant.modes:
        if mode.guard is None:
            continue
        margins = _margins(stretch.plant, mode, track.z[:, : len(stretch.plant.states)], values, stretch.t)
        near = stretch.t[margins < LEAST_MARGIN]
        for t0, t1 in merged([(t, t) for t in near], motion_scale(stretch.plant)):
            least = float(margins[(stretch.t >= t0) & (stretch.t <= t1)].min())
            end = t1 + (LANDING_S * motion_scale(stretch.plant) if least <= 0.0 else 0.0)
            found.append(Interval(stretch.recording, t0, end, (UnusualSignal(mode.name, MODE, least, LEAST_MARGIN),)))
    return found


def _margins(plant: Plant, mode: MotionMode, x: Array, values: dict[str, float], t: Array) -> Array:
    """(n,) of the guard along states x (n, nx)."""
    p = np.array([values[name] for name in plant.values])
    found = _guard(plant, mode).map(len(t))(x.T, p, t)
    return np.asarray(found).ravel()


def _guard(plant: Plant, mode: MotionMode) -> ca.Function:
    x, p, t = ca.SX.sym("x", len(plant.states)), ca.SX.sym("p", len(plant.values)), ca.SX.sym("t")
    named = {name: p[i] for i, name in enumerate(plant.values)}
    assert mode.guard is not None
    return ca.Function("guard", [x, p, t], [mode.guard(plant.reading_point(x, named, t))])


def _sentence(one: Interval, every: Sequence[Interval]) -> str:
    seconds = sum(each.t1 - each.t0 for each in every)
    return (
        f"{one.recording}: for {seconds:.2g} s {one.where} nears its end; too little would be left without them, so"
        " they count: what is found may be the end of that motion, no physics of it"
    )
