"""Which names say the same of a recording: always, or only where the case cannot tell them apart.

Rules of this file: pure; the table follows the contract of names. A class with a condition holds in a case that meets
it; `wide` reads the contract generously where it leaves a doubt, and both readings are reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SMALL_ANGLES = "small_angles"  # the ball stays where cos psi is nearly 1: an offset of the centre is a constant angle
SINGLE_LEVEL = "single_level"  # one |u| in all that is learned from: what depends on |u| is a gain
SAME_LEVEL = 0.1  # two recordings have one |u| when their largest torques differ by less than this share
TRAINING = ("train_1", "train_2")


@dataclass(frozen=True)
class Class:
    """Names that are not told apart; `needs`: the condition of the case, empty when there is none."""

    names: frozenset[str]
    needs: str = ""


# The same for every sensor and every input: one name.
EXACT: tuple[frozenset[str], ...] = (frozenset(("frame.tilt", "camera.angle_offset")),)
CLASSES: tuple[Class, ...] = (
    Class(frozenset(("hoop.coulomb_friction", "hoop.stribeck_friction"))),  # one contains the other
    Class(frozenset(("ball.coulomb_friction", "ball.rolling_resistance"))),
    Class(frozenset(("actuator.lag", "actuator.delay"))),
    Class(frozenset(("frame.tilt", "camera.angle_offset", "camera.center_offset")), SMALL_ANGLES),
    Class(frozenset(("actuator.deadzone", "actuator.saturation", "actuator.torque_gain")), SINGLE_LEVEL),
)


def exact(first: str, second: str) -> bool:
    """Are these one and the same in every recording?"""
    return first == second or any(first in names and second in names for names in EXACT)


def alike(first: str, second: str, given: frozenset[str] = frozenset()) -> bool:
    """Are these in one class under the conditions `given`?"""
    return exact(first, second) or any(
        first in one.names and second in one.names for one in CLASSES if not one.needs or one.needs in given
    )


def partners(name: str) -> set[str]:
    """Other names that are in a class with this one, under whatever condition."""
    groups = [*EXACT, *(one.names for one in CLASSES)]
    return {other for names in groups if name in names for other in names} - {name}


def conditions(answer: Mapping[str, Any]) -> frozenset[str]:
    """What holds of a case."""
    flags = answer["flags"]
    met = {SMALL_ANGLES: flags.get("small_angles"), SINGLE_LEVEL: flags.get("two_level") and _one_level(answer)}
    return frozenset(name for name, holds in met.items() if holds)


def wide(answer: Mapping[str, Any]) -> frozenset[str]:
    """Conditions as a generous reader sees them: two levels are one |u| even where the recordings' strengths differ,
    and an offset of the centre is near a tilt at any angle."""
    return frozenset((SMALL_ANGLES, SINGLE_LEVEL)) if answer["flags"].get("two_level") else frozenset((SMALL_ANGLES,))


def _one_level(answer: Mapping[str, Any]) -> bool:
    first, second = (answer["reach"][name]["u_nm"] for name in TRAINING)
    return bool(abs(first - second) < SAME_LEVEL * max(first, second))
