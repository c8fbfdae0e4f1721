"""What happens between the demanded torque and the torque on the body: every slot of the kind `actuator`.

Order along the signal: delay, dead zone (1), limits (2), ripple and gain (3), bias and cogging (4), lag.

Rules of this file: one function an effect; its equation stands above the line that computes it. Sizes are the hoop's
and follow the plant's limit.
"""

from __future__ import annotations

from math import inf
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import NO_LIMIT, Effect, EffectParameter, geometric, phase
from hoopd.plants.effects.usual_sizes import (
    force_scale,
    named,
    of_kind,
    scaled,
    speed_scale,
    time_scale,
    turns,
    units,
)

# Harmonics of a turn that a motor's poles and slots may make; the first is the imbalance of what it turns.
COGGING_HARMONICS = tuple(float(n) for n in range(2, 37))
RIPPLE_HARMONICS = tuple(float(n) for n in range(1, 37))
# Of a dead zone, the demand within which its inverse rises to the whole of it.
JUMP_SHARE = 0.5
# A harmonic is followed at 2 ms: 36 a turn at 20 rad/s are 1.4 rad a step, a Runge-Kutta error of 0.2 %; fewer a turn
# where they are known (`plants.free_run`) in so much longer steps.
HARMONIC_SUBSTEPS = 10
# A torque that switches within a substep enters by its mean: that moves an angle by 4e-5 rad at 2.5 ms, 2e-4 at 5 ms.
SWITCH_SUBSTEPS = 8

# Where no limit is known, the largest saturation that is searched, in usual sizes of the input.
NO_KNOWN_LIMIT = 10.0
# Of the drive's limit, what a demand leaves at least where it is asked which speed would touch it.
LEAST_LEFT = 1e-3


def effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of every actuator."""
    return tuple(effect for name, slot in of_kind(plant, "actuator") for effect in _of_slot(plant, name, slot))


def _of_slot(plant: Plant, name: str, slot: Any) -> tuple[Effect, ...]:
    every = (
        _gain(name, moves=slot.coordinate in plant.coordinates, free=slot.free_gain),
        _bias(plant, name),
        _deadzone(plant, name),
        _saturation(plant, name),
        _lag(plant, name),
        _delay(plant, name),
        *((_lost_commands(name),) if plant.driven is not None else ()),
    )
    angle = (_cogging(plant, name, slot.coordinate), _ripple(name, slot.coordinate))
    brakes = plant.limit < inf and slot.coordinate in plant.coordinates
    return (
        *every,
        *(angle if turns(plant, slot.coordinate) else ()),
        *((_back_emf(plant, name, slot.coordinate, speed_scale(slot)),) if brakes else ()),
    )


def _lost_commands(slot: str) -> Effect:
    return Effect(
        f"{slot}.lost_commands",
        (EffectParameter("share", "-", 0.0, 0.0, 1.0, grid=(0.02,)),),
        found_by="quality",
        depends_on=("u",),
        formula="a share of the demands is not heard, and the one before stays",
        statement="a share of the demands is not heard, and the one before stays for a sample more",
        signature="single impulses where the demand changes, as large as the change",
        sign="0 <= share <= 1",
        best_experiment="a two-level demand that changes often",
        write_back="nothing to write back: mend the line between the demand and the drive",
    )


def _gain(slot: str, *, moves: bool, free: bool) -> Effect:
    """`moves`: it drives a coordinate; `free`: the plant has a parameter for it."""
    return Effect(
        f"{slot}.torque_gain",
        (EffectParameter("k", "-", 1.0, 0.2, 3.0, grid=(0.1,)),),
        # tau = k u
        torque=lambda s, e: e.k * s.u,
        undo=lambda s, e: s.u / e.k,
        order=3,
        found_by="base" if free else "screen",
        as_parameters=True,
        depends_on=("u",),
        formula="k u",
        statement="the drive gives k times the torque that is demanded",
        signature="every response to the torque is larger or smaller by one factor",
        sign="k > 0",
        best_experiment=(
            "a known added mass or weight on the driven body, then the same signal twice"
            if moves
            else "what the drive gives, measured by an instrument of its own"
        ),
        write_back="demand the torque divided by k",
    )


def _bias(plant: Plant, slot: str) -> Effect:
    size = force_scale(plant)
    return Effect(
        f"{slot}.torque_bias",
        (EffectParameter("b", plant.force_unit, 0.0, -0.1 * size, 0.1 * size, grid=(0.005 * size,)),),
        # tau = u + b
        torque=lambda s, e: s.u + e.b,
        undo=lambda s, e: s.u - e.b,
        order=4,
        formula="u + b",
        statement="the drive adds a constant torque to what is demanded",
        signature="a constant missing force on the driven body, also at zero demand",
        sign="either",
        best_experiment="zero demand from rest in both directions, then slow steps of both signs",
        write_back="subtract b from the demanded torque",
    )


def _deadzone(plant: Plant, slot: str) -> Effect:
    size = force_scale(plant)
    grid = scaled(geometric(0.005, 0.06, 8), size)
    return Effect(
        f"{slot}.deadzone",
        (EffectParameter("d", plant.force_unit, 0.0, 0.0, 0.1 * size, "shape", grid),),
        # tau = u - d sign(u), 0 for |u| < d
        torque=lambda s, e: s.u - ca.fmin(ca.fmax(s.u, -e.d), e.d),
        # the jump of the inverse at zero as a slope: a law's noise must not become a rattle of +-d
        undo=lambda s, e: s.u + ca.fmin(ca.fmax(s.u / JUMP_SHARE, -e.d), e.d),
        order=1,
        depends_on=("u",),
        near=(f"{slot}.saturation", f"{slot}.torque_gain"),
        formula="u - d sign(u), 0 for |u| < d",
        statement="small demanded torques do nothing, larger ones are smaller by d",
        signature="the missing force is -u for small u and a constant against u for large u",
        sign="d >= 0",
        best_experiment="a slow triangle of torque through zero, or steps of several sizes",
        write_back="add d in the direction of the demanded torque",
    )


def _saturation(plant: Plant, slot: str) -> Effect:
    size = force_scale(plant)
    grid = scaled((*geometric(0.02, 0.5, 12), 0.6, 0.69), size)
    return Effect(
        f"{slot}.saturation",
        (
            EffectParameter(
                "s",
                plant.force_unit,
                NO_LIMIT,
                0.01 * size,
                plant.limit if plant.limit < inf else NO_KNOWN_LIMIT * plant.usual_input,
                "shape",
                grid,
                touched=lambda s: ca.fabs(s.u),
                # a drive gives no more than its limit
                most=plant.limit,
            ),
        ),
        # |tau| <= s
        torque=lambda s, e: ca.fmin(ca.fmax(s.u, -e.s), e.s),
        order=2,
        depends_on=("u",),
        near=(f"{slot}.deadzone", f"{slot}.torque_gain", f"{slot}.back_emf_limit"),
        formula="u, at most s: |tau| <= s",
        statement="the drive gives no more than s, less than its nominal limit",
        signature="the missing force is zero for small u and grows against u beyond a size of u",
        sign="0 < s below the nominal limit",
        best_experiment="steps of several sizes up to the limit",
        write_back="give the controller s as its torque limit",
    )


def _lag(plant: Plant, slot: str) -> Effect:
    by = time_scale(plant)
    return Effect(
        f"{slot}.lag",
        (EffectParameter("T", "s", 0.0, 0.0, 0.3 * by, "shape", scaled(geometric(0.005, 0.1, 8), by)),),
        # T tau' = u - tau
        lag="T",
        depends_on=("u",),
        near=(f"{slot}.delay",),
        formula="T tau' = u - tau",
        statement="the torque follows the demand with a time constant T",
        signature="a missing force against each change of u that dies away within T",
        sign="T >= 0",
        best_experiment="fast two-level input or a chirp up to the highest frequency",
        write_back="a torque state in the estimator; the controller leads by T",
    )


def _delay(plant: Plant, slot: str) -> Effect:
    by = time_scale(plant)
    return Effect(
        f"{slot}.delay",
        (EffectParameter("d", "s", 0.0, 0.0, 0.2 * by, "shape", scaled(geometric(0.002, 0.08, 9), by)),),
        # tau(t) = u(t - d)
        delay="d",
        substeps=SWITCH_SUBSTEPS,
        depends_on=("u",),
        near=(f"{slot}.lag",),
        formula="u(t - d)",
        statement="the torque comes d seconds after its demand",
        signature="a missing force against each change of u for d seconds",
        sign="d >= 0",
        best_experiment="fast two-level input, in the open loop",
        write_back="the estimator predicts over d with the torques that are on their way",
    )


def _cogging(plant: Plant, slot: str, q: str) -> Effect:
    size = force_scale(plant)
    return Effect(
        f"{slot}.cogging",
        (
            EffectParameter("A", plant.force_unit, 0.0, 0.0, 0.1 * size, grid=(0.005 * size,)),
            EffectParameter("n", "-", 2.0, 2.0, 36.0, "shape", COGGING_HARMONICS, discrete=True),
            phase(per_recording=True),
        ),
        # tau += A sin(n theta + phi)
        torque=lambda s, e: s.u + e.A * ca.sin(e.n * getattr(s, q) + e.phi),
        undo=lambda s, e: s.u - e.A * ca.sin(e.n * getattr(s, q) + e.phi),
        order=4,
        substeps=HARMONIC_SUBSTEPS,
        depends_on=(q,),
        near=named(plant, "body", "imbalance", q),
        formula=f"u + A sin(n {q} + phi)",
        statement="a torque that comes back n times a turn",
        signature="the missing force is a sine of n times the angle, whatever the demand",
        sign="A >= 0, the phase takes the sign; n = 1 is the imbalance",
        best_experiment="slow turns at two speeds in both directions",
        write_back="subtract A sin(n theta + phi) from the demand; phi belongs to the encoder's zero",
    )


def _ripple(slot: str, q: str) -> Effect:
    return Effect(
        f"{slot}.ripple",
        (
            # a < 1: the gain keeps its sign all round
            EffectParameter("a", "-", 0.0, 0.0, 0.9, grid=(0.05,), most=0.9),
            EffectParameter("n", "-", 1.0, 1.0, 36.0, "shape", RIPPLE_HARMONICS, discrete=True),
            phase(per_recording=True),
        ),
        # tau = u (1 + a sin(n theta + phi))
        torque=lambda s, e: s.u * (1 + e.a * ca.sin(e.n * getattr(s, q) + e.phi)),
        undo=lambda s, e: s.u / (1 + e.a * ca.sin(e.n * getattr(s, q) + e.phi)),
        order=3,
        substeps=HARMONIC_SUBSTEPS,
        depends_on=("u", q),
        near=(f"{slot}.cogging",),
        formula=f"u (1 + a sin(n {q} + phi))",
        statement="the drive's gain comes and goes n times a turn",
        signature="the missing force is the demand times a sine of n times the angle",
        sign="0 <= a < 1, the phase takes the sign",
        best_experiment="slow turns under two sizes of torque in both directions",
        write_back="divide the demand by 1 + a sin(n theta + phi); phi belongs to the encoder's zero",
    )


def _back_emf(plant: Plant, slot: str, q: str, speed: float) -> Effect:
    def limited(s: Any, e: Any) -> Any:
        # |tau| <= max(0, limit (1 - |theta'| / w0)), in all quadrants
        most = ca.fmax(0.0, plant.limit * (1 - ca.fabs(getattr(s, f"d{q}")) / e.w0))
        return ca.fmin(ca.fmax(s.u, -most), most)

    def touched(s: Any) -> Any:
        # |u| = limit (1 - |theta'| / w0)
        return ca.fabs(getattr(s, f"d{q}")) / ca.fmax(1 - ca.fabs(s.u) / plant.limit, LEAST_LEFT)

    grid = scaled(geometric(8.0, 80.0, 8), speed)
    w0 = EffectParameter(
        "w0", units(plant, q).rate, NO_LIMIT, 5.0 * speed, 200.0 * speed, "shape", grid, touched=touched
    )
    return Effect(
        f"{slot}.back_emf_limit",
        (w0,),
        torque=limited,
        order=2,
        substeps=SWITCH_SUBSTEPS,
        depends_on=("u", f"d{q}"),
        near=(f"{slot}.saturation",),
        formula=f"|tau| <= max(0, {plant.limit:g} (1 - |{q}'|/w0))",
        statement="the faster the motor turns, the less torque it can give: none at w0",
        signature="the missing force is against u, only where both torque and speed are high",
        sign="w0 > 0",
        best_experiment="large torques at high speed in both directions",
        write_back="give the controller the limit that falls with speed",
    )
