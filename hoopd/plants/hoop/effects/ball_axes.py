"""What mechanisms at a rolling ball may depend on beside its angle: the turning of the ball, and the normal force.

Rules of this file: axes only.
"""

from __future__ import annotations

from collections.abc import Iterable

from hoopd.plants.declaration import Plant
from hoopd.plants.effects.grammar.axes import FORCE, POSITION, Axis
from hoopd.plants.hoop.effects.normal_force import signed_normal_force

# Of Ro/Rb: both radii are a device file's, to a tenth each; the tracks that the ball rolls on are another matter again.
RATIO_SHARE = 0.2


def axes(plant: Plant, slot: str) -> Iterable[Axis]:
    """Of the slot of a rolling ball; of the hoop, which bears it, its load."""
    ball = plant.slots[slot].kind == "rolling_ball"
    if "psi" not in plant.coordinates or not (ball or plant.slots[slot].kind == "body"):
        return
    yield Axis(
        "load", "N", "N", FORCE, signed_normal_force, "the normal force of the ball", coordinates=("psi",)
    )  # fmt: skip
    if ball and "theta" in plant.coordinates:
        # phi = (Ro/Rb) (theta - psi): where on the ball the contact is; in a formula a wave has its phase as phi
        yield Axis(
            "phi", "roll", "rad", POSITION, lambda s: s.p["Ro"] / s.p["Rb"] * (s.theta - s.psi),
            "the turning of the ball", True, ("theta", "psi"),
            lambda s: s.p["Ro"] / s.p["Rb"] * (s.dtheta - s.dpsi), scale_share=RATIO_SHARE,
        )  # fmt: skip
