"""What a laboratory does with a rig, and what the daemon says of it.

Rules of this file: an hour is its rig, effect, way and seed; the laws, the filter and the thresholds are the shipped
ones; what ends control is written down, nothing is judged here.
"""

from __future__ import annotations

from collections import Counter
from math import pi, sin
from typing import Any, NamedTuple

import numpy as np
from lockstepruns import JUDGING, Raised, Watched, prepared, scratch, watch

from honestrigs.rigs import effects, picture_faults, write_model
from hoopd.daemon import experiment
from hoopd.files.shipped import defaults_folder
from hoopd.plants.hoop.loop.experiment_plan import Plan

WAYS = ("rest", "references", "signals")
LAWS = ("lqg", "arx")  # the shipped ones that hold the ball
MISSING = 0.05  # of the pictures
SHORTEST_S = 10.0  # of a test signal
BEGINS_S = 2.0  # arming and the release
HOLDS = defaults_folder() / "controllers" / "lqg.yaml"
SIGNALS = (
    Plan("prbs"),
    Plan("multisine"),
    Plan("chirp"),
    Plan("steps"),
    Plan("decay", rest_s=6.0),
    Plan("prbs", clock_ticks=3),
    Plan("prbs", around=HOLDS),
    Plan("multisine", around=HOLDS),
)
LONGEST_S = 34.0


class Hour(NamedTuple):
    """What is watched."""

    slot: int
    rig: int
    effect: str  # "": nothing is hidden
    way: str
    seconds: float
    seed: int


class Seen(NamedTuple):
    """What came of it."""

    hour: Hour
    seconds: float  # of virtual time
    acting_s: float  # under a law
    alarms: tuple[Raised, ...]  # rows that call a sensor a liar
    others: dict[str, int]  # how often the others came


def spend(hour: Hour) -> Seen:
    """Watch a rig in one way."""
    rng = np.random.default_rng([hour.seed, hour.slot, WAYS.index(hour.way)])
    parts: list[Watched] = []
    if hour.way == "signals":
        while (left := hour.seconds - sum(part.ended_s for part in parts)) > BEGINS_S + SHORTEST_S or not parts:
            parts.append(_signal(hour, SIGNALS[(hour.slot + len(parts)) % len(SIGNALS)], left - BEGINS_S, rng))
    else:
        parts.append(_reference(hour, rng))
    raised = [one for part in parts for one in part.raised]
    return Seen(
        hour,
        sum(part.ended_s for part in parts),
        sum(part.running_s for part in parts),
        tuple(one for one in raised if one.name in JUDGING),
        dict(Counter(one.name for one in raised if one.name not in JUDGING)),
    )


def _signal(hour: Hour, kind: Plan, left_s: float, rng: np.random.Generator) -> Watched:
    """One test signal from rest."""
    lasts_s = min(max(left_s, SHORTEST_S), LONGEST_S)
    seed = int(rng.integers(1000))
    plan = kind._replace(duration_s=lasts_s, seed=seed)
    with scratch() as folder:
        config, _ = prepared(_rig(hour, lasts_s + 2 * BEGINS_S, rng, folder, psi_rad=0.0), folder)
        config, texts, score = experiment.prepared(plan, config, None)
        return watch(config, texts, folder, score.seconds + 2 * BEGINS_S, seed, pictures=False)


def _reference(hour: Hour, rng: np.random.Generator) -> Watched:
    """One run under a shipped law."""
    law = LAWS[(hour.slot + WAYS.index(hour.way)) % len(LAWS)]  # each rig under both, each effect under both
    commands = [] if hour.way == "rest" else references(hour.slot, hour.seconds, rng)
    with scratch() as folder:
        content = _rig(hour, hour.seconds, rng, folder, psi_rad=0.4)
        content["control"] = {"file": f"controllers/{law}.yaml"}
        content["sim"]["commands"] = commands
        config, texts = prepared(content, folder)
        return watch(config, texts, folder, hour.seconds, int(rng.integers(1000)), pictures=False)


def references(which: int, seconds: float, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Steps both ways, stairs, a sine, or held angles, within what the shipped laws are designed for."""
    kind, values = which % 4, []
    size = float(rng.uniform(0.05, 0.2))
    times = np.arange(4.0, seconds, (2.0, 3.0, 0.1, 10.0)[kind])
    for k, t in enumerate(times):
        value = (
            size * (-1) ** k,
            size * (0, 0.5, 1, 0.5, 0, -0.5, -1, -0.5)[k % 8],
            size * sin(2 * pi * 0.25 * t),
            size * (0, 1, 0, -1)[k % 4],
        )[kind]
        values.append({"at_s": float(t), "name": "reference", "value": float(value)})
    return values


def _rig(hour: Hour, seconds: float, rng: np.random.Generator, folder: Any, psi_rad: float) -> dict[str, Any]:
    model = folder / "rig.yaml"
    write_model(hour.rig, model)
    sim = {
        "model": str(model),
        "psi_rad": psi_rad,
        "effects": effects(hour.effect),
        "faults": picture_faults(hour.effect, seconds, MISSING, rng),
    }
    return {"sim": sim}
