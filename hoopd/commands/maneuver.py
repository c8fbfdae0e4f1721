"""`hoopd maneuver`: from options to a maneuver on the rig or the device, its judgement and its figure.

Rules of this file: nothing is decided here about the drive; what was recorded stays, whatever becomes of a figure.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import msgspec

from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.commands.run_options import run_options
from hoopd.commands.trajectory import plan_on, planned
from hoopd.daemon.app import Options
from hoopd.daemon.maneuver import AskedManeuver, filter_model, recorded_maneuvers, recorded_throws, run as play
from hoopd.daemon.recording_target import Where
from hoopd.files.model import EffectEntry, ModelFile, Parameter
from hoopd.files.reading import InputError, read_text
from hoopd.files.trajectory import TrajectoryFile, load_trajectory
from hoopd.plants.hoop.effects.lift_off import LIFT_OFF
from hoopd.plants.hoop.maneuver.maneuver_question import THROW
from hoopd.plants.hoop.maneuver.restitution import identify_restitution
from hoopd.plants.hoop.maneuver.trajectory import trajectory_file
from hoopd.plants.model_file import effects_of, load_model
from hoopd.recording.mcap import read_run

# A practice throw falls steeply: what comes back of it bounces for up to a twentieth of a second, seen by pictures.
PRACTICE, PRACTICE_FLIGHT_S = "practice.yaml", 0.2


def run(options: ManeuverOptions) -> dict[str, Any]:
    """Play, record, judge and draw; the result as plain data, with its exit code. InputError."""
    if options.figure is not None:
        from hoopd.plots.style import check_path

        check_path(options.figure)
    rig = run_options(options, arm=options.arm)
    if options.learn:
        from hoopd.commands.maneuver_learning import learnable, learned

        learnable(options)
        trajectory, _ = _trajectory(options, rig)
        result = learned(options, rig, trajectory)
        return _with_figure(result, options, [Path(one["file"]) for one in result["attempts"]], trajectory)
    if options.practice:
        return _after_practice(options, rig)
    trajectory, name = _trajectory(options, rig)
    if options.correction is not None:
        from hoopd.commands.maneuver_learning import with_correction

        trajectory = with_correction(trajectory, options.correction, options, rig)
    return _played(options, rig, trajectory, name)


def _played(options: ManeuverOptions, rig: Options, trajectory: TrajectoryFile, name: str) -> dict[str, Any]:
    result = play(AskedManeuver(trajectory, name, options.repeat), rig, Where(options.record, options.out))
    return _with_figure(result, options, [Path(result["file"])], trajectory)


def _after_practice(options: ManeuverOptions, rig: Options) -> dict[str, Any]:
    """Practice throws with long bounces, the restitution that they show, and the throw that is planned with it."""
    if options.correction is not None:
        raise InputError("--practice", "", "plans anew: without --correction, which is of a plan from before")
    if options.kind != THROW or options.trajectory is not None:
        raise InputError("--practice", "", "goes with throw, and plans it anew: without --trajectory")
    path = filter_model(rig)
    model = load_model(path)
    asked = TrajectoryOptions(kind=THROW, model=path, flight_s=PRACTICE_FLIGHT_S)
    out = None if options.out is None else options.out.with_name(f"{options.out.stem}_practice{options.out.suffix}")
    practice = play(AskedManeuver(planned(asked).file, PRACTICE, options.practice), rig, Where(options.record, out))
    told: dict[str, Any] = {"throws": practice["played"], "file": practice["file"], "faults": practice["faults"]}
    try:
        found = identify_restitution(effects_of(model), recorded_throws(read_run(Path(practice["file"]))))
    except ValueError as error:
        return {**practice, "practice": told, "notes": [*practice["notes"], f"no restitution: {error}"], "exit": 1}
    told |= {"restitution": found.value, "ci95": [found.low, found.high], "pictures": found.pictures,
             "explained": found.throws}  # fmt: skip
    trajectory = planned_with(model, TrajectoryOptions(kind=THROW, model=path), found.value)
    return {**_played(options, rig, trajectory, f"{THROW}.yaml"), "practice": told}


def planned_with(model: ModelFile, options: TrajectoryOptions, restitution: float) -> TrajectoryFile:
    """The trajectory on a model whose ball bounces so."""
    others = [one for one in model.effects if one.name != LIFT_OFF]
    own = next((one for one in model.effects if one.name == LIFT_OFF), EffectEntry(LIFT_OFF))
    told = {**own.parameters, "restitution": Parameter(value=round(restitution, 4), unit="-")}
    bounces = msgspec.structs.replace(own, parameters=told)
    found = plan_on(msgspec.structs.replace(model, effects=[*others, bounces]), options)
    sha256 = hashlib.sha256(read_text(options.model).encode()).hexdigest()
    return trajectory_file(found, options.model.name, sha256, options.kind)


def _trajectory(options: ManeuverOptions, rig: Options) -> tuple[TrajectoryFile, str]:
    """The file's, or one that is planned now on the model that the filter uses."""
    if options.trajectory is None:
        asked = TrajectoryOptions(kind=options.kind, model=filter_model(rig))
        return planned(asked).file, f"{options.kind}.yaml"
    file = load_trajectory(options.trajectory)
    if file.maneuver != options.kind:
        raise InputError(options.trajectory, "maneuver", f"is a {file.maneuver}, no {options.kind}")
    return file, options.trajectory.name


def _with_figure(
    result: dict[str, Any], options: ManeuverOptions, recordings: list[Path], trajectory: TrajectoryFile
) -> dict[str, Any]:
    """The figure, or a note why there is none: the maneuver was played and recorded all the same."""
    if options.figure is None:
        return result
    from hoopd.plots.maneuver import draw_maneuver
    from hoopd.plots.style import save

    try:
        runs = [run for one in recordings for run, _ in recorded_maneuvers(read_run(one))]
        save(draw_maneuver(runs, trajectory), options.figure)
    except InputError as error:
        result["notes"].append(f"no figure: {error}")
    return result
