"""What an encoder, or any other sensor that is no camera, adds to its readings: slots of the kind `sensor`.

Rules of this file: one function an effect; its equation stands above the line that computes it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter, Point, Values, geometric, phase
from hoopd.plants.effects.image_sensor import latency
from hoopd.plants.effects.usual_sizes import named, of_kind, scaled, time_scale, units

# A disc that is no circle, poles and gaps of a magnetic scale, the gain and phase of its two tracks.
UNEVEN_HARMONICS = tuple(float(n) for n in range(2, 13))


def effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of every sensor but the cameras."""
    return tuple(
        effect
        for name, slot in of_kind(plant, "sensor")
        if slot.device != "camera"
        for effect in _of_slot(plant, name, slot)
    )


def _of_slot(plant: Plant, name: str, slot: Slot) -> tuple[Effect, ...]:
    q = slot.coordinate
    angles = tuple(c for c in slot.channels if plant.state_of(c) == q)
    rates = tuple(c for c in slot.channels if plant.state_of(c) == f"d{q}")
    found = []
    if slot.turns and angles:
        found += [_eccentricity(name, q, angles, rates), _harmonic(plant, name, q, angles, rates)]
    found.append(latency(plant, name, slot))
    if rates:
        found.append(_speed_lag(plant, name, rates))
    if angles and not slot.turns:
        found.append(_offset(name, angles, units(plant, q).coordinate, plant.scales.get(q, 1.0)))
    elif not q and slot.channels:  # of a level, a temperature
        channel = plant.channels[slot.channels[0]]
        found.append(_offset(name, slot.channels, channel.unit, plant.scales.get(channel.state, 1.0)))
        if channel.state:
            found.append(_scale(name, slot.channels[0], channel.state))
        if states := tuple(c for c in slot.channels if plant.state_of(c)):
            found.append(_lag(plant, name, states))
    return tuple(found)


def _eccentricity(name: str, q: str, angles: tuple[str, ...], rates: tuple[str, ...]) -> Effect:
    def seen(s: Point, e: Values) -> dict[str, Any]:
        angle = getattr(s, q) + e.phi
        # theta + a sin(theta + phi);  of the rate its derivative, theta' (1 + a cos(theta + phi)), or nothing
        by_angle, by_rate = e.a * ca.sin(angle), e.a * ca.cos(angle) * getattr(s, f"d{q}")
        seen_rate = e.follows * by_rate if rates else 0.0
        return {**dict.fromkeys(angles, by_angle), **dict.fromkeys(rates, seen_rate)}

    follows = EffectParameter("follows", "-", 0.0, 0.0, 1.0, "shape", (0.0, 1.0), discrete=True)
    return Effect(
        f"{name}.eccentricity",
        (
            # a < 1: the reading never runs backwards
            EffectParameter("a", "rad", 0.0, 0.0, 0.5, grid=(0.02,), most=0.9),
            phase(per_recording=True),
            *((follows,) if rates else ()),
        ),
        sensor=seen,
        depends_on=(q,),
        formula=f"{q} + a sin({q} + phi)",
        statement="its disc sits off the axis: the angle is wrong by a sine once a turn",
        signature="the angle's error is a sine of the angle; the measured rate follows it (follows = 1) or not (0)",
        sign="a >= 0, the phase takes the sign",
        best_experiment="whole turns at constant speed",
        write_back="subtract a sin(theta + phi) from the reading; phi belongs to the encoder's zero",
    )


def _harmonic(plant: Plant, name: str, q: str, angles: tuple[str, ...], rates: tuple[str, ...]) -> Effect:
    def seen(s: Point, e: Values) -> dict[str, Any]:
        angle = e.n * getattr(s, q) + e.phi
        # theta + a sin(n theta + phi);  of the rate its derivative, theta' (1 + n a cos(n theta + phi)), or nothing
        by_angle, by_rate = e.a * ca.sin(angle), e.n * e.a * ca.cos(angle) * getattr(s, f"d{q}")
        seen_rate = e.follows * by_rate if rates else 0.0
        return {**dict.fromkeys(angles, by_angle), **dict.fromkeys(rates, seen_rate)}

    follows = EffectParameter("follows", "-", 0.0, 0.0, 1.0, "shape", (0.0, 1.0), discrete=True)
    return Effect(
        f"{name}.harmonic",
        (
            EffectParameter("a", "rad", 0.0, 0.0, 0.2, grid=(0.01,)),
            EffectParameter("n", "-", 2.0, 2.0, max(UNEVEN_HARMONICS), "shape", UNEVEN_HARMONICS, discrete=True),
            phase(per_recording=True),
            *((follows,) if rates else ()),
        ),
        sensor=seen,
        depends_on=(q,),
        near=(f"{name}.eccentricity", *named(plant, "actuator", "cogging", q)),
        formula=f"{q} + a sin(n {q} + phi)",
        statement="its scale is uneven: the angle is wrong by a sine n times a turn",
        signature="the rate of the angle ripples n times a turn, in proportion to the speed",
        sign="a >= 0, the phase takes the sign; n = 1 is the eccentricity",
        best_experiment="whole turns at several constant speeds: a torque's ripple falls with speed, this one grows",
        write_back="subtract a sin(n theta + phi) from the reading; phi belongs to the encoder's zero",
    )


def _speed_lag(plant: Plant, name: str, rates: tuple[str, ...]) -> Effect:
    return replace(
        _slow(plant, f"{name}.speed_lag", name, rates, 0.5, geometric(0.005, 0.15, 8)),
        formula=f"T m' = {rates[0]} - m",
        statement="the measured rate is low-passed with a time constant T",
        signature="the measured rate is behind the derivative of the measured angle",
        best_experiment="fast two-level input",
        write_back="the estimator takes the angle, or carries the filter as a state",
    )


def _lag(plant: Plant, name: str, channels: tuple[str, ...]) -> Effect:
    made = _slow(plant, f"{name}.lag", name, channels, 40.0, geometric(0.005, 20.0, 14))
    return replace(
        made,
        near=(*made.near, *(f"{slot}.lag" for slot, _ in of_kind(plant, "actuator"))),
        formula="T m' = x - m",
        statement="it follows what it measures with a time constant T",
        signature="the reading is behind, and its fast changes are smaller",
        best_experiment="steps of the input",
        write_back="the estimator carries the sensor as a state",
    )


def _slow(
    plant: Plant, law: str, name: str, channels: tuple[str, ...], most: float, tried: tuple[float, ...]
) -> Effect:
    """Channels behind a low pass; `most`, `tried`: time constants, s of a plant that is sampled as the hoop is."""
    by = time_scale(plant)
    return Effect(
        law,
        (EffectParameter("T", "s", 0.0, 0.0, most * by, "shape", scaled(tried, by)),),
        # T m' = x - m
        sensor_lag=dict.fromkeys(channels, "T"),
        depends_on=("t",),
        near=(f"{name}.latency",),
        sign="T >= 0",
    )


def _scale(name: str, channel: str, state: str) -> Effect:
    return Effect(
        f"{name}.scale",
        (EffectParameter("a", "-", 0.0, -0.5, 1.0, grid=(0.02,), least=-0.95),),
        # x (1 + a)
        sensor=lambda s, e: {channel: e.a * getattr(s, state)},
        depends_on=(state,),
        near=(f"{name}.offset",),
        formula=f"{channel} (1 + a)",
        statement="the sensor shows 1 + a times what there is",
        signature="the reading's error is proportional to what is read",
        sign="a > -1",
        best_experiment="rest at two known contents",
        write_back="divide the reading by 1 + a",
    )


def _offset(name: str, readings: tuple[str, ...], unit: str, size: float) -> Effect:
    return Effect(
        f"{name}.offset",
        (EffectParameter("d", unit, 0.0, -1.0 * size, 1.0 * size, grid=(0.01 * size,)),),
        # q + d
        sensor=lambda s, e: dict.fromkeys(readings, e.d),
        formula=f"{readings[0]} + d",
        statement="the sensor's zero is wrong by d",
        signature="rest is read at d where forces depend on the position",
        sign="either",
        best_experiment="rest at a known position",
        write_back="calibrate the sensor's zero by d",
    )
