"""The hoop with its ball as a declared plant: both, the hoop alone, or the ball in a held hoop.

Rules of this file: equations come from `equations`; its own effects come from the files of their slots.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import inf, tau
from typing import Any

import casadi as ca

from hoopd.plants.declaration import Channel, Input, Judges, MotionMode, Plant, Slot
from hoopd.plants.effects.base import Effect, Point
from hoopd.plants.hoop.contact import contact_of
from hoopd.plants.hoop.effects import ball_axes, ball_effects, frame_effects
from hoopd.plants.hoop.effects.normal_force import signed_normal_force
from hoopd.plants.hoop.equations import MOTIONS, lagrangian, symbols
from hoopd.plants.hoop.fitting.free_parameters import PRIOR
from hoopd.plants.hoop.parameters import KINEMATICS, LIMIT_NM, PARAMETER_UNITS
from hoopd.plants.hoop.recordings.fit_data import moving_of
from hoopd.plants.hoop.recordings.suspicions import ball_is_current, repeated_rows, suspicions
from hoopd.plants.scales import LEAST_SIZE
from hoopd.recording.recording import Recording


def own_effects(plant: Plant) -> tuple[Effect, ...]:
    """Those of the rolling ball and of the frame."""
    return (*ball_effects.effects(plant), *frame_effects.effects(plant))


def hoop_plant(
    structure: str,
    values: Mapping[str, float],
    moving: str = "both",
    limit: float | None = LIMIT_NM,
    encoder_counts: int = 4096,
) -> Plant:
    """The hoop with its ball, the hoop alone or the ball in a held hoop; `values` as in `Plant`."""
    coordinates = {"both": ("theta", "psi"), "hoop": ("theta",), "ball": ("psi",)}[moving]
    seen = {
        "theta": Channel("theta", "rad", "encoder", resolution=tau / encoder_counts, arbitrary_zero=True),
        "dtheta": Channel("dtheta", "rad/s", "encoder"),
        "psi": Channel("psi", "rad", "camera"),
    }
    channels = {name: one for name, one in seen.items() if one.state.removeprefix("d") in coordinates}
    return Plant(
        name=f"{structure} ({moving})",
        coordinates=coordinates,
        accelerations=_hoop_accelerations(structure, moving),
        values=dict(values),
        free=_free(structure, moving),
        beliefs=_beliefs(structure, moving),
        inputs=(Input("u", "N m", limit, "theta" if moving != "ball" else None),),
        channels=channels,
        scales=dict.fromkeys(coordinates, 1.0),
        least_size=LEAST_SIZE,
        plays="hoopd experiment" if moving != "ball" else "",
        slots=_slots(structure, moving),
        held={"theta": 0.0, "dtheta": 0.0} if moving == "ball" else {},
        units=PARAMETER_UNITS[structure],
        bounds=_bounds(structure, moving, values),
        energy=_energy(structure) if structure in KINEMATICS else None,
        own_effects=own_effects,
        own_axes=ball_axes.axes,
        modes=() if moving == "hoop" else (ROLLING,),
        judges=Judges(
            moving=lambda recording: hoop_plant(
                structure, values, what_moves(recording, encoder_counts), limit, encoder_counts
            ),
            doubts=lambda recording: suspicions(recording, LIMIT_NM if limit is None else limit),
            repeated=repeated_rows,
            least_s=LEAST_S,
            stops=True,
            words={"theta": "the hoop", "psi": "the ball"},
        ),
    )


def pressed(s: Point) -> Any:
    """The normal force between hoop and ball over the ball's weight, N / (m g)."""
    return signed_normal_force(s) / (s.p["mb"] * s.p["g"])


ROLLING = MotionMode("the ball's rolling", guard=pressed)


# Seconds of usable data: two windows of a fit and one of what is held out; less says nothing about a model.
LEAST_S = (4.0, 2.0)


def what_moves(recording: Recording, encoder_counts: int = 4096) -> str:
    """both, hoop or ball; a psi that is another signal is no ball."""
    moving = moving_of(recording, encoder_counts)
    return "hoop" if moving == "both" and ball_is_current(recording) else moving


# Which of the eight entries a recording says something about, by what moves in it.
_ENTRIES_OF = {
    "both": ("J11", "J12", "K1", "L1", "J21", "J22", "K2", "L2"),
    "hoop": ("J11", "L1"),
    "ball": ("J22", "K2"),
}
# Readings of both know six combinations of the seven; which of the radii the sixth is told by, is as good as the same.
_PHYSICAL_OF = {"both": ("mb", "Ro", "Ib", "Ih", "bb", "bh"), "hoop": ("Ih", "bh"), "ball": ("Ib", "bb")}


def _free(structure: str, moving: str) -> tuple[str, ...]:
    return _ENTRIES_OF[moving] if structure == "entries" else _PHYSICAL_OF[moving]


def _beliefs(structure: str, moving: str) -> dict[str, float]:
    """Of the ball and the way that it rolls on, as a fit that frees them believes them beforehand."""
    if structure == "entries" or moving == "hoop":
        return {}
    return {name: PRIOR[name] for name in ("mb", "Ro", "Rb")}


# Of a mass or an inertia, the share of its told value that it has at least; a friction may be none.
LEAST_OF_INERTIA, FRICTIONS = 0.01, ("bb", "bh")


def _bounds(structure: str, moving: str, values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Of physical parameters; entries have either sign."""
    if structure == "entries":
        return {}
    free = _free(structure, moving)
    found = {name: (0.0 if name in FRICTIONS else LEAST_OF_INERTIA * values[name], inf) for name in free}
    # the ball is inside
    return {**found, "Ro": (values["Rb"], inf)} if "Ro" in found else found


def _slots(structure: str, moving: str) -> dict[str, Slot]:
    hoop = {
        "actuator": Slot("actuator", "theta", free_gain=True),
        "hoop": Slot("body", "theta", turns=True, viscous=_hoop_friction(structure, moving)),
        "encoder": Slot("sensor", "theta", ("theta", "dtheta"), turns=True, device="encoder"),
        "external": Slot("push", "theta"),
    }
    ball = {
        "ball": Slot("rolling_ball", "psi", data=contact_of(structure)),
        "frame": Slot("frame", "psi"),
        "camera": Slot("sensor", "psi", ("psi",), turns=True, device="camera"),
    }
    return {"both": {**hoop, **ball}, "hoop": hoop, "ball": ball}[moving]


def _hoop_friction(structure: str, moving: str) -> Callable[[Point], Any]:
    """bh (N m s) of a model; of `entries` what six of them imply."""
    if structure != "entries":
        return lambda s: s.p["bh"]
    # theta'' = J11 theta' + L1 tau of the bare hoop: bh = -J11 / L1
    return _bare_hoop_friction if moving == "hoop" else _implied_friction


def _bare_hoop_friction(s: Point) -> Any:
    return ca.fabs(s.p["J11"]) / s.p["L1"]


def _implied_friction(s: Point) -> Any:
    """bh as in `entries.combinations_from`; where that is no friction, all of J11 is taken for it."""
    p = s.p
    d = p["J12"] / (p["L1"] - p["L2"])
    implied = (p["L2"] * d - p["J11"]) / p["L1"] - d
    return ca.if_else(implied > 0.0, implied, _bare_hoop_friction(s))


def _energy(kinematics: str) -> Callable[[Point], Any]:
    def energy(s: Point) -> Any:
        x = ca.vertcat(*(getattr(s, name) if name in s else 0.0 for name in ("theta", "dtheta", "psi", "dpsi")))
        parts = lagrangian(kinematics, symbols(x, s.u, s.p))
        return parts.kinetic + parts.potential

    return energy


def _hoop_accelerations(structure: str, moving: str) -> Callable[[Point, ca.SX], ca.SX]:
    def accelerations(s: Point, force: ca.SX) -> ca.SX:
        # the Euler-Lagrange derivatives need symbols of their own
        z, f = ca.SX.sym("z", 4), ca.SX.sym("f", 2)
        both = MOTIONS[moving](structure, symbols(z, ca.SX(0), s.p), f)
        here = ca.vertcat(*(getattr(s, name) if name in s else 0.0 for name in ("theta", "dtheta", "psi", "dpsi")))
        full = {"both": lambda: force, "hoop": lambda: ca.vertcat(force, 0), "ball": lambda: ca.vertcat(0, force)}
        found = ca.substitute(ca.vertcat(*both), ca.vertcat(z, f), ca.vertcat(here, full[moving]()))
        return {"both": found, "hoop": found[0], "ball": found[1]}[moving]

    return accelerations
