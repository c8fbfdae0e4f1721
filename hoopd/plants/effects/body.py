"""Forces on a driven or free body: every slot of the kind `body` (the hoop's is called `hoop`).

Rules of this file: one function an effect; its equation stands above the line that computes it. Sizes are the hoop's
and follow the plant's limit and the slot's usual rate.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import DryFriction, Effect, EffectParameter, geometric, phase
from hoopd.plants.effects.usual_sizes import force_scale, named, of_kind, scaled, speed_scale, time_scale, units

# The curve is steep near rest: at 2 ms a run of 4 s misses the converged angle by 8e-4 rad, at 4 ms by 2e-3.
STRIBECK_SUBSTEPS = 10


def effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of every body."""
    return tuple(effect for name, slot in of_kind(plant, "body") for effect in _of_slot(plant, name, slot))


def _of_slot(plant: Plant, name: str, slot: Slot) -> tuple[Effect, ...]:
    found = [_coulomb(plant, name, slot), _stribeck(plant, name, slot), _drag(plant, name, slot)]
    if slot.turns:
        found.append(_imbalance(plant, name, slot))
    if slot.viscous is not None:
        found.append(_friction_drift(plant, name, slot))
    return tuple(found)


def _coulomb(plant: Plant, name: str, slot: Slot) -> Effect:
    q, size = slot.coordinate, force_scale(plant)
    return Effect(
        f"{name}.coulomb_friction",
        (EffectParameter("Fc", units(plant, slot.coordinate).force, 0.0, 0.0, 0.1 * size, grid=(0.003 * size,)),),
        # -Fc sign(theta'), |f| <= Fc at rest
        friction=DryFriction(lambda s, e: e.Fc, lambda s: {q: 1.0}),
        depends_on=(f"d{q}",),
        near=(f"{name}.stribeck_friction", f"{name}.quadratic_drag"),
        formula=f"-Fc sign({q}')",
        statement="dry friction: a constant force against the motion, which holds it at rest",
        signature="the missing force jumps with the sign of the rate; small forces do not move it",
        sign="Fc >= 0: it takes energy away",
        best_experiment="coast down from speed, reversals, slow ramps through rest",
        write_back="feed forward Fc in the direction of motion; the estimator knows the friction",
    )


def _stribeck(plant: Plant, name: str, slot: Slot) -> Effect:
    q, size, speed = slot.coordinate, force_scale(plant), speed_scale(slot)
    unit = units(plant, slot.coordinate)

    def level(s: Any, e: Any) -> Any:
        # Fc + Fs exp(-(theta'/vs)^2)
        return e.Fc + e.Fs * ca.exp(-((getattr(s, f"d{q}") / e.vs) ** 2))

    return Effect(
        f"{name}.stribeck_friction",
        (
            EffectParameter("Fc", unit.force, 0.0, 0.0, 0.1 * size, grid=(0.003 * size,)),
            EffectParameter("Fs", unit.force, 0.0, 0.0, 0.1 * size, grid=(0.003 * size,)),
            EffectParameter(
                "vs", unit.rate, 1.0 * speed, 0.1 * speed, 10.0 * speed, "shape", scaled(geometric(0.3, 5.0, 7), speed)
            ),
        ),
        friction=DryFriction(level, lambda s: {q: 1.0}),
        substeps=STRIBECK_SUBSTEPS,
        depends_on=(f"d{q}",),
        contains=(f"{name}.coulomb_friction",),
        near=(f"{name}.coulomb_friction",),
        formula=f"-(Fc + Fs exp(-({q}'/vs)^2)) sign({q}')",
        statement="dry friction that is larger near rest and falls to Fc beyond the rate vs",
        signature="the missing force jumps with the sign of the rate and is largest at small rates",
        sign="Fc >= 0, Fs >= 0: it takes energy away",
        best_experiment="slow ramps through rest, breakaway, coast down to rest",
        write_back="feed forward the curve in the direction of motion; the estimator knows the friction",
    )


def _drag(plant: Plant, name: str, slot: Slot) -> Effect:
    q, size = slot.coordinate, force_scale(plant) / speed_scale(slot) ** 2
    return Effect(
        f"{name}.quadratic_drag",
        (EffectParameter("c", units(plant, slot.coordinate).drag, 0.0, 0.0, 1e-3 * size, grid=(2e-5 * size,)),),
        # -c theta' |theta'|
        force=lambda s, e: {q: -e.c * getattr(s, f"d{q}") * ca.fabs(getattr(s, f"d{q}"))},
        depends_on=(f"d{q}",),
        near=(f"{name}.coulomb_friction",),
        formula=f"-c {q}' |{q}'|",
        statement="drag that grows with the square of the rate",
        signature="the missing force is against the rate and grows with its square",
        sign="c >= 0: it takes energy away",
        best_experiment="coast down from the highest speed",
        write_back="feed forward c theta' |theta'|; the estimator knows the drag",
    )


def _imbalance(plant: Plant, name: str, slot: Slot) -> Effect:
    q, size = slot.coordinate, force_scale(plant)
    return Effect(
        f"{name}.imbalance",
        (
            EffectParameter("A", units(plant, slot.coordinate).force, 0.0, 0.0, 0.1 * size, grid=(0.005 * size,)),
            phase(per_recording=True),
        ),
        # -A sin(theta + phi)
        force=lambda s, e: {q: -e.A * ca.sin(getattr(s, q) + e.phi)},
        depends_on=(q,),
        near=named(plant, "actuator", "cogging", q),
        formula=f"-A sin({q} + phi)",
        statement="its centre of mass is off the axis: gravity turns it once a turn",
        signature="the missing force is a sine of the angle, once a turn, whatever the demand",
        sign="A >= 0, the phase takes the sign",
        best_experiment="slow turns in both directions, or a free swing from rest at several angles",
        write_back="feed forward A sin(theta + phi); phi belongs to the encoder's zero",
    )


def _friction_drift(plant: Plant, name: str, slot: Slot) -> Effect:
    q, viscous, by = slot.coordinate, slot.viscous, time_scale(plant)

    def drag(s: Any, e: Any) -> dict[str, Any]:
        assert viscous is not None
        # viscous coefficient bh (1 + a (1 - exp(-t/T)))
        return {q: -viscous(s) * e.a * (1 - ca.exp(-s.t / e.T)) * getattr(s, f"d{q}")}

    return Effect(
        f"{name}.friction_drift",
        (
            # a > -1: what is left of the friction is one
            EffectParameter("a", "-", 0.0, -0.95, 5.0, grid=(0.3,), least=-0.95),
            EffectParameter("T", "s", 10.0 * by, 0.5 * by, 200.0 * by, "shape", scaled(geometric(2.0, 60.0, 7), by)),
        ),
        force=drag,
        depends_on=(f"d{q}", "t"),
        near=(f"{name}.coulomb_friction",),
        formula=f"-b a (1 - exp(-t/T)) {q}', b the viscous friction",
        statement="its viscous friction changes over the recording, as a bearing does that warms up",
        signature="the missing force is proportional to the rate with a factor that drifts in time",
        sign="a > -1: the friction stays a friction; t from each recording's start",
        best_experiment="a long run with the same signal again and again",
        write_back="let it warm up before a run, or re-estimate the viscous friction afterwards",
    )
