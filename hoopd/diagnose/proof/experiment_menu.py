"""Safe experiments to choose from: the signals of `hoopd experiment`, as large as the fitted model lets them be.

Rules of this file: every entry is a command that exists; the limits are that command's own, and a part of them stays
unused, because the device is not the model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hoopd.core.excitation import Excitation, ExcitationLimits
from hoopd.plants import free_run as freerun
from hoopd.plants.declaration import Plant
from hoopd.plants.effects.usual_sizes import USUAL_S, force_scale, speed_scale, time_scale
from hoopd.plants.hoop.loop.experiment_plan import (
    AMPLITUDES_NM,
    COMFORT,
    DURATION_S,
    DURATIONS_S,
    VARIANTS,
    Plan,
    unit_table,
)
from hoopd.plants.plant_with_effects import Composite

Array = NDArray[np.float64]

# What tells effects apart differs: many sizes, many frequencies, slow reversals, swings that die away.
MENU: tuple[tuple[str, Plan], ...] = (
    ("a fast random two-level {input}", Plan("prbs")),
    ("a slow random two-level {input}", Plan("prbs", clock_ticks=10)),
    ("a chirp", Plan("chirp")),
    ("a slow chirp", Plan("chirp", low_hz=0.1, high_hz=1.0)),
    ("a multisine", Plan("multisine")),
    ("slow reversals, a multisine of low frequency", Plan("multisine", low_hz=0.05, high_hz=0.25)),
    ("two tones close to each other", Plan("multisine", low_hz=0.5, high_hz=0.55)),
    ("steps of three sizes", Plan("steps")),
    ("long steps of three sizes", Plan("steps", hold_s=1.2)),
    ("kicks and free decay", Plan("decay", DURATIONS_S["decay"])),
    ("long kicks and coasting down", Plan("decay", DURATIONS_S["decay"], kick_s=0.6)),
)
# What of a plan is a time, and a frequency.
TIMES = ("duration_s", "hold_s", "kick_s", "rest_s", "soft_start_s", "soft_end_s")
FREQUENCIES = ("low_hz", "high_hz")
# Effects at rest and near rest show at small torques: each signal is tried as large as it may be, and at this share.
SMALL_SHARE = 0.3
# Of a signal's random variants; the command itself looks at more of them when it is played.
MOST_VARIANTS = 4
# A recording with so many times the plant's usual sample time is another rate, and no jitter of it.
MUCH_SLOWER = 2.0
# The model is run to its end: its speed is judged afterwards.
NO_SPEED_LIMIT = 1e9


@dataclass(frozen=True)
class Entry:
    """One experiment: what it is called, its plan, and what the model does in it."""

    words: str
    plan: Plan
    t: Array  # (n,) s
    u: Array  # (n-1,)
    z: Array  # (n, nz)


def entries(composite: Composite, values: Mapping[str, float], period_s: float, seed: int = 0) -> Iterator[Entry]:
    """The menu for a plant with effects, sizes chosen; none for a plant without a drive."""
    if composite.declared.driven is None:
        return
    for called, usual in MENU:
        words = called.format(input=composite.declared.input_word)
        plan = in_times_of(composite.declared, usual, period_s)._replace(
            seed=seed, ball=_ball(composite.declared) is not None
        )
        large = _largest(words, plan, composite, values, period_s)
        if large is None:
            continue
        yield large
        small = plan._replace(amplitude_nm=_rounded(SMALL_SHARE * (large.plan.amplitude_nm or 0.0)))
        quiet = _played(words, small, 0, composite, values, period_s)
        if _use(quiet, composite.declared) <= COMFORT:
            yield quiet


def in_times_of(plant: Plant, plan: Plan, period_s: float = 0.0) -> Plan:
    """A plan of as many samples and as many periods a sample on a plant, or a recording, of another sample time.

    A recording that is sampled less often than its plant usually is cannot show the usual frequencies.
    """
    by = period_s / USUAL_S if period_s > MUCH_SLOWER * plant.time_scale_s else time_scale(plant)
    if by == 1.0:
        return plan
    changes = {name: getattr(plan, name) * by for name in TIMES}
    changes |= {name: getattr(plan, name) / by for name in FREQUENCIES}
    return plan._replace(**changes)


def command(plan: Plan, program: str = "hoopd experiment") -> str:
    """The line with which a program plays it."""
    default = Plan(plan.kind, DURATIONS_S.get(plan.kind, DURATION_S))
    options = {
        "--amplitude": "amplitude_nm", "--duration": "duration_s", "--clock": "clock_ticks", "--low": "low_hz",
        "--high": "high_hz", "--hold": "hold_s", "--kick": "kick_s", "--rest": "rest_s", "--seed": "seed",
    }  # fmt: skip
    parts = [
        f"{option} {getattr(plan, name):g}" for option, name in options.items()
        if getattr(plan, name) != getattr(default, name)
    ]  # fmt: skip
    return " ".join([program, plan.kind, *parts, *(() if plan.ball else ("--no-ball",))])


# ---------------------------------------------------------------------------------------------- inside


def _largest(
    words: str, plan: Plan, composite: Composite, values: Mapping[str, float], period_s: float
) -> Entry | None:
    """The first that leaves room to every limit, as the command itself chooses."""
    scale = force_scale(composite.declared)
    for amplitude in AMPLITUDES_NM:
        for variant in range(min(VARIANTS.get(plan.kind, 1), MOST_VARIANTS)):
            tried = plan._replace(amplitude_nm=_rounded(amplitude * scale))
            found = _played(words, tried, variant, composite, values, period_s)
            if _use(found, composite.declared) <= COMFORT:
                return found
    return None


def _played(
    words: str, plan: Plan, variant: int, composite: Composite, values: Mapping[str, float], period_s: float
) -> Entry:
    """On the model, from rest."""
    variants = VARIANTS.get(plan.kind, 1)
    table = (plan.amplitude_nm or 0.0) * unit_table(plan, plan.seed * variants + variant, period_s)
    law = Excitation(
        table.tolist(), ExcitationLimits(composite.declared.usual_input, NO_SPEED_LIMIT),
        soft_start_ticks=round(plan.soft_start_s / period_s), soft_end_ticks=round(plan.soft_end_s / period_s),
    )  # fmt: skip
    u = np.array(law.torques_nm)
    t = np.asarray(np.arange(len(u) + 1) * period_s, np.float64)
    return Entry(words, plan, t, u, freerun.run(composite, values, np.zeros(composite.nx), t, u))


def _use(entry: Entry, plant: Plant) -> float:
    """Share of the limits, 1 at the nearest one; infinite for a run that is lost."""
    if not np.isfinite(entry.z).all():
        return float("inf")
    speed, ball = _peak(entry, plant, f"d{plant.driven}"), _ball(plant)
    limit = entry.plan.speed_limit_rad_s * _speed_scale(plant)
    return max(speed / limit, _peak(entry, plant, ball) / entry.plan.angle_limit_rad if ball else 0.0)


def _peak(entry: Entry, plant: Plant, state: str) -> float:
    return float(np.max(np.abs(entry.z[:, plant.states.index(state)])))


def _ball(plant: Plant) -> str | None:
    """Coordinate of a rolling ball."""
    return next((slot.coordinate for slot in plant.slots.values() if slot.kind == "rolling_ball"), None)


def _speed_scale(plant: Plant) -> float:
    """Rates of the driven coordinate over those for which the plans' limits are meant."""
    return max((speed_scale(s) for s in plant.slots.values() if s.coordinate == plant.driven), default=1.0)


def _rounded(amplitude: float) -> float:
    """To two digits."""
    return float(f"{amplitude:.2g}")
