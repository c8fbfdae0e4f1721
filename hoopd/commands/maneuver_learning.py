"""`hoopd maneuver --learn`: attempts one after another, each played with what the ones before have taught.

An attempt is a run of its own, recorded and judged as every maneuver. Its motion is smoothed by the likelihood that a
diagnosis uses, on the model of the plan; what that model leaves unexplained goes into the correction beside the
trajectory. An attempt that was given up teaches nothing, and ends it; one that is worse than the best so far ends it
with the correction of the best.

Rules of this file: torques of a correction stay within their limit, and everything else that bounds a maneuver stays as
it is; the correction on the disk is always one that was played, or follows from attempts that were played to their end.
"""

from __future__ import annotations

import hashlib
import math
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.daemon.app import Options
from hoopd.daemon.maneuver import DONE_ALL, NOT_ALL, AskedManeuver, recorded_maneuvers
from hoopd.daemon.maneuver import run as play
from hoopd.daemon.recording_target import Where
from hoopd.diagnose.inputs import source_of
from hoopd.files.correction import (
    CorrectionFile,
    LearnedAttempt,
    corrected,
    correction_beside,
    correction_text,
    load_correction,
)
from hoopd.files.reading import InputError, read_text
from hoopd.files.shipped import or_shipped
from hoopd.files.trajectory import TrajectoryFile, load_trajectory, rounded
from hoopd.files.whole_files import check_target, replace_file
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.maneuver.iterative_learning import (
    LearnedMotion,
    mean_of_attempts,
    tracking_cost,
    unexplained,
)
from hoopd.plants.hoop.maneuver.maneuver_question import LOOP, SWING
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel
from hoopd.plants.hoop.maneuver.trajectory import USUAL_WEIGHTS
from hoopd.plants.likelihood.fitting import fit
from hoopd.plants.model_file import effects_of, parse_model
from hoopd.recording.mcap import read, read_run

Array = NDArray[np.float64]

# Of the torque that the plan keeps: a correction is small beside what it corrects.
LIMIT_SHARE = 0.25
# So much worse than the best attempt, and nothing more is tried.
WORSE = 1.2
# Of the recording around an attempt, s, so that the smoother knows what was before and after.
MARGIN_S = 1.0


class SmoothedAttempt(NamedTuple):
    """One, as the plan sees it: a row a tick."""

    states: Array  # (n + 1, 4) smoothed, of the plan's own zero
    estimates: Array  # (n, 4) of the filter, which feedback had
    torques: Array  # (n,) N m


class _Learner:
    """What is known of one trajectory."""

    def __init__(self, trajectory: TrajectoryFile, path: Path, model: FoundEffects) -> None:
        self.path, self.trajectory = path, trajectory
        self.sha256 = _sha256(path)
        self.found = model
        plan = trajectory.plan
        self.states, self.torques = np.array(plan.states), np.array(plan.torques_nm)
        self.step = PlanningModel(model).step(trajectory.sample_time_s)
        self.motion = LearnedMotion.about(self.step, self.states, self.torques, np.array(plan.feedback), USUAL_WEIGHTS)
        self.target = correction_beside(path)
        self.file = load_correction(self.target, trajectory, self.sha256) if self.target.exists() else self._nothing()

    def _nothing(self) -> CorrectionFile:
        n = len(self.torques)
        return CorrectionFile(
            schema="hoopd.correction/1",
            trajectory=self.path.name,
            trajectory_sha256=self.sha256,
            limit_nm=rounded(LIMIT_SHARE * self.trajectory.limits.torque_nm),
            torques_nm=[0.0] * n,
            unexplained=[[0.0] * 4] * n,
            attempts=[],
        )

    def learn(self, attempt: SmoothedAttempt, *, recording: str, success: bool) -> LearnedAttempt:
        """One attempt more."""
        tick_s = self.trajectory.sample_time_s
        left = unexplained(self.step, attempt.states, attempt.torques, tick_s)
        left += self.motion.by_estimate(attempt.estimates - attempt.states[:-1], tick_s)
        off = attempt.states[1:] - self.states[1:]
        before = np.array(self.file.torques_nm)
        one = LearnedAttempt(
            recording=recording,
            correction_nm=_short(np.abs(before).max()),
            tracking=_short(tracking_cost(off, USUAL_WEIGHTS)),
            feedback_nm=_short(np.sqrt(np.mean((attempt.torques - self.torques - before) ** 2))),
            success=success,
        )
        known = np.array(self.file.unexplained) if self.file.attempts else None
        mean = mean_of_attempts(known, len(self.file.attempts), left)
        correction = self.motion.correction(mean, self.file.limit_nm)
        self.file = msgspec.structs.replace(
            self.file,
            torques_nm=rounded(np.clip(correction, -self.file.limit_nm, self.file.limit_nm).tolist()),
            unexplained=rounded(mean.tolist()),
            attempts=[*self.file.attempts, one],
        )
        return one

    def write(self) -> None:
        """Beside the trajectory, at once."""
        replace_file(self.target, correction_text(self.file).encode())


def learned(options: ManeuverOptions, rig: Options) -> dict[str, Any]:
    """Attempts with what was learned in between; the result as plain data, with its exit code. InputError."""
    learner = _learner(options)
    for k in range(options.repeat):
        _where(options, k).check()
    rows: list[dict[str, Any]] = []
    outcome, best, of_best = DONE_ALL, math.inf, learner.file
    for k in range(options.repeat):
        played_with = learner.file
        result = _attempt(options, rig, corrected(learner.trajectory, played_with), k)
        rows.append({"file": result["file"], **(result["attempts"] or [_not_begun(result)])[0]})
        attempt = _smoothed(learner, Path(result["file"])) if result["attempts"] else None
        if attempt is None:
            outcome = f"attempt {k + 1} was not played to its end ({rows[-1]['ended']}): nothing was learned of it"
            break
        one = learner.learn(attempt, recording=Path(result["file"]).name, success=rows[-1]["success"])
        rows[-1] |= {"tracking": one.tracking, "feedback_nm": one.feedback_nm, "correction_nm": one.correction_nm}
        if one.tracking > WORSE * best:
            learner.file = msgspec.structs.replace(of_best, attempts=learner.file.attempts)
            outcome = f"attempt {k + 1} was worse than the best before it: the correction of that one stays"
        elif one.tracking < best:
            best, of_best = one.tracking, played_with
        learner.write()
        if result["outcome"] not in (DONE_ALL, NOT_ALL):  # somebody or something ended the run
            outcome = result["outcome"]
        if outcome != DONE_ALL:
            break
    if not rows[-1]["success"] and outcome == DONE_ALL:
        outcome = "the last attempt did not succeed"
    return {
        "maneuver": learner.trajectory.maneuver,
        "trajectory": learner.path.name,
        "outcome": outcome,
        "asked_for": options.repeat,
        "played": len(rows),
        "succeeded": sum(bool(one["success"]) for one in rows),
        "attempts": rows,
        "correction": str(learner.target),
        "correction_limit_nm": learner.file.limit_nm,
        "notes": [],
        "exit": 0 if outcome == DONE_ALL else 1,
    }


def with_correction(trajectory: TrajectoryFile, path: Path | None, correction: Path) -> TrajectoryFile:
    """A trajectory with what a correction file says of it; InputError."""
    if path is None:
        raise InputError("--correction", "", "goes with --trajectory, on which it was learned")
    return corrected(trajectory, load_correction(correction, trajectory, _sha256(path)))


def _learner(options: ManeuverOptions) -> _Learner:
    """InputError for what cannot be learned."""
    if options.kind not in (LOOP, SWING):
        raise InputError("--learn", "", f"goes with {LOOP} and {SWING}: in a flight the ball is not moved by the hoop")
    if options.trajectory is None:
        raise InputError("--learn", "", "needs --trajectory FILE: the correction is written beside it")
    if options.practice:
        raise InputError("--learn", "", "goes without --practice, which plans a throw")
    if options.correction is not None:
        raise InputError("--learn", "", "goes on with the correction beside the trajectory: without --correction")
    trajectory = load_trajectory(options.trajectory)
    if trajectory.maneuver != options.kind:
        raise InputError(options.trajectory, "maneuver", f"is a {trajectory.maneuver}, no {options.kind}")
    check_target(correction_beside(options.trajectory), "--learn")
    return _Learner(trajectory, options.trajectory, planned_on(trajectory, options.trajectory))


def planned_on(trajectory: TrajectoryFile, path: Path) -> FoundEffects:
    """The very model that a trajectory was planned on; InputError."""
    model = or_shipped(path.parent / trajectory.model)
    if not model.exists():
        model = or_shipped(Path(trajectory.model))
    text = read_text(model)
    if hashlib.sha256(text.encode()).hexdigest() != trajectory.model_sha256:
        raise InputError(path, "model", f"{trajectory.model} is no longer the model that it was planned on: plan again")
    return effects_of(parse_model(text, model))


def _attempt(options: ManeuverOptions, rig: Options, trajectory: TrajectoryFile, k: int) -> dict[str, Any]:
    """One run: its own file, and on the rig its own noise."""
    name = "" if options.trajectory is None else options.trajectory.name
    return play(AskedManeuver(trajectory, name), rig._replace(seed=rig.seed + k), _where(options, k))


def _where(options: ManeuverOptions, k: int) -> Where:
    """Recordings of attempts stand side by side."""
    out = options.out
    return Where(options.record, None if out is None else out.with_name(f"{out.stem}_{k + 1}{out.suffix}"))


def _not_begun(result: dict[str, Any]) -> dict[str, Any]:
    """As an attempt is told."""
    unknown = dict.fromkeys(("began_s", "turns", "least_contact", "settled_s"))
    return {**unknown, "ended": result["outcome"], "shortfalls": [], "success": False}


def _sha256(path: Path) -> str:
    return hashlib.sha256(read_text(path).encode()).hexdigest()


def _smoothed(learner: _Learner, path: Path) -> SmoothedAttempt | None:
    """The one attempt of a recording at the edges of its ticks; None where it was not played to its end."""
    run, _ = recorded_maneuvers(read_run(path))[0]
    n, tick_s = len(learner.torques), learner.trajectory.sample_time_s
    played = run.t < run.ended_t - 1e-9
    if int(played.sum()) != n or len(run.t) <= n:
        return None
    edges = run.t[0] + tick_s * np.arange(n + 1)
    states = _states_at(learner.found, path, edges)
    zero = np.array([run.states[0, 0], 0.0, run.bottom, 0.0])
    return SmoothedAttempt(states - zero, run.states[:n] - zero, run.torques[:n])


def _states_at(found: FoundEffects, path: Path, t: Array) -> Array:
    """(n, 4) smoothed states at times of a recording, by the model with disturbances as large as it needs."""
    recording = read(path)
    source = source_of(str(path), recording, found.plant)
    begin = float(recording.t[0])
    part = max(source.stretches, key=lambda one: len(one.t)).seconds(t[0] - begin - MARGIN_S, t[-1] - begin + MARGIN_S)
    smooth = fit([part], found.effects(), found.values, free=(), move=False)
    track = smooth.tracks[0]
    at = track.stretch.t + begin
    return np.column_stack([np.interp(t, at, track.z[:, i]) for i in range(4)])


def _short(value: float) -> float:
    """Four digits: what a person compares."""
    return float(f"{float(value):.4g}")
