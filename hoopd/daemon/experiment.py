"""`hoopd experiment`: a test signal on the rig or the device, recorded.

Rules of this file: nothing here touches the drive; the signal is a law in the daemon's own tick, behind the same
limits, faults and modes, and every way out is the daemon's: brake, disarm, zero torque last. What was recorded stays.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator
from math import inf, isfinite
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hoopd.core.controllers import DONE
from hoopd.core.excitation import BEYOND
from hoopd.core.modes import Mode
from hoopd.daemon.app import Options, check_options, perform
from hoopd.daemon.build import Texts, limits_in_force, read_texts, without_places
from hoopd.daemon.conductor import START_PATIENCE_S, Conductor
from hoopd.daemon.recording_target import Where, recorded_parts
from hoopd.files.controller import ControllerFile, parse_controller
from hoopd.files.reading import InputError, read_text
from hoopd.files.whole_files import check_target, replace_file
from hoopd.ident import signals
from hoopd.plants.hoop.loop.experiment_plan import FinishedPlan, Plan, write_score
from hoopd.plants.model_file import parse_model
from hoopd.recording.mcap import read
from hoopd.recording.recording import Recording
from hoopd.shell import config as configuration
from hoopd.shell.config import Config

KINDS = ("prbs", "chirp", "multisine", "steps", "decay")
# After the signal: braking (a second), and a margin; the end of a lock-step run that never began.
END_PATIENCE_S = 5.0
LATE_FAULTS = frozenset({"board_timeout", "camera_lost", "link_lost"})


def run(plan: Plan, options: Options, where: Where, figure: Path | None = None) -> dict[str, Any]:
    """Play, record, and say what was recorded; `exit` is 0 when the signal was played to its end."""
    options = options._replace(sets=_sets(plan, options))
    config = configuration.load(options.config, sim=options.sim, overrides=list(options.sets))
    check_options(options._replace(duration_s=inf), config)
    _check(plan, config, where, figure)
    config, texts, score = prepared(plan, config, options.config)
    options = options._replace(duration_s=_longest(options, score))
    conductor = Conductor(score.seconds, armed=options.sim or options.arm)
    with recorded_parts(where) as (folder, parts):
        summary = perform(options._replace(record=folder), config, texts, conductor)
    if not parts:
        raise InputError(where.file or folder, "", "nothing could be recorded (see the log)")
    path = parts[0]
    result = told(plan, score, conductor, summary, path, config.loop.period_s)
    result["notes"] += _too_slow(result["faults"], options)
    result["notes"] += [f"the disk failed meanwhile, the rest is in {part}" for part in parts[1:]]
    if figure is not None:
        result["notes"] += _draw(path, plan, figure)
    return result


def write_signal(plan: Plan, options: Options, path: Path) -> dict[str, Any]:
    """The signal as a controller file for a running daemon, around the law that it goes back to; nothing is played."""
    if plan.around is None:
        raise InputError("--signal-out", "", "goes with --around: a running daemon holds the ball meanwhile")
    check_target(path, "--signal-out")
    config = configuration.load(options.config, sim=options.sim, overrides=list(options.sets))
    _check(plan, config, Where(), None)
    _, _, score = prepared(plan, config, options.config)
    replace_file(path, score.text.encode())
    return {
        "experiment": plan.kind,
        "signal": str(path),
        "amplitude_nm": score.amplitude_nm,
        "seconds": score.seconds,
        "foreseen_hoop_speed_rad_s": _short(score.forecast.hoop_speed_rad_s),
        "foreseen_ball_angle_rad": _short(score.forecast.ball_angle_rad),
        "notes": list(score.warnings),
        "next": f"hoopd controller --experiment {shlex.quote(str(path))}",
        "exit": 0,
    }


def prepared(plan: Plan, config: Config, config_path: Path | None) -> tuple[Config, Texts, FinishedPlan]:
    """Configuration and texts of a run with the experiment in the controller's place."""
    change = msgspec.structs.replace
    base_file = config.control.file if plan.around is None else str(plan.around)
    config = change(config, control=change(config.control, law="", file=base_file))
    texts = read_texts(config, config_path)  # with the model that the holding law was designed on
    base = parse_controller(texts.controller, base_file)
    if plan.around is not None:
        _check_holding(plan.around, base, config.loop.period_s)
    model = parse_model(texts.model, config.device.model or base.model)
    base = change(base, limits=limits_in_force(config, model, base))
    foresees = texts.model if plan.model is None else read_text(plan.model)
    score = write_score(plan, base, foresees, config.loop.period_s)
    config = change(config, control=change(config.control, file=f"experiment {plan.kind}"))
    text = configuration.dump(without_places(config))
    return config, texts._replace(config=text, controller=score.text), score


def _sets(plan: Plan, options: Options) -> tuple[str, ...]:
    """Overrides of an experiment: on the rig the ball begins at rest, unless somebody wants it elsewhere."""
    rest = ("sim.psi_rad=0",) if options.sim else ()
    return (*rest, *options.sets, *(() if plan.ball else ("faults.ball_expected=false",)))


def _longest(options: Options, score: FinishedPlan) -> float | None:
    """No run that arms by itself lasts longer, whatever happens."""
    by_itself = options.sim or options.arm
    return START_PATIENCE_S + score.seconds + END_PATIENCE_S if by_itself else None


def _check(plan: Plan, config: Config, where: Where, figure: Path | None) -> None:
    """InputError for what would go wrong only after the run."""
    if plan.kind not in KINDS:
        raise InputError("experiment", "", f"unknown kind {plan.kind!r}; known: {', '.join(KINDS)}")
    if plan.speed_limit_rad_s >= config.faults.hoop_speed_rad_s:
        reason = f"{plan.speed_limit_rad_s:g} rad/s must be below the fault's {config.faults.hoop_speed_rad_s:g}"
        raise InputError("--max-speed", "", reason)
    limit = min(plan.torque_limit_nm, config.limits.torque_nm)
    if plan.amplitude_nm is not None and not 0.0 <= plan.amplitude_nm <= limit:
        raise InputError("--amplitude", "", f"{plan.amplitude_nm:g} N m is outside 0 to the limit of {limit:g}")
    if plan.around is not None and not plan.ball:
        raise InputError("--around", "", "a holding law needs the ball: not together with --no-ball")
    where.check()
    if figure is not None:
        from hoopd.plots.style import check_path

        check_path(figure)


def _check_holding(path: Path, file: ControllerFile, period_s: float) -> None:
    """InputError for a law that cannot hold the ball in this loop."""
    if file.kind in ("excitation", "maneuver"):
        raise InputError(path, "kind", f"{file.kind}: holds nothing, and --around takes a law for the ball")
    if abs(file.sample_time_s - period_s) > 1e-9:
        reason = f"designed for {file.sample_time_s:g} s, the loop's period is {period_s:g} s"
        raise InputError(path, "sample_time_s", reason)


def told(
    plan: Plan, score: FinishedPlan, conductor: Conductor, summary: dict[str, Any], path: Path, period_s: float
) -> dict[str, Any]:
    """What was recorded, judged from the recording."""
    recording = read(path)
    played = recording.extra["mode"] == Mode.RUNNING
    outcome = conductor.outcome or "stopped: by the operator"
    return {
        "experiment": plan.kind,
        "outcome": outcome,
        "limit_passed": BEYOND in outcome,
        "file": str(path),
        "rows": len(recording),
        "played_s": round(int(np.count_nonzero(played)) * period_s, 9),
        "ended_at_s": _short(conductor.ended_t),
        "amplitude_nm": score.amplitude_nm,
        **_extremes(recording, played, period_s, ball=plan.ball),
        "foreseen_hoop_speed_rad_s": _short(score.forecast.hoop_speed_rad_s),
        "foreseen_ball_angle_rad": _short(score.forecast.ball_angle_rad) if plan.ball else None,
        "faults": summary["faults"],
        "notes": [*score.warnings, *_losses(summary["recording"])],
        "next": _next(plan, path) if outcome == DONE else f"hoopd replay {shlex.quote(str(path))}",
        "exit": 0 if outcome == DONE else 1,
    }


def _next(plan: Plan, path: Path) -> str:
    """With a law in the loop the torque depends on what was measured, its noise too: a fit must model the noise."""
    method = " --method prediction" if plan.around is not None or plan.centring_nm_per_rad_s else ""
    return f"hoopd fit {shlex.quote(str(path))}{method} --out model.yaml"


def _extremes(recording: Recording, played: Any, period_s: float, *, ball: bool) -> dict[str, Any]:
    """Largest values while the signal was played, and what its torque covers."""
    u = recording.u[played]
    low, high = signals.coverage(u, period_s) if u.size > 2 else (float("nan"), float("nan"))
    return {
        "largest_torque_nm": _largest(u),
        "largest_hoop_speed_rad_s": _largest(recording.dtheta[played]),
        "largest_ball_angle_rad": _largest(recording.psi[played]) if ball else None,
        "crest_factor": _short(signals.crest_factor(u)),
        "coverage_hz": [_short(low), _short(high)],  # the middle 90 % of the torque's power
        "balance": _short(signals.balance(u)),
    }


def _largest(values: Any) -> float | None:
    known = np.abs(values[np.isfinite(values)])
    return _short(float(known.max())) if known.size else None


def _short(value: float) -> float | None:
    """Six digits of a number: what a person reads, and more than was measured."""
    return float(f"{value:.6g}") if isfinite(value) else None


def _too_slow(faults: Iterable[str], options: Options) -> list[str]:
    """On the rig in real time these faults are the computer's, not the device's."""
    late = LATE_FAULTS & set(faults)
    if not (options.sim and options.speed != "max" and late):
        return []
    return [f"{', '.join(sorted(late))}: the rig did not keep up with real time; --speed max does not mind"]


def _losses(counts: dict[str, Any]) -> Iterator[str]:
    """What the recorder could not do."""
    if counts["dropped"] or counts["failures"]:
        yield f"the recorder lost {counts['dropped']} rows and was refused by the disk {counts['failures']} times"


def _draw(recording: Path, plan: Plan, path: Path) -> list[str]:
    """The figure, or why there is none: the experiment was played and recorded all the same."""
    from hoopd.plots.experiment import ExperimentLimits, draw_experiment
    from hoopd.plots.style import save

    angle = plan.angle_limit_rad if plan.ball else None
    limits = ExperimentLimits(plan.torque_limit_nm, plan.speed_limit_rad_s, angle)
    try:
        save(draw_experiment(read(recording), plan.kind, limits), path)
    except InputError as error:
        return [f"no figure: {error}"]
    return []
