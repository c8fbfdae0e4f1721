"""`hoopd maneuver`: a planned motion from rest at the bottom and back, on the rig or the device, recorded and judged.

Rules of this file: nothing here touches the drive; the maneuver enters the daemon's own tick as every controller does,
behind the same limits, faults and modes. What was recorded stays, and the judgement is of the recording.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Sequence
from itertools import pairwise
from math import hypot, inf, isfinite, nan
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from hoopd.core.controllers import DONE
from hoopd.core.modes import Mode
from hoopd.core.records import TickRecord
from hoopd.core.succession import EXPERIMENT
from hoopd.daemon.app import Options, check_options, perform
from hoopd.daemon.build import Texts, limits_in_force, model_path, read_texts
from hoopd.daemon.maneuver_conductor import REST_PATIENCE_S, SETTLE_S, ManeuverConductor
from hoopd.daemon.recording_target import Where, recorded_parts
from hoopd.daemon.replay import recorded_config
from hoopd.files.controller import ControllerFile, ControllerLimits, beyond_limits, parse_controller
from hoopd.files.loaded_controller import LoadedController, text_of_loaded
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError
from hoopd.files.trajectory import TrajectoryFile, maneuver_controller, trajectory_text
from hoopd.plants.hoop.effects.contact_modes import AIR, INNER
from hoopd.plants.hoop.effects.lift_off import LIFT_OFF
from hoopd.plants.hoop.maneuver.judgement import RecordedManeuver, angle_errors, judge_maneuver
from hoopd.plants.hoop.maneuver.maneuver_question import UP
from hoopd.plants.hoop.maneuver.restitution import RecordedThrow
from hoopd.plants.model_file import load_model, parse_model
from hoopd.recording.mcap import RecordedRun, read_run
from hoopd.shell import config as configuration
from hoopd.shell.config import Config, SimEffect

# A repeat of one maneuver at most as long as it may take: rest, plan, brake of one that is given up, settling.
BRAKE_S = 4.0
# How a run ends that nobody and nothing ended early.
DONE_ALL, NOT_ALL = "done", "not every maneuver succeeded"
# A throw to be looked into: from so many ticks before its flight, for so many; bounces are no other throw.
BEFORE_TICKS, THROW_TICKS, APART_S = 2, 22, 1.0


class AskedManeuver(NamedTuple):
    """Which maneuver, and how often."""

    trajectory: TrajectoryFile
    name: str  # of its file
    repeat: int = 1


def filter_model(options: Options) -> Path:
    """The file of the model that the daemon's filter will use: what a maneuver is planned on unless somebody says
    otherwise."""
    config = configuration.load(options.config, sim=options.sim, overrides=list(options.sets))
    return model_path(config, options.config)


def torque_in_force(options: Options) -> float:
    """The largest torque that a maneuver may ask for, N m."""
    config = configuration.load(options.config, sim=options.sim, overrides=list(options.sets))
    return _in_force(config, read_texts(config, options.config))[2].torque_nm


def run(asked: AskedManeuver, options: Options, where: Where) -> dict[str, Any]:
    """Play, record and judge; `exit` is 0 when every maneuver succeeded."""
    options = options._replace(sets=(*(("sim.psi_rad=0",) if options.sim else ()), *options.sets))
    config = configuration.load(options.config, sim=options.sim, overrides=list(options.sets))
    check_options(options._replace(duration_s=inf), config)
    where.check()
    if options.sim:
        config = _with_flights(config, options.config, asked.trajectory)
    texts = read_texts(config, options.config)
    conductor = ManeuverConductor(_command_text(asked, config, texts), asked.repeat, armed=options.sim or options.arm)
    options = options._replace(duration_s=_longest(asked, options))
    notes = _notes(asked.trajectory, config, texts)
    for note in notes:  # before any torque
        sys.stderr.write(f"hoopd: {asked.name}: {note}\n")
    with recorded_parts(where) as (folder, parts):
        summary = perform(options._replace(record=folder), config, texts, conductor)
    if not parts:
        raise InputError(where.file or folder, "", "nothing could be recorded (see the log)")
    return _told(asked, conductor, summary, parts[0], texts, notes)


def _with_flights(config: Config, config_path: Path | None, trajectory: TrajectoryFile) -> Config:
    """The rig's ball may leave the hoop: one that is glued to it would go round whatever the plan. Of one that is
    thrown, the detector looks for it in the air, and on the inner hoop of the rig's model."""
    model = load_model(configuration.find(config.sim.model, config_path))
    if trajectory.plan.flight is not None:
        vision = msgspec.structs.replace(config.vision, flying=True, inner_px=_inner_px(config, model))
        config = msgspec.structs.replace(config, vision=vision)
    told = {entry.name for entry in model.effects}
    if LIFT_OFF in told | {entry.name for entry in config.sim.effects}:
        return config
    effects = [*config.sim.effects, SimEffect(name=LIFT_OFF)]
    return msgspec.structs.replace(config, sim=msgspec.structs.replace(config.sim, effects=effects))


def _inner_px(config: Config, model: ModelFile) -> float:
    """Where the rig's picture shows a ball on the inner hoop; 0: it has none."""
    inner, v = model.device.inner, model.values()
    if inner is None:
        return 0.0
    return config.vision.circle_px.radius * (inner.radius_m + v["Rb"]) / (v["Ro"] - v["Rb"])


def _longest(asked: AskedManeuver, options: Options) -> float | None:
    """No run that arms by itself lasts longer, whatever happens."""
    each = REST_PATIENCE_S + asked.trajectory.seconds + BRAKE_S + SETTLE_S
    return asked.repeat * each + 5.0 if options.sim or options.arm else None


def _in_force(config: Config, texts: Texts) -> tuple[ControllerFile, ModelFile, ControllerLimits]:
    """The law that a maneuver begins from, the filter's model, and the limits that bound both."""
    base = parse_controller(texts.controller, config.control.file)
    model = parse_model(texts.model, config.device.model or base.model)
    return base, model, limits_in_force(config, model, base)


def _command_text(asked: AskedManeuver, config: Config, texts: Texts) -> str:
    """What the tick is told: the trajectory as a controller with the filter, the model and the limits in force."""
    base, model, limits = _in_force(config, texts)
    if config.control.law or base.kind in ("excitation", "maneuver"):
        raise InputError(config.control.law or config.control.file, "", "is no law that a maneuver could begin from")
    if not config.faults.ball_expected:
        raise InputError("configuration", "faults.ball_expected", "is false, but a maneuver is of the ball")
    sample_time_s = asked.trajectory.sample_time_s
    if abs(sample_time_s - config.loop.period_s) > 1e-9:
        reason = f"planned for {sample_time_s:g} s, the loop's period is {config.loop.period_s:g} s"
        raise InputError(asked.name, "sample_time_s", reason)
    if asked.trajectory.maneuver == UP and model.device.inner is None:
        raise InputError(asked.name, "maneuver", "is a way up to an inner hoop, and the filter's model has none")
    if beyond := beyond_limits(asked.trajectory.plan.torques_nm, limits):
        reason = f"{beyond}: plan with --max-torque, or on a model whose drive gives no more"
        raise InputError(asked.name, "plan.torques_nm", reason)
    loaded = LoadedController(
        file=asked.name,
        sha256=hashlib.sha256(trajectory_text(asked.trajectory).encode()).hexdigest(),
        by="hoopd maneuver",
        controller=maneuver_controller(asked.trajectory, msgspec.structs.replace(base, limits=limits)),
        model=texts.model,
    )
    return text_of_loaded(loaded)


# ---------------------------------------------------------------------------------------------- judgement


def _told(
    asked: AskedManeuver,
    conductor: ManeuverConductor,
    summary: dict[str, Any],
    path: Path,
    texts: Texts,
    notes: list[str],
) -> dict[str, Any]:
    trajectory = asked.trajectory
    attempts = judged(read_run(path), trajectory, texts.model)
    succeeded = sum(one["success"] for one in attempts)
    return {
        "maneuver": trajectory.maneuver,
        "trajectory": asked.name,
        "outcome": conductor.outcome or (DONE_ALL if succeeded == asked.repeat else NOT_ALL),
        "asked_for": asked.repeat,
        "played": len(attempts),
        "succeeded": succeeded,
        "attempts": attempts,
        "file": str(path),
        "faults": summary["faults"],
        "notes": notes,
        "exit": 0 if succeeded == asked.repeat else 1,
    }


def _notes(trajectory: TrajectoryFile, config: Config, texts: Texts) -> list[str]:
    """What has to be known before it is played."""
    if hashlib.sha256(texts.model.encode()).hexdigest() == trajectory.model_sha256:
        return []
    base = parse_controller(texts.controller, config.control.file)
    own = Path(config.device.model or base.model).name
    if own == Path(trajectory.model).name:
        return [f"{own} has changed since the maneuver was planned on it"]
    return [f"planned on {trajectory.model}, and the filter's model is {own}"]


def recorded_maneuvers(run: RecordedRun) -> list[tuple[RecordedManeuver, str]]:
    """Every maneuver of a recording with what came after it, and the reason for its end; none that was switched off
    before its first torque."""
    began = [event.t for event in run.events if event.event == "controller" and event.fields["command"] == EXPERIMENT]
    ended = [(event.t, str(event.fields["reason"])) for event in run.events if event.event == "experiment_ended"]
    missing = [(run.ticks[-1].t, "the run ended")] * (len(began) - len(ended))
    edges = zip(pairwise([*began, inf]), [*ended, *missing], strict=False)
    found = [(_stretch(run, first, following, end_t), reason) for (first, following), (end_t, reason) in edges]
    return [(one, reason) for one, reason in found if len(one.t)]


def recorded_throws(run: RecordedRun) -> list[RecordedThrow]:
    """Every first flight of a maneuver, with its pictures and torques, from two ticks before it."""
    found: list[RecordedThrow] = []
    period_s = recorded_config("the recording", run.header.config).loop.period_s
    for k in range(BEFORE_TICKS + 1, len(run.ticks)):
        begins = run.ticks[k].ball_mode == AIR and run.ticks[k - 1].ball_mode not in ("", AIR)
        if begins and (not found or run.ticks[k].t - found[-1].start_t > APART_S):
            found.append(_throw(run, run.ticks[k - BEFORE_TICKS : k - BEFORE_TICKS + THROW_TICKS], period_s))
    return found


def _throw(run: RecordedRun, ticks: Sequence[TickRecord], period_s: float) -> RecordedThrow:
    seen = [one.camera for one in run.inputs if one.camera is not None and isfinite(one.camera.distance)]
    table = np.array([(c.t, c.direction, c.distance) for c in seen if ticks[0].t < c.t < ticks[-1].t]).reshape(-1, 3)
    return RecordedThrow(np.array(ticks[0].x_hat), ticks[0].t, period_s, np.array([one.u for one in ticks]), *table.T)


def judged(run: RecordedRun, trajectory: TrajectoryFile, model_text: str) -> list[dict[str, Any]]:
    """Every maneuver of a recording: when it was played, how it ended, what became of the ball."""
    model = parse_model(model_text, "model")
    values, inner = model.values(), model.device.inner
    tracks_m = values["Ro"] - values["Rb"], nan if inner is None else inner.radius_m + values["Rb"]
    return [_attempt(trajectory, one, reason, tracks_m, values["g"]) for one, reason in recorded_maneuvers(run)]


def _stretch(run: RecordedRun, first: float, following: float, ended_t: float) -> RecordedManeuver:
    """While the law acts: afterwards a hand may move the ball."""
    # in the tick of the change the law of before has its last torque
    ticks = [tick for tick in run.ticks if first < tick.t <= following and tick.mode == Mode.RUNNING]
    table = np.array([(tick.t, tick.u, *tick.x_hat, tick.psi_t, tick.psi) for tick in ticks]).reshape(-1, 8)
    away = _distances(run)
    distance = np.array([away.get(tick.id, nan) for tick in ticks])
    inner, air = (np.array([tick.ball_mode == mode for tick in ticks], bool) for mode in (INNER, AIR))
    t, u, states, seen_t, seen = table[:, 0], table[:, 1], table[:, 2:6], table[:, 6], table[:, 7]
    return RecordedManeuver(t, u, states, seen_t, seen, ended_t, distance, inner, air)


def _distances(run: RecordedRun) -> dict[int, float]:
    """By tick: how far from the axis its picture shows the ball, in shares of the track; not through a homography."""
    vision = recorded_config("the recording", run.header.config).vision
    if vision.homography is not None:
        return {}
    (x, y), radius = vision.circle_px.centre, vision.circle_px.radius
    seen = ((one.id, one.camera) for one in run.inputs if one.camera is not None)
    return {tick: hypot(camera.x_px - x, camera.y_px - y) / radius for tick, camera in seen}


def _attempt(
    trajectory: TrajectoryFile, run: RecordedManeuver, reason: str, tracks_m: tuple[float, float], gravity: float
) -> dict[str, Any]:
    began, ended = float(run.t[0]), run.ended_t
    outcome = judge_maneuver(run, tracks_m[0], gravity, tracks_m[1])
    states = np.array(trajectory.plan.states)
    short = outcome.shortfalls(trajectory.maneuver, trajectory.turn, float(np.abs(states[:, 2]).max()))
    off = angle_errors(run, states, trajectory.sample_time_s)
    return {
        "began_s": began,
        "played_s": round(ended - began, 6),
        "ended": reason,
        "turns": outcome.turns,
        "least_contact": _number(outcome.least_contact),
        "settled_s": _number(outcome.settled_s),
        "largest_angle_rad": _number(outcome.largest_angle_rad),
        "loose_s": _number(outcome.loose_s),
        "least_distance": _number(outcome.least_distance),
        "top_s": _number(outcome.top_s),
        "off_plan_rad": _number(off.plan),
        "off_estimate_rad": _number(off.estimate),
        "shortfalls": list(short),
        "success": reason == DONE and not short,
    }


def _number(value: float) -> float | None:
    """Four digits; JSON knows no infinity."""
    return float(f"{value:.4g}") if isfinite(value) else None
