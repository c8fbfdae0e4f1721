"""Which cases there are: singles, nulls, decoys, confounded pairs, compounds, unknown effects, a shorter library.

Rules of this file: a family is a list of wishes; closed loop crosses all of them, one case in five.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from concealed.classes import partners
from concealed.effects import ALL, OUTSIDE, SINGLES, UNKNOWN
from concealed.recipes import Wish

CLOSED_SHARE = 0.2
# Nats of what is outside the library, from and to, drawn in so many equal steps of their logarithm.
OUTSIDE_NATS = (5.0, 400.0)
GRADES = 4
# Effects that two-level inputs hide: they are confounded cases then, not singles.
_PAIRS: tuple[tuple[tuple[str, ...], dict[str, bool]], ...] = (
    (("ball.coulomb_friction",), {"small": True}),
    (("ball.coulomb_friction",), {"large": True}),
    (("ball.rolling_resistance",), {"small": True}),
    (("ball.rolling_resistance",), {"large": True}),
    (("actuator.lag",), {"two_level": True}),
    (("actuator.delay",), {"two_level": True}),
    (("frame.tilt",), {"small": True}),
    (("camera.center_offset",), {"small": True}),
    (("hoop.coulomb_friction",), {"closed": True}),
    (("hoop.stribeck_friction",), {"closed": True}),
    (("actuator.deadzone",), {"two_level": True}),
    (("actuator.saturation",), {"two_level": True}),
)
# Taken out of a library these leave no partner of their class; faults of single pictures are counted, not fitted.
STRANGERS = tuple(name for name in SINGLES if not partners(name) and not ALL[name].drawn)
_NULLS: tuple[dict[str, bool], ...] = ({}, {}, {"heavy": True}, {"closed": True}, {"calm": True})
_DECOYS: tuple[tuple[tuple[str, ...], dict[str, bool]], ...] = (
    (("decoy.hand",), {}),
    ((), {"burst": True}),
    (("decoy.drive_off",), {}),
)


def singles(per_effect: int, rng: np.random.Generator) -> list[Wish]:
    """Every effect alone."""
    return [Wish("single", (name,), closed=_closed(rng)) for name in SINGLES for _ in range(per_effect)]


def nulls(count: int, rng: np.random.Generator) -> list[Wish]:
    """Nothing hidden: wrong parameters, with and without disturbance, heavier noise, closed loop."""
    return [Wish("null", **_NULLS[i % len(_NULLS)]) for i in range(count)]


def decoys(count: int, rng: np.random.Generator) -> list[Wish]:
    """A push, a burst of false detections, a start-up."""
    return [Wish("decoy", names, **flags) for names, flags in (_DECOYS[i % len(_DECOYS)] for i in range(count))]


def confounded(count: int, rng: np.random.Generator) -> list[Wish]:
    """Effects on data that hardly tell them from another: the class is the right answer."""
    return [Wish("confounded", names, **flags) for names, flags in (_PAIRS[i % len(_PAIRS)] for i in range(count))]


def compounds(count: int, rng: np.random.Generator) -> list[Wish]:
    """Two effects from different slots, in one case of four three."""
    return [Wish("compound", _mixed(3 if i % 4 == 3 else 2, rng), closed=_closed(rng)) for i in range(count)]


def unknown(count: int, rng: np.random.Generator) -> list[Wish]:
    """Effects outside the table."""
    return [Wish("unknown", (UNKNOWN[i % len(UNKNOWN)],), closed=_closed(rng)) for i in range(count)]


def left_out(per_effect: int, rng: np.random.Generator) -> list[Wish]:
    """Effects of the table that the library of who is asked lacks."""
    return [Wish("left_out", (name,), closed=_closed(rng)) for name in STRANGERS for _ in range(per_effect)]


def outside(per_kind: int, rng: np.random.Generator, nats: tuple[float, float] = OUTSIDE_NATS) -> list[Wish]:
    """Mechanisms outside the library, their sizes spread evenly over the grades whatever the number of cases a kind."""
    steps = [float(round(one)) for one in np.geomspace(*nats, GRADES + 1)]
    grades = list(pairwise(steps))
    return [
        Wish("outside", (name,), closed=_closed(rng), nats=grades[(kind + case) % GRADES])
        for kind, name in enumerate(OUTSIDE)
        for case in range(per_kind)
    ]


FAMILIES: Mapping[str, Callable[..., list[Wish]]] = {
    "single": singles,
    "null": nulls,
    "decoy": decoys,
    "confounded": confounded,
    "compound": compounds,
    "unknown": unknown,
    # last: the cases of the others stay what they were
    "left_out": left_out,
    "outside": outside,
}
USUAL = tuple(
    family for family in FAMILIES if family not in ("left_out", "outside")
)  # of a run that is told no families


def _closed(rng: np.random.Generator) -> bool:
    return bool(rng.uniform() < CLOSED_SHARE)


def _mixed(count: int, rng: np.random.Generator) -> tuple[str, ...]:
    """Effects from different slots; torque_gain is no effect."""
    names: list[str] = []
    while len(names) < count:
        name = str(rng.choice([name for name in SINGLES if name != "actuator.torque_gain"]))
        if ALL[name].slot not in [ALL[other].slot for other in names]:
            names.append(name)
    return tuple(sorted(names))
