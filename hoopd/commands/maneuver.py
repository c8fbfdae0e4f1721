"""`hoopd maneuver`: from options to a maneuver on the rig or the device, its judgement and its figure.

Rules of this file: nothing is decided here about the drive; what was recorded stays, whatever becomes of a figure.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.commands.run_options import run_options
from hoopd.commands.trajectory import planned
from hoopd.daemon.app import Options
from hoopd.daemon.maneuver import AskedManeuver, filter_model, recorded_maneuvers
from hoopd.daemon.maneuver import run as play
from hoopd.daemon.recording_target import Where
from hoopd.files.reading import InputError
from hoopd.files.trajectory import TrajectoryFile, load_trajectory
from hoopd.recording.mcap import read_run


def run(options: ManeuverOptions) -> dict[str, Any]:
    """Play, record, judge and draw; the result as plain data, with its exit code. InputError."""
    if options.figure is not None:
        from hoopd.plots.style import check_path

        check_path(options.figure)
    rig = run_options(options, arm=options.arm)
    trajectory, name = _trajectory(options, rig)
    result = play(AskedManeuver(trajectory, name, options.repeat), rig, Where(options.record, options.out))
    if options.figure is not None:
        result["notes"] += _draw(Path(result["file"]), trajectory, options.figure)
    return result


def _trajectory(options: ManeuverOptions, rig: Options) -> tuple[TrajectoryFile, str]:
    """The file's, or one that is planned now on the model that the filter uses."""
    if options.trajectory is None:
        asked = TrajectoryOptions(kind=options.kind, model=filter_model(rig))
        return planned(asked).file, f"{options.kind}.yaml"
    file = load_trajectory(options.trajectory)
    if file.maneuver != options.kind:
        raise InputError(options.trajectory, "maneuver", f"is a {file.maneuver}, no {options.kind}")
    return file, options.trajectory.name


def _draw(recording: Path, trajectory: TrajectoryFile, path: Path) -> list[str]:
    """The figure, or why there is none: the maneuver was played and recorded all the same."""
    from hoopd.plots.maneuver import draw_maneuver
    from hoopd.plots.style import save

    try:
        save(draw_maneuver([run for run, _ in recorded_maneuvers(read_run(recording))], trajectory), path)
    except InputError as error:
        return [f"no figure: {error}"]
    return []
