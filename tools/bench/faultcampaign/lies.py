"""Kinds of sensors that lie: those that must be seen, and those that nothing can tell from the truth.

Rules of this file: a lie is for good, and its deadline counts from the moment at which reported and true value differ
by 5 sigma, or from its beginning where it is told from that alone; what a row needs to see, the operator's references
give it (`busy`).
"""

from __future__ import annotations

from typing import Any, Final

from .kind import CAMERA_S, CUT_S, STEPS, STOPPING_S, Kind, Row, Since, reference, scripted

IDENTICAL_S: Final = CAMERA_S + 0.22 + STOPPING_S
# A ball at rest fits a hoop that speeds up steadily, so far as a frame may lean: the next step of the reference, at
# most a second later, contradicts it, and 20 of the last 50 pictures must. (Without any noise it is told at once.)
PAINTED_S: Final = CAMERA_S + 1.0 + 1.0 + STOPPING_S
# A window of ten ticks, all of it wrong for twelve.
ENCODER_S: Final = 0.44 + CUT_S
# Windows of a second and a half that tell something, until there are enough, while the reference steps every two.
UNRESPONSIVE_S: Final = 14.0 + STOPPING_S
AT_REST: Final = (reference(2.0, 0.0),)
LATE_START: Final = (reference(5.0, 0.05),)
KNOCK: Final = {"name": "external.disturbance", "parameters": {"t0": 5.5, "t1": 5.6, "A": 0.1}}

NO_ENCODER: Final = ("hoop_innovation", "torque_without_motion", "speed_noiseless", "speed_implausible")
NO_BALL: Final = ("ball_unresponsive", "ball_implausible", "angle_noiseless", "angle_stuck")


def picture(
    deadline_s: float, causes: tuple[str, ...], kind: str, since: Since = "ball departs", **params: Any
) -> Kind:
    """A camera that lies while the reference steps."""
    script, observe_s = scripted(kind, 0.0, **params), max(3.0, deadline_s + 0.5)
    return Kind("stop", deadline_s, causes, script, since=since, busy=STEPS, observe_s=observe_s)


def encoder(kind: str, busy: tuple[Row, ...] = STEPS, since: Since = "hoop departs", **params: Any) -> Kind:
    """An encoder that does not tell of the hoop."""
    return Kind("cut", ENCODER_S, NO_ENCODER, scripted(kind, 0.0, **params), since=since, busy=busy)


def scaled(factor: float) -> Kind:
    """An encoder that might be one of another device: with it the ball is none, and it is the ball that tells."""
    script = scripted("encoder_scale", 0.0, factor=factor)
    causes, observe_s = (*NO_ENCODER, *NO_BALL), UNRESPONSIVE_S + 0.5
    return Kind("stop", UNRESPONSIVE_S, causes, script, since="hoop departs", busy=STEPS, observe_s=observe_s)


def untold(kind: str, busy: tuple[Row, ...] = STEPS, **params: Any) -> Kind:
    """A lie that is only looked at."""
    return Kind("untold", 0.0, (), scripted(kind, 0.0, **params), busy=busy, observe_s=15.0)


LIES: Final[dict[str, Kind]] = {
    "current implausible": Kind("cut", 0.24, ("current_implausible",), scripted("implausible_current", value=3.0)),
    "speed implausible": Kind("cut", 0.24, ("speed_implausible",), scripted("implausible_speed", value=30.0)),
    "encoder frozen": encoder("encoder_frozen"),
    "encoder frozen at rest": encoder("encoder_frozen", LATE_START, since="fault"),
    "encoder coasts": encoder("encoder_coasts"),
    "encoder turned round": encoder("encoder_scale", factor=-1.0),
    "encoder half": scaled(0.5),
    "encoder double": scaled(2.0),
    "pictures frozen": picture(IDENTICAL_S, ("pictures_identical",), "pictures_frozen", "fault"),
    "pictures frozen at rest": Kind(
        "stop", IDENTICAL_S, ("pictures_identical",), scripted("pictures_frozen", 0.0), busy=AT_REST
    ),
    "ball painted": picture(PAINTED_S, NO_BALL, "picture_ball_painted", psi_rad=0.05),
    "ball painted, swinging": picture(UNRESPONSIVE_S, NO_BALL, "picture_ball_painted", swing_rad=0.05, period_s=4.0),
    "picture half": picture(UNRESPONSIVE_S, NO_BALL, "picture_scale", factor=0.5),
    "picture double": picture(UNRESPONSIVE_S, NO_BALL, "picture_scale", factor=2.0),
    "pictures aged": picture(UNRESPONSIVE_S, NO_BALL, "pictures_aged", delay_s=0.1),
    "pictures aged, one knock": Kind(
        "stop",
        UNRESPONSIVE_S,
        NO_BALL,
        scripted("pictures_aged", 0.0, delay_s=0.1),
        since="ball departs",
        observe_s=UNRESPONSIVE_S + 2.5,
        sim={"effects": [KNOCK]},
    ),
}

UNTOLD: Final[dict[str, Kind]] = {
    "pictures aged, 30 ms": untold("pictures_aged", delay_s=0.03),
    "picture 0.8": untold("picture_scale", factor=0.8),
    "picture 1.2": untold("picture_scale", factor=1.2),
    "picture half at rest": untold("picture_scale", AT_REST, factor=0.5),
    "ball painted at rest": untold("picture_ball_painted", AT_REST, psi_rad=0.0),
    "encoder 0.8": untold("encoder_scale", factor=0.8),
    "encoder 1.25": untold("encoder_scale", factor=1.25),
}
