"""The inner hoop: a second track, which turns with the hoop, and on whose outside a ball rolls that has left the first.

With the radius Ri of the circle on which it touches and the ball's rolling radius Rb its centre runs at Ri + Rb:
    Rb w = (Ri+Rb) psi' - Ri theta',   phi' = (Ri/Rb) (psi' - theta'),   N = -m ((Ri+Rb) psi'^2 + g cos psi)

Rules of this file: the effect that says that there is one, and the plant of a ball on it; when it comes there and
leaves it again, `contact_modes` says.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.base import Effect, EffectParameter, Point
from hoopd.plants.hoop.contact import Contact, ContactOf

INNER_HOOP = "ball.inner_hoop"  # of the hoop's own ball
RADIUS = f"{INNER_HOOP}.radius"


def inner_hoop(name: str) -> Effect:
    """The effect of a rolling ball's slot: a part of the device, found by no recording of a ball on the outer hoop."""
    return Effect(
        f"{name}.inner_hoop",
        # 44.5 and 55.5 mm were built; 0: there is none
        (EffectParameter("radius", "m", 0.0, 0.0, 0.5, "shape", (0.03, 0.0365, 0.0445, 0.05, 0.0555, 0.065)),),
        found_by="switch",
        depends_on=("psi", "dpsi"),
        near=(f"{name}.lift_off",),
        formula="contact at radius + Rb from the axis: N = -m ((radius+Rb) psi'^2 + g cos psi)",
        statement="a ball that left the hoop may land on an inner one, roll on it and leave it again",
        signature="a thrown ball stays near the axis",
        sign="radius > 0; 0: there is no inner hoop",
        best_experiment="none: it is measured with a caliper",
        write_back="device.inner of the model file",
    )


def inner_contact(contact: ContactOf) -> ContactOf:
    """The contact of a ball on the inner hoop, from that of the outer one."""

    def of(s: Point) -> Contact:
        c, ratio = contact(s), s.p[RADIUS] / s.p["Rb"]
        return c._replace(by_theta=-ratio, by_psi=1.0 + ratio, psi_inertia=s.p["mb"] * inner_track(s) ** 2)

    return of


def inner_track(s: Point) -> Any:
    """Distance of the ball's centre from the axis, m."""
    return s.p[RADIUS] + s.p["Rb"]


def inner_normal_force(s: Point) -> Any:
    """N; below zero the inner hoop would have to hold the ball back; of a frame that leans and shakes as `normal_force`
    has it."""
    force = -s.p["mb"] * (inner_track(s) * s.dpsi**2 + s.p["g"] * ca.cos(s.to_gravity("psi")))
    return force if s.shaken is None else force - s.p["mb"] * s.shaken * ca.sin(s.psi)


def on_the_inner_hoop(plant: Plant, contact: ContactOf) -> Plant:
    """The plant of a ball that rolls on the inner hoop: the same coordinates."""
    bodies = [slot for slot in plant.slots.values() if slot.kind == "body" and slot.coordinate == "theta"]

    def accelerations(s: Point, force: Any) -> Any:
        c, ratio = inner_contact(contact)(s), s.p[RADIUS] / s.p["Rb"]
        a, b, spin = c.by_theta, c.by_psi, c.spin_inertia
        # T = It theta'^2/2 + m (Ri+Rb)^2 psi'^2/2 + Ib w^2/2,  V = -m g (Ri+Rb) cos psi,
        # D = bb phi'^2/2 + bh theta'^2/2
        m11, m12, m22 = c.theta_inertia + spin * a * a, spin * a * b, c.psi_inertia + spin * b * b
        rolling = c.damping * ratio**2 * (s.dpsi - s.dtheta)
        drag = sum(slot.viscous(s) for slot in bodies if slot.viscous is not None)
        on_theta = force[0] - drag * s.dtheta + rolling
        on_psi = force[1] - s.p["mb"] * s.p["g"] * inner_track(s) * ca.sin(s.psi) - rolling
        det = m11 * m22 - m12 * m12
        return ca.vertcat(m22 * on_theta - m12 * on_psi, m11 * on_psi - m12 * on_theta) / det

    return replace(plant, accelerations=accelerations)
