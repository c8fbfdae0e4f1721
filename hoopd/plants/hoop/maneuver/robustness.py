"""How far a plan may be trusted where the device is not quite the model: parameter by parameter, and all at once.

Rules of this file: plays plans on other parameters and counts; what follows from it is decided by who asked.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, nan, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hoopd.files.model import ModelFile
from hoopd.plants.hoop.maneuver.judgement import LEAST_FLIGHT_S
from hoopd.plants.hoop.maneuver.tracked_run import PlanTracker, TrackedRun
from hoopd.plants.hoop.parameters import PARAMETER_UNITS

Array = NDArray[np.float64]

# Of a parameter that nobody has measured an interval of.
UNKNOWN_SHARE = 0.1
SAMPLES, SEED = 40, 0
# What the bottom's law takes over: a ball that is further from the bottom has not arrived.
ARRIVED_RAD = 0.5


class PlayResult(NamedTuple):
    """What became of a plan on other parameters."""

    contact: float  # least force, weights of the ball
    end_rad: float  # angle from the plan's end
    torque_nm: float  # largest
    hoop_speed_rad_s: float  # largest
    flown_s: float | None = None  # of a throw: the longest flight

    @property
    def arrived(self) -> bool:
        """The ball kept its contact, or flew as it was thrown, and came to the bottom."""
        as_planned = self.contact > 0.0 if self.flown_s is None else self.flown_s >= LEAST_FLIGHT_S
        return as_planned and abs(self.end_rad) < ARRIVED_RAD


class PlayedPlan(NamedTuple):
    """A plan with its feedback, and what the drive gives."""

    states: Array
    inputs: Array
    gains: Array
    tick_s: float
    limit_nm: float
    throw: bool = False  # the ball may leave the hoop


def spreads(model: ModelFile) -> dict[str, float]:
    """By how much each parameter may be another one: half of its 95 % interval, else a tenth of it."""
    found = {}
    for name, value in model.values().items():
        if name not in PARAMETER_UNITS[model.structure] or name == "g":
            continue
        entry = model.parameters.get(name)
        interval = entry.ci95 if entry is not None else None
        found[name] = UNKNOWN_SHARE * abs(value) if interval is None else (interval[1] - interval[0]) / 2.0
    return found


def by_parameter(tracker: PlanTracker, plan: PlayedPlan, model: ModelFile) -> dict[str, PlayResult]:
    """The worse of both ends of every parameter's interval."""
    values = model.values()
    found = {}
    for name, spread in spreads(model).items():
        both = [played(tracker, plan, {name: values[name] + sign * spread}) for sign in (-1.0, 1.0)]
        found[name] = min(both, key=lambda one: (one.arrived, one.contact))
    return found


def sampled(tracker: PlanTracker, plan: PlayedPlan, model: ModelFile, samples: int = SAMPLES) -> list[PlayResult]:
    """Every parameter drawn evenly from its interval, all at once; the same draws for every plan."""
    values, wide, rng = model.values(), spreads(model), np.random.default_rng(SEED)
    draws = rng.uniform(-1.0, 1.0, (samples, len(wide)))
    names = list(wide)
    return [
        played(tracker, plan, {name: values[name] + draw * wide[name] for name, draw in zip(names, row, strict=True)})
        for row in draws
    ]


def played(tracker: PlanTracker, plan: PlayedPlan, changes: Mapping[str, float]) -> PlayResult:
    """One run with some parameters changed."""
    play = tracker.thrown if plan.throw else tracker.run
    run: TrackedRun = play(*plan[:-1], changes)
    off = float(run.states[-1, 2] - plan.states[-1, 2])
    return PlayResult(
        run.contact,
        off - tau * round(off / tau) if isfinite(off) else nan,
        float(np.abs(run.inputs).max()),
        float(np.abs(run.states[:, 1]).max()),
        run.flown_s if plan.throw else None,
    )
