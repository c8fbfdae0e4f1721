"""The plan of an experiment: signal, limits, what the model foresees, and the controller file that plays it.

Rules of this file: nothing runs here; the same plan, seed and model give the same text. The model only chooses among
signals and warns: what stops an experiment is what is measured.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from math import ceil, inf
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import msgspec
import numpy as np

from hoopd.core.controllers import DONE, Measurement
from hoopd.core.excitation import Excitation
from hoopd.core.records import PICTURE_AGE_S
from hoopd.files.controller import ControllerFile, beyond_own_limits, controller_of, parse_controller
from hoopd.files.reading import InputError
from hoopd.files.yaml_text import text_of
from hoopd.ident import signals
from hoopd.plants.hoop.equations import without_ball
from hoopd.plants.hoop.plant import HoopPlant
from hoopd.plants.model_file import effects_of, parse_model

# Torques to try when none is asked for: 0.1 N m is what the recordings of the real hoop were made with.
AMPLITUDES_NM = (0.1, 0.08, 0.06, 0.05, 0.04, 0.03, 0.02, 0.01)
# Signals to choose from at each torque; the others have nothing random but a sign.
VARIANTS: Mapping[str, int] = MappingProxyType({"prbs": 16, "multisine": 8, "steps": 16})
# Of the limits, what a signal may use on the model: the device is not the model.
COMFORT = 0.8
# Long enough for a thousand rows, or for four kicks with their rests.
DURATIONS_S: Mapping[str, float] = MappingProxyType({"decay": 34.0})
DURATION_S = 20.0
TABLE_DIGITS = 7  # 0.1 uN m


class Plan(NamedTuple):
    """What is wanted."""

    kind: str  # prbs | chirp | multisine | steps | decay
    duration_s: float = 20.0
    amplitude_nm: float | None = None  # None: the largest of `AMPLITUDES_NM` that the model lets through
    seed: int = 0
    clock_ticks: int = 1  # prbs
    low_hz: float = 0.3  # chirp, multisine
    high_hz: float = 5.0
    hold_s: float = 0.4  # steps
    kick_s: float = 0.2  # decay
    rest_s: float = 8.0
    torque_limit_nm: float = 0.3
    speed_limit_rad_s: float = 45.0  # three quarters of what the fault table lets pass
    angle_limit_rad: float = 1.25  # at a quarter turn, 1.57, a slow ball leaves the track
    soft_start_s: float = 1.0
    soft_end_s: float = 0.5
    centring_nm_per_rad_s: float = 0.0
    around: Path | None = None
    model: Path | None = None  # that foresees; None: the filter's
    use_share: float = COMFORT
    ball: bool = True


class Forecast(NamedTuple):
    """What a signal does to the model."""

    hoop_speed_rad_s: float
    ball_angle_rad: float
    ended: str  # `DONE`, or the limit that ended it

    def use(self, plan: Plan) -> float:
        """Share of the limits, 1 at the nearest one."""
        speed = self.hoop_speed_rad_s / plan.speed_limit_rad_s
        return max(speed, self.ball_angle_rad / plan.angle_limit_rad if plan.ball else 0.0)


class FinishedPlan(NamedTuple):
    """A finished plan: what the daemon loads, and what is expected of it."""

    text: str  # hoopd.controller/1
    amplitude_nm: float
    seconds: float
    forecast: Forecast
    warnings: tuple[str, ...]


class _Choice(NamedTuple):
    """A signal that was chosen."""

    use: float  # of the limits, infinite where the model foresees an early end
    file: ControllerFile
    amplitude_nm: float
    forecast: Forecast
    foreseen: bool = False  # a stronger one was too much for the model; else the limits in force let no more pass


def unit_table(plan: Plan, variant: int, period_s: float) -> signals.Signal:
    """The signal with a peak of one, one value a tick; ValueError when the plan's numbers give none."""
    n = round(plan.duration_s / period_s)
    lead = round(plan.soft_start_s / period_s)  # what rests at times begins behind the soft start
    if plan.kind == "prbs":
        order = signals.prbs_order(n, plan.clock_ticks)
        return signals.prbs(order, plan.clock_ticks, variant)[:n]
    if plan.kind == "chirp":
        return signals.chirp(n, period_s, plan.low_hz, plan.high_hz, variant)
    if plan.kind == "multisine":
        return signals.multisine(n, period_s, plan.low_hz, plan.high_hz, variant)
    if plan.kind == "steps":
        body = signals.steps(n - lead, round(plan.hold_s / period_s), variant)
    else:
        body = signals.kicks(n - lead, round(plan.kick_s / period_s), round(plan.rest_s / period_s), variant)
    return np.concatenate((np.zeros(lead), body))


def write_score(plan: Plan, base: ControllerFile, model_text: str, period_s: float) -> FinishedPlan:
    """Choose a signal and write it down; InputError for a plan that cannot be played.

    The limits of `base` are those in force: a signal that they would cut short is not chosen.
    """
    plan = plan._replace(torque_limit_nm=min(plan.torque_limit_nm, base.limits.torque_nm))
    plant = _plant_of(model_text, plan.model or "model", ball=plan.ball)

    def make(variant: int, amplitude_nm: float) -> ControllerFile:
        return _file(plan, base, variant, amplitude_nm, period_s)

    found = _choose(plan, make, plant, period_s)
    table = found.file.gains["table_nm"]
    text = text_of(msgspec.to_builtins(found.file), default_flow_style=None, width=120)
    parse_controller(text, "experiment")
    return FinishedPlan(text, found.amplitude_nm, len(table) * period_s, found.forecast, tuple(_warnings(plan, found)))


def _plant_of(model_text: str, name: str | Path, *, ball: bool) -> HoopPlant:
    """What foresees: the model with those of its effects that act on the state alone; without a ball, without them."""
    model = parse_model(model_text, name)
    if not ball:
        return HoopPlant(model.structure, without_ball(model.structure, model.values()))
    found = effects_of(model).only(lambda effect: effect.acts_now)
    return HoopPlant.with_effects(found) if found else HoopPlant(model.structure, model.values())


def _choose(plan: Plan, make: Callable[[int, float], ControllerFile], plant: HoopPlant, period_s: float) -> _Choice:
    """The first signal that leaves room to every limit, else the one that leaves most; the weakest where all end."""
    best: _Choice | None = None
    refused, strongest = "", 0.0
    for amplitude_nm, variant in _candidates(plan):
        file = make(variant, amplitude_nm)
        try:
            law = _playable(file)
        except ValueError as error:
            refused = str(error)
            continue
        strongest = max(strongest, amplitude_nm)
        forecast = foresee(law, plant, period_s, ball=plan.ball)
        use = forecast.use(plan) if forecast.ended == DONE else inf
        if best is None or use < best.use or (use == best.use == inf and amplitude_nm < best.amplitude_nm):
            best = _Choice(use, file, amplitude_nm, forecast)
        if use <= plan.use_share:
            break
    if best is None:
        raise InputError(f"experiment {plan.kind}", "", refused)
    return best._replace(foreseen=strongest > best.amplitude_nm)


def _playable(file: ControllerFile) -> Excitation:
    """The law of a signal; ValueError where the file's limits would make another one of it."""
    if beyond := beyond_own_limits(file):
        raise ValueError(beyond)
    law = controller_of(file)
    assert isinstance(law, Excitation)
    return law


def _candidates(plan: Plan) -> Iterator[tuple[float, int]]:
    variants = VARIANTS.get(plan.kind, 1)
    usual = [one for one in AMPLITUDES_NM if one <= plan.torque_limit_nm] or [plan.torque_limit_nm]
    for amplitude_nm in usual if plan.amplitude_nm is None else [plan.amplitude_nm]:
        yield from ((amplitude_nm, plan.seed * variants + index) for index in range(variants))


def foresee(law: Excitation, plant: HoopPlant, period_s: float, *, ball: bool = True) -> Forecast:
    """The law on the model, from rest, without noise: the state as it is, the picture's angle as late as it comes."""
    law.reset()
    x, torque, speed, angle = np.zeros(4), 0.0, 0.0, 0.0
    angles = deque([0.0], maxlen=1 + ceil(PICTURE_AGE_S / period_s))
    while True:
        seen = x if ball else np.array([x[0], x[1], 0.0, 0.0])
        angles.append(float(seen[2]))
        psi, dtheta = angles[0], float(seen[1])
        torque, _ = law.update(Measurement(0.0, seen, True, psi, ball, dtheta, 0.0, torque, period_s))
        if law.ended:
            return Forecast(speed, angle if ball else 0.0, law.ended)
        x = plant.advance(x, torque, period_s)
        speed, angle = max(speed, abs(float(x[1]))), max(angle, abs(float(x[2])))


def _file(plan: Plan, base: ControllerFile, variant: int, amplitude_nm: float, period_s: float) -> ControllerFile:
    try:
        table = np.round(amplitude_nm * unit_table(plan, variant, period_s), TABLE_DIGITS) + 0.0  # no -0
    except ValueError as error:
        raise InputError(f"experiment {plan.kind}", "", str(error)) from None
    gains: dict[str, Any] = {
        "table_nm": table.tolist(),
        "torque_nm": plan.torque_limit_nm,
        "hoop_speed_rad_s": plan.speed_limit_rad_s,
        "ball_angle_rad": plan.angle_limit_rad if plan.ball else None,
        "soft_start_ticks": round(plan.soft_start_s / period_s),
        "soft_end_ticks": round(plan.soft_end_s / period_s),
        "centring_nm_per_rad_s": plan.centring_nm_per_rad_s,
        "around": None if plan.around is None else {"kind": base.kind, "gains": base.gains},
    }
    return msgspec.structs.replace(
        base,
        name=plan.kind,
        kind="excitation",
        gains=gains,
        limits=msgspec.structs.replace(base.limits, torque_nm=plan.torque_limit_nm),
        sample_time_s=period_s,
        notes=_notes(plan, variant, amplitude_nm),
    )


def _notes(plan: Plan, variant: int, amplitude_nm: float) -> str:
    particulars = {
        "prbs": f"clock {plan.clock_ticks} ticks",
        "chirp": f"{plan.low_hz:g} to {plan.high_hz:g} Hz",
        "multisine": f"{plan.low_hz:g} to {plan.high_hz:g} Hz",
        "steps": f"{plan.hold_s:g} s each",
        "decay": f"kicks of {plan.kick_s:g} s, rests of {plan.rest_s:g} s",
    }
    around = f", on top of {plan.around.name}" if plan.around else ""
    ball = "" if plan.ball else ", no ball"
    return f"{plan.kind} of {amplitude_nm:g} N m, {particulars[plan.kind]}, variant {variant}{around}{ball}"


def _warnings(plan: Plan, found: _Choice) -> Iterator[str]:
    forecast = found.forecast
    if found.use > plan.use_share:
        seen = f"hoop {forecast.hoop_speed_rad_s:.1f} rad/s, ball {forecast.ball_angle_rad:.2f} rad"
        ends = "" if forecast.ended == DONE else f", and it would end early: {forecast.ended}"
        yield f"little room: the model foresees {seen}{ends}; a smaller --amplitude is safer"
    if plan.centring_nm_per_rad_s or plan.around is not None:
        yield "the torque depends on what was measured (feedback): use methods that hold in closed loop"
    if plan.amplitude_nm is None and found.amplitude_nm < AMPLITUDES_NM[0]:
        why = "the model foresees too much with more" if found.foreseen else "the limits in force let no more pass"
        yield f"{found.amplitude_nm:g} N m, because {why}"
