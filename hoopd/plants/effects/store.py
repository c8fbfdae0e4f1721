"""What a store loses or holds otherwise than its equation says: slots of the kind `store`, one first-order state each.

A store is a tank with its level, a capacitor with its voltage, a coil with its current, a body with its temperature:
what flows in and out changes its content. The same law has the name of its field: by the state's unit.

Rules of this file: one function an effect; its equation stands above the line that computes it. Sizes follow the
state's usual size and the rate of its equation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant, Slot
from hoopd.plants.effects.base import Effect, EffectParameter, geometric
from hoopd.plants.effects.usual_sizes import of_kind, scaled, store_rate

# Fields by the unit of a state; any other is a store of something else (heat).
LIQUID, CURRENT, VOLTAGE, OTHER = "liquid", "current", "voltage", "other"
FIELDS: Mapping[str, str] = {
    **dict.fromkeys(("m", "cm", "mm", "m3", "l", "Pa", "kPa", "bar"), LIQUID),
    **dict.fromkeys(("A", "mA"), CURRENT),
    **dict.fromkeys(("V", "mV", "C"), VOLTAGE),
}
# Of the usual size, a content at which the root's slope ends.
LEAST_SHARE = 1e-3


def effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of every store."""
    return tuple(effect for name, slot in of_kind(plant, "store") for effect in _of_slot(plant, name, slot))


def _of_slot(plant: Plant, name: str, slot: Slot) -> tuple[Effect, ...]:
    field = FIELDS.get(plant.units.get(slot.coordinate, ""), OTHER)
    found = [_loss(plant, name, slot, field), _constant(plant, name, slot, field)]
    if field == LIQUID:
        found += [_orifice(plant, name, slot), _above(plant, name, slot, "overflow"), _section(plant, name, slot)]
    if field == VOLTAGE:
        found.append(_above(plant, name, slot, "clamp"))
    if field == CURRENT:
        found.append(_saturation(plant, name, slot))
    return tuple(found)


def _sizes(plant: Plant, slot: Slot) -> tuple[str, str, float, float]:
    """State, its unit, its usual size and rate."""
    x = slot.coordinate
    return x, plant.units.get(x, "-"), plant.scales.get(x, 1.0), store_rate(plant, x)


LOSSES = {
    LIQUID: ("leak", "it leaks in proportion to its content, as through a narrow gap"),
    CURRENT: ("series_resistance", "a resistance more in series: k is that resistance over the inductance"),
    VOLTAGE: ("leakage", "a resistance more across it: 1/k is that resistance times the capacitance"),
    OTHER: ("leak", "it loses in proportion to its content"),
}


def _loss(plant: Plant, name: str, slot: Slot, field: str) -> Effect:
    x, _, size, rate = _sizes(plant, slot)
    own, statement = LOSSES[field]
    partner = {
        LIQUID: (f"{name}.orifice_leak", f"{name}.constant_flow"),
        VOLTAGE: _scales(plant, x, own=True),  # of a network whose resistance and coil are free
    }.get(field, ())
    return Effect(
        f"{name}.{own}",
        (EffectParameter("k", "1/s", 0.0, 0.0, 10.0 * rate / size, grid=(0.05 * rate / size,)),),
        # x' += -k x
        force=lambda s, e: {x: -e.k * getattr(s, x)},
        depends_on=(x,),
        near=partner,
        formula=f"-k {x}",
        statement=statement,
        signature="the missing rate is proportional to the content and takes from it, whatever the input",
        sign="k >= 0: it takes away",
        best_experiment="fill it, stop all inputs, and watch it fall over a wide range",
        write_back="add k times the content to what is fed in; the estimator knows the loss",
    )


CONSTANTS = {
    LIQUID: ("constant_flow", "a constant flow that nobody counts: evaporation, a drip, a feed"),
    CURRENT: ("constant_voltage", "a constant voltage in the loop: a diode, an offset of the source"),
    VOLTAGE: ("constant_current", "a constant current into it: a bias of what is connected"),
    OTHER: ("constant_flow", "a constant flow that nobody counts"),
}


def _constant(plant: Plant, name: str, slot: Slot, field: str) -> Effect:
    x, unit, _, rate = _sizes(plant, slot)
    own, statement = CONSTANTS[field]
    return Effect(
        f"{name}.{own}",
        (EffectParameter("c", f"{unit}/s", 0.0, -10.0 * rate, 10.0 * rate, grid=(0.05 * rate,)),),
        # x' += c
        force=lambda s, e: {x: e.c},
        depends_on=("t",),
        near=(f"{name}.{LOSSES[field][0]}", *_biases(plant)),
        formula="c",
        statement=statement,
        signature="the missing rate is one and the same, whatever content and input",
        sign="either: negative takes away",
        best_experiment="no input, at a high and at a low content",
        write_back="subtract c from what is fed in",
    )


def _biases(plant: Plant) -> tuple[str, ...]:
    """Of drives that feed first-order states: what is added to the demand is added to a rate."""
    return () if plant.driven else tuple(f"{name}.torque_bias" for name, _ in of_kind(plant, "actuator"))


def _orifice(plant: Plant, name: str, slot: Slot) -> Effect:
    x, unit, size, rate = _sizes(plant, slot)

    def flow(s: Any, e: Any) -> dict[str, Any]:
        # x' += -c sqrt(x), a straight line near an empty store
        level = getattr(s, x)
        return {x: -e.c * level / ca.sqrt(ca.fmax(ca.fabs(level), LEAST_SHARE * size))}

    return Effect(
        f"{name}.orifice_leak",
        (EffectParameter("c", f"sqrt({unit})/s", 0.0, 0.0, 10.0 * rate / size**0.5, grid=(0.05 * rate / size**0.5,)),),
        force=flow,
        depends_on=(x,),
        # a hole before a further tank looks like another scale of that tank's sensor
        near=(f"{name}.leak", f"{name}.constant_flow", *_scales(plant, x, own=False)),
        formula=f"-c sqrt({x})",
        statement="a hole near its bottom: what leaks grows with the root of the level",
        signature="the missing rate takes from the content and follows its root, whatever the input",
        sign="c >= 0: it takes away",
        best_experiment="fill it, stop all inputs, and watch it fall until it is nearly empty",
        write_back="add c times the root of the level to what is fed in; the estimator knows the hole",
    )


def _scales(plant: Plant, state: str, *, own: bool) -> tuple[str, ...]:
    """Scales of the sensors of this store, or of the others."""
    every = ((name, slot) for name, slot in of_kind(plant, "sensor") if slot.channels and slot.device != "camera")
    reads = ((name, plant.state_of(slot.channels[0])) for name, slot in every)
    return tuple(f"{name}.scale" for name, read in reads if read in plant.first_order and (read == state) == own)


def _above(plant: Plant, name: str, slot: Slot, own: str) -> Effect:
    x, unit, size, rate = _sizes(plant, slot)
    # what runs over in a usual sample time at most: faster is an end stop
    fastest = max(1.0 / plant.time_scale_s, rate / size)
    overflow = own == "overflow"
    return Effect(
        f"{name}.{own}",
        (
            EffectParameter("k", "1/s", 0.0, 0.0, fastest, grid=(rate / size,), most=fastest),
            EffectParameter(
                "x0", unit, size, 0.0, 100.0 * size, "shape", scaled(geometric(0.2, 5.0, 25), size),
                touched=lambda s: getattr(s, x),
            ),
        ),
        # x' += -k max(0, x - x0)
        force=lambda s, e: {x: -e.k * ca.fmax(0.0, getattr(s, x) - e.x0)},
        depends_on=(x,),
        # from an empty store on, x0 = 0
        contains=(f"{name}.{LOSSES[LIQUID if overflow else VOLTAGE][0]}",),
        formula=f"-k max(0, {x} - x0)",
        statement=("above the level x0 it runs over" if overflow else "above x0 a diode, or an arrester, clamps it"),
        signature="nothing is missing below x0; above, the missing rate takes away and grows from zero",
        sign="k >= 0: it takes away",
        best_experiment="slowly up beyond x0 and down again, twice",
        write_back="give the controller x0 as the limit of what it asks for",
    )  # fmt: skip


def _own_rate(plant: Plant, x: str, s: Any) -> Any:
    """What the plant's equation says of the state's rate, at one point or at a column of them."""
    every, index = plant.rates(s), plant.first_order.index(x)
    points = every.shape[0] // len(plant.first_order)
    return every[index * points : (index + 1) * points]


def _section(plant: Plant, name: str, slot: Slot) -> Effect:
    x, unit, size, _ = _sizes(plant, slot)
    return Effect(
        f"{name}.varying_section",
        # at its usual content it has a section still
        (EffectParameter("b", f"1/{unit}", 0.0, -0.5 / size, 2.0 / size, grid=(0.05 / size,), least=-0.5 / size),),
        # x' (1 + b x) = what the equation says
        force=lambda s, e: {x: _own_rate(plant, x, s) * (1.0 / (1.0 + e.b * getattr(s, x)) - 1.0)},
        depends_on=(x, "u"),
        formula=f"x' (1 + b {x}) in place of x'",
        statement="its cross-section changes with the level: a cone, a lying cylinder",
        signature="rates up and down are too small or too large by a share that follows the level",
        sign="either: positive widens upwards",
        best_experiment="the same steps of inflow at a low, a middle and a high level",
        write_back="take the cross-section A (1 + b x) in the controller's model",
    )


def _saturation(plant: Plant, name: str, slot: Slot) -> Effect:
    x, unit, size, _ = _sizes(plant, slot)
    return Effect(
        f"{name}.inductor_saturation",
        (EffectParameter("b", f"1/{unit}2", 0.0, 0.0, 2.0 / size**2, grid=(0.05 / size**2,)),),
        # L = L0/(1 + b i^2), so that i' = (1 + b i^2) what the equation says
        force=lambda s, e: {x: _own_rate(plant, x, s) * e.b * getattr(s, x) ** 2},
        depends_on=(x, "u"),
        formula=f"(1 + b {x}^2) x' in place of x'",
        statement="its inductance falls with the current: the core saturates",
        signature="the current rises faster than it should where it is large, of either sign",
        sign="b >= 0: the inductance falls",
        best_experiment="steps or slow sines of several sizes up to the highest current",
        write_back="take the inductance L/(1 + b i^2) in the controller's model",
    )
