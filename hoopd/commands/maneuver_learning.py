"""`hoopd maneuver --learn`: attempts one after another, each played with what the ones before have taught.

An attempt is a run of its own, recorded and judged as every maneuver. What the plan's model leaves unexplained of it
goes into the correction beside the trajectory. An attempt that was not played to its end, or in which the ball left the
hoop, teaches nothing and ends it; so does one that is clearly worse than the best. Then the correction of the best one
that was played is the next one's.

Rules of this file: torques of a correction stay within their limit, and everything else that bounds a maneuver stays as
it is; on the disk are always the next correction, and the best that was played.
"""

from __future__ import annotations

import contextlib
import hashlib
import signal
import threading
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.commands.smoothed_attempt import SmoothedAttempt, smoothed_attempt
from hoopd.daemon.app import Options
from hoopd.daemon.maneuver import DONE_ALL, NOT_ALL, AskedManeuver, run as play, torque_in_force
from hoopd.daemon.recording_target import Where
from hoopd.files.correction import (
    LEARNED,
    LIMIT_SHARE,
    BestCorrection,
    CorrectionFile,
    LearnedAttempt,
    corrected,
    correction_beside,
    correction_text,
    load_correction,
)
from hoopd.files.reading import InputError, read_text
from hoopd.files.shipped import or_shipped
from hoopd.files.trajectory import TrajectoryFile, rounded, short
from hoopd.files.whole_files import check_target, replace_file
from hoopd.plants.found_effects import FoundEffects
from hoopd.plants.hoop.loop.writeback import delays_of
from hoopd.plants.hoop.maneuver.iterative_learning import LearnedMotion, mean_of_attempts, tracking_cost, unexplained
from hoopd.plants.hoop.maneuver.maneuver_question import LOOP, SWING
from hoopd.plants.hoop.maneuver.planning_model import PlanningModel
from hoopd.plants.hoop.maneuver.trajectory import USUAL_WEIGHTS
from hoopd.plants.model_file import effects_of, parse_model

Array = NDArray[np.float64]

# So much worse than the best attempt, and nothing more is tried; what is nearer than CHANCE is alike.
WORSE, CHANCE = 1.2, 0.05


class _Learner:
    """What is known of one trajectory."""

    def __init__(self, trajectory: TrajectoryFile, path: Path, model: FoundEffects, limit_nm: float) -> None:
        """`limit_nm`: the torque in force."""
        self.path, self.trajectory, self.model, self.limit_nm = path, trajectory, model, limit_nm
        self.sha256 = _sha256(path)
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
        """Take one attempt more into the correction, and say what it was like."""
        tick_s, file = self.trajectory.sample_time_s, self.file
        by_estimate = self.motion.by_estimate(attempt.estimates - attempt.states[:-1], tick_s)
        left = unexplained(self.step, attempt.states, attempt.torques, tick_s) + by_estimate
        low, high = self._bounds()
        played = np.clip(file.torques_nm, low, high)
        told = LearnedAttempt(
            recording=recording,
            correction_nm=short(np.abs(played).max()),
            tracking=short(tracking_cost((attempt.planned_states - self.states)[1:], USUAL_WEIGHTS)),
            feedback_nm=short(np.sqrt(np.mean((attempt.torques - self.torques - played) ** 2))),
            success=success,
        )
        mean = mean_of_attempts(np.array(file.unexplained), len(file.attempts), left)
        best = file.best
        if best is None or told.tracking < best.tracking:
            best = BestCorrection(tracking=told.tracking, torques_nm=rounded(played.tolist()))
        self.file = msgspec.structs.replace(
            file,
            torques_nm=rounded(np.clip(self.motion.correction(mean, low, high), low, high).tolist()),
            unexplained=rounded(mean.tolist()),
            attempts=[*file.attempts, told],
            best=best,
        )
        return told

    def _bounds(self) -> tuple[Array, Array]:
        """Of a correction, row by row: its own limit, and the torque in force less the plan's."""
        own = self.file.limit_nm
        return np.maximum(-own, -self.limit_nm - self.torques), np.minimum(own, self.limit_nm - self.torques)

    def next_attempt(self) -> TrajectoryFile:
        """The trajectory with the correction as it is now."""
        return corrected(self.trajectory, self.file.torques_nm, self.limit_nm)

    @property
    def played(self) -> int:
        """Attempts until now, whether they taught anything or not."""
        return len(self.file.attempts) + self.file.untaught

    def count_untaught(self) -> None:
        """One attempt more was played, and taught nothing."""
        self.file = msgspec.structs.replace(self.file, untaught=self.file.untaught + 1)

    def go_back(self) -> None:
        """Let the next attempt be played as the best one was."""
        if self.file.best is not None:
            self.file = msgspec.structs.replace(self.file, torques_nm=self.file.best.torques_nm)

    def write(self) -> None:
        """Put it beside the trajectory, at once."""
        replace_file(self.target, correction_text(self.file).encode())


def learned(options: ManeuverOptions, rig: Options, trajectory: TrajectoryFile) -> dict[str, Any]:
    """Play attempts with what was learned in between; the result as plain data, with its exit code. InputError."""
    learner = _learner(trajectory, learnable(options), torque_in_force(rig))
    for k in range(options.repeat):
        _where(options, k).check()
    learner.write()
    rows: list[dict[str, Any]] = []
    faults: Counter[str] = Counter()
    notes: dict[str, None] = {}
    outcome = DONE_ALL
    for k in range(options.repeat):
        try:
            result = _attempt(options, rig, learner, k)
        except InputError as error:
            if not rows:
                raise
            outcome = f"attempt {k + 1} was not played: {error}"
            break
        told = (result["attempts"] or [_not_begun(result)])[0]
        rows.append({**dict.fromkeys(LEARNED), "file": result["file"], **told})
        faults.update(result["faults"])
        notes |= dict.fromkeys(result["notes"])
        with _interrupt_kept() as interrupted:
            outcome = _taught(learner, result, rows[-1], k)
            learner.write()
        if interrupted and outcome == DONE_ALL:
            outcome = "interrupted: what was played is learned"
        if outcome == DONE_ALL and not rows[-1]["success"] and not options.sim:
            outcome = "an attempt did not succeed: look at it, and begin again, which goes on from here"
        if outcome != DONE_ALL:
            break
    if outcome == DONE_ALL and not rows[-1]["success"]:
        outcome = "the last attempt did not succeed"
    return {
        "maneuver": learner.trajectory.maneuver,
        "trajectory": learner.path.name,
        "outcome": outcome,
        "asked_for": options.repeat,
        "played": len(rows),
        "succeeded": sum(bool(row["success"]) for row in rows),
        "attempts": rows,
        "correction": str(learner.target),
        "correction_limit_nm": learner.file.limit_nm,
        "faults": dict(faults),
        "notes": [*notes],
        "exit": 0 if outcome == DONE_ALL else 1,
    }


@contextlib.contextmanager
def _interrupt_kept() -> Iterator[list[int]]:
    """Ctrl-C waits until what was played is learned and written; in the list is whether there was one."""
    seen: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield seen
        return
    before = signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    try:
        yield seen
    finally:
        signal.signal(signal.SIGINT, before)


def _taught(learner: _Learner, result: dict[str, Any], row: dict[str, Any], k: int) -> str:
    """Learn from an attempt what can be; DONE_ALL, or why nothing more is tried."""
    ended_early = result["outcome"] not in (DONE_ALL, NOT_ALL)  # by somebody or something
    try:
        if not result["attempts"]:
            raise ValueError(result["outcome"])
        if off := _off_the_way(learner.trajectory, row):
            raise ValueError(off)
        attempt = smoothed_attempt(Path(result["file"]), learner.trajectory, learner.model)
    except (ValueError, InputError) as error:
        learner.count_untaught()
        if not ended_early:
            learner.go_back()
        why = f"{result['outcome']}: {error}" if ended_early and str(error) != result["outcome"] else str(error)
        return f"nothing was learned of attempt {k + 1}: {why}"
    best = learner.file.best
    told = learner.learn(attempt, recording=Path(result["file"]).name, success=row["success"])
    row |= {key: getattr(told, key) for key in LEARNED}
    if best is not None and told.tracking > max(WORSE * best.tracking, best.tracking + CHANCE):
        learner.go_back()
        return f"attempt {k + 1} was worse than the best: the next one is played as that was"
    return str(result["outcome"]) if ended_early else DONE_ALL


def _off_the_way(trajectory: TrajectoryFile, row: dict[str, Any]) -> str:
    """Why a ball's motion is not the model's to explain; empty where it is."""
    if row["turns"] is None or row["least_contact"] is None:
        return "too little was recorded of it"
    if row["least_contact"] <= 0.0:
        return "the ball left the hoop"
    wanted = trajectory.turn if trajectory.maneuver == LOOP else 0
    return "" if row["turns"] == wanted else f"it went round {row['turns']:+d} times, not {wanted:+d}"


def with_correction(
    trajectory: TrajectoryFile, correction: Path, options: ManeuverOptions, rig: Options
) -> TrajectoryFile:
    """The trajectory with the best correction of a file that was played, or its first one; InputError."""
    if options.trajectory is None:
        raise InputError("--correction", "", "goes with --trajectory, on which it was learned")
    file = load_correction(correction, trajectory, _sha256(options.trajectory))
    torques_nm = file.torques_nm if file.best is None else file.best.torques_nm
    return corrected(trajectory, torques_nm, torque_in_force(rig))


def learnable(options: ManeuverOptions) -> Path:
    """The trajectory's file; InputError for options that nothing can be learned with."""
    if options.kind not in (LOOP, SWING):
        raise InputError("--learn", "", f"goes with {LOOP} and {SWING}: in a flight the ball is not moved by the hoop")
    if options.trajectory is None:
        raise InputError("--learn", "", "needs --trajectory FILE: the correction is written beside it")
    if options.practice:
        raise InputError("--learn", "", "goes without --practice, which plans a throw")
    if options.correction is not None:
        raise InputError("--learn", "", "goes on with the correction beside the trajectory: without --correction")
    return options.trajectory


def _learner(trajectory: TrajectoryFile, path: Path, limit_nm: float) -> _Learner:
    """InputError for a trajectory of which nothing can be learned."""
    check_target(correction_beside(path), "--learn")
    model = _planned_on(trajectory, path)
    if late_s := delays_of(model).torque_s:
        reason = f"its torque is late by {1e3 * late_s:.3g} ms: of such a plan nothing is learned yet"
        raise InputError(path, "model", reason)
    return _Learner(trajectory, path, model, limit_nm)


def _planned_on(trajectory: TrajectoryFile, path: Path) -> FoundEffects:
    """The very model that a trajectory was planned on; InputError."""
    for model in (path.parent / trajectory.model, or_shipped(Path(trajectory.model))):
        with contextlib.suppress(InputError):
            text = read_text(model)
            if hashlib.sha256(text.encode()).hexdigest() == trajectory.model_sha256:
                return effects_of(parse_model(text, model))
    raise InputError(path, "model", f"{trajectory.model} is not, or no longer, the model that it was planned on")


def _attempt(options: ManeuverOptions, rig: Options, learner: _Learner, k: int) -> dict[str, Any]:
    """One run: its own file, and on the rig its own noise, another one than of all attempts before."""
    asked = AskedManeuver(learner.next_attempt(), learner.path.name)
    return play(asked, rig._replace(seed=rig.seed + learner.played), _where(options, k))


def _where(options: ManeuverOptions, k: int) -> Where:
    """Recordings of attempts stand side by side."""
    out = options.out
    return Where(options.record, None if out is None else out.with_name(f"{out.stem}_{k + 1}{out.suffix}"))


def _not_begun(result: dict[str, Any]) -> dict[str, Any]:
    """A run without an attempt, as an attempt is told."""
    unknown = dict.fromkeys(("began_s", "turns", "least_contact", "settled_s", "off_plan_rad"))
    return {**unknown, "ended": result["outcome"], "shortfalls": [], "success": False}


def _sha256(path: Path) -> str:
    return hashlib.sha256(read_text(path).encode()).hexdigest()
