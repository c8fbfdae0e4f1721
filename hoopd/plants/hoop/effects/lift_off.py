"""Lift-off: the hoop can push the ball but not hold it, so that it flies where the normal force would be negative.

Rules of this file: one effect; its plant is in `flying_plant`, when it begins and ends, `flight` decides.
"""

from __future__ import annotations

from hoopd.plants.effects.base import Effect, EffectParameter, geometric
from hoopd.plants.hoop.contact import ContactOf
from hoopd.plants.hoop.effects.flight import FlightRun
from hoopd.plants.hoop.effects.flying_plant import FlyingPlant, in_the_air
from hoopd.plants.hoop.effects.normal_force import signed_normal_force

LIFT_OFF = "ball.lift_off"  # of the hoop's own ball
# A touch after which the ball rolls, whatever it takes.
ALWAYS_ROLLS = 1e3


def lift_off(name: str, contact: ContactOf, on_inner: tuple[Effect, ...] = ()) -> Effect:
    """The effect of a rolling ball's slot; a switch: in a set of effects it is on, whatever its numbers;
    `on_inner`: what acts through a contact with an inner hoop."""
    gone = tuple(f"{name}.{effect}" for effect in ("coulomb_friction", "rolling_resistance", "slip", "lift_off"))
    return Effect(
        f"{name}.lift_off",
        (
            # of the speed across the hoop, what comes back; a rubber ring under a steel ball gives 0.2 to 0.6
            EffectParameter("restitution", "-", 0.0, 0.0, 0.95, "shape", (0.1, 0.2, 0.3, 0.4, 0.6, 0.8)),
            # of a bounce's impulse across, the friction's part at most, and of a landing's where the ball slips (that
            # effect's mu counts); a plant that only rolls has rolling at once where the ball stays
            EffectParameter("grip", "-", ALWAYS_ROLLS, 0.02, ALWAYS_ROLLS, "shape", geometric(0.02, 0.5, 8)),
        ),
        flight=lambda plant: FlyingPlant(in_the_air(plant, contact), contact, signed_normal_force, gone, on_inner),
        free_run=FlightRun,
        found_by="switch",
        depends_on=("psi", "dpsi"),
        near=(f"{name}.slip",),
        formula="no contact while N < 0; touch: r' -> -restitution r', friction <= grip m (1 + restitution) r'",
        statement="the ball leaves the hoop where the normal force would be negative, and flies until it touches again",
        signature="above the axis at low speed the ball falls faster than it could roll",
        sign="on or off; 0 <= e < 1",
        best_experiment="large swings beyond a quarter turn",
        write_back="keep the ball below the axis: no control law holds it in the air",
    )
