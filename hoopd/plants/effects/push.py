"""Whoever pushes from outside: slots of the kind `push`.

Rules of this file: one function an effect; its equation stands above the line that computes it.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter, Point, Values
from hoopd.plants.effects.usual_sizes import force_scale, of_kind, time_scale, units

# The edges of a pulse are ramps of this length (s, at the usual 20 ms) around t0 and t1: an integration step sees them,
# a fit moves them. Steps of 5 ms see both of its ends.
EDGE_S, SUBSTEPS = 0.010, 4
# No recording is longer, s at the usual 20 ms: half a million samples.
LATEST_S = 1e4


def effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of every push."""
    return tuple(_disturbance(plant, name, slot) for name, slot in of_kind(plant, "push"))


def _edge(t: Any, length_s: float) -> Any:
    return ca.fmin(ca.fmax(t / length_s + 0.5, 0.0), 1.0)


def _disturbance(plant: Plant, name: str, slot: Slot) -> Effect:
    size, edge = force_scale(plant), EDGE_S * time_scale(plant)
    latest = LATEST_S * time_scale(plant)

    def pulse(s: Point, e: Values) -> dict[str, Any]:
        # A between t0 and t1
        return {slot.coordinate: e.A * (_edge(s.t - e.t0, edge) - _edge(s.t - e.t1, edge))}

    return Effect(
        f"{name}.disturbance",
        (
            EffectParameter("t0", "s", 0.0, 0.0, latest, "shape", per_recording=True),
            EffectParameter("t1", "s", 0.0, 0.0, latest, "shape", per_recording=True),
            EffectParameter(
                "A", units(plant, slot.coordinate).force, 0.0, -1.0 * size, 1.0 * size, grid=(0.01 * size,)
            ),
        ),
        force=pulse,
        substeps=SUBSTEPS,
        found_by="scan",
        depends_on=("t",),
        formula="A for t0 <= t <= t1",
        statement="somebody or something pushed for a while",
        signature="the missing force is there between two times only",
        sign="either; t from each recording's start, t1 >= t0",
        best_experiment="the same signal again: a push does not come back",
        write_back="nothing to write back: set the time aside",
    )
