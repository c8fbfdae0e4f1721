"""`hoopd trajectory`: a maneuver planned on a model, with its feedback, written as the files that are played.

Rules of this file: from a model file to a trajectory file and a result, no mathematics; a plan that keeps not every
limit is written nowhere.
"""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from hoopd.commands.options.trajectory import TrajectoryOptions
from hoopd.commands.output_files import check_results
from hoopd.core.health import Thresholds
from hoopd.design.controller_text import controller_text
from hoopd.files.controller import parse_controller
from hoopd.files.model import ModelFile
from hoopd.files.reading import InputError, read_text
from hoopd.files.shipped import or_shipped, way_to
from hoopd.files.trajectory import TrajectoryFile, maneuver_controller, parse_trajectory, trajectory_text
from hoopd.files.whole_files import check_target, replace_file
from hoopd.plants.hoop.maneuver.maneuver_question import UP, ManeuverQuestion
from hoopd.plants.hoop.maneuver.motion_limits import MotionLimits
from hoopd.plants.hoop.maneuver.planning import InfeasibleError
from hoopd.plants.hoop.maneuver.trajectory import PlannedTrajectory, plan_trajectory, trajectory_file
from hoopd.plants.hoop.maneuver.up_planning import CATCH_CONTACT
from hoopd.plants.model_file import parse_model

BASE = Path("controllers/lqg.yaml")
EXTENSIONS = (".yaml", ".yml")
# Of the drive's torque feedback has a third, and where that cannot be, a seventh.
TORQUES_NM = (0.45, 0.6)
# Least force on the contact where nobody says it, in weights of the ball.
USUAL_CONTACT = 0.5


class PlannedFile(NamedTuple):
    """What was planned, and as its file holds it."""

    planned: PlannedTrajectory
    file: TrajectoryFile


def run(options: TrajectoryOptions) -> dict[str, Any]:
    """Plan, write and draw; the result as plain data. InputError: unusable input, or no such plan."""
    check_results(options.out, options.figure)
    for option, path in (("--out", options.out), ("--law", options.law)):
        if path is not None and path.suffix not in EXTENSIONS:
            raise InputError(path, option, f"must end in {' or '.join(EXTENSIONS)}")
    if options.law is not None:
        check_target(options.law, "--law")
    if options.controller is not None and options.law is None:
        raise InputError("--controller", "", "goes with --law, and only with it")
    made = planned(options)
    law = None if options.law is None else _law_text(options, made)
    if options.out is not None:
        replace_file(options.out, trajectory_text(made.file).encode())
    if options.law is not None and law is not None:
        replace_file(options.law, law.encode())
    if options.figure is not None:
        from hoopd.plots.maneuver import draw_plan
        from hoopd.plots.style import save

        save(draw_plan(made.planned, made.file.name), options.figure)
    return _result(options, made)


def planned(options: TrajectoryOptions) -> PlannedFile:
    """The trajectory of a question; InputError."""
    path = or_shipped(options.model)
    text = read_text(path)
    found = plan_on(parse_model(text, options.model), options)
    name = options.kind if options.out is None else options.out.stem
    sha256 = hashlib.sha256(text.encode()).hexdigest()
    return PlannedFile(found, trajectory_file(found, way_to(path, options.out), sha256, name))


def plan_on(model: ModelFile, options: TrajectoryOptions) -> PlannedTrajectory:
    """The plan of a question on a model that was read; InputError."""
    *first, last = TORQUES_NM if options.torque_nm is None else (options.torque_nm,)
    for torque_nm in first:
        with contextlib.suppress(InfeasibleError):
            return _planned(model, options, torque_nm)
    try:
        return _planned(model, options, last)
    except InfeasibleError as error:
        raise InputError(options.model, "", str(error)) from None


def _planned(model: ModelFile, options: TrajectoryOptions, torque_nm: float) -> PlannedTrajectory:
    """InfeasibleError where there is none, InputError for a question without an answer."""
    if options.hoop_speed_rad_s >= (ends := Thresholds().hoop_speed_rad_s):
        raise InputError("--max-speed", "", f"must be below {ends:g} rad/s, where hoop_overspeed ends control")
    if options.kind == UP and options.contact is not None:
        raise InputError("--contact", "", f"cannot be told of up: its catch keeps {CATCH_CONTACT:g}")
    try:
        contact = USUAL_CONTACT if options.contact is None else options.contact
        limits = MotionLimits(torque_nm, options.hoop_speed_rad_s, contact, options.grip)
        question = ManeuverQuestion(
            options.kind,
            limits,
            options.angle_rad,
            options.seconds,
            model.sample_time_s,
            options.turn,
            options.flight_s,
            options.hold_s,
        )
    except ValueError as error:
        raise InputError("trajectory", "", str(error)) from None
    try:
        return plan_trajectory(model, question)
    except InfeasibleError:
        raise
    except ValueError as error:  # a flight that no ball of this hoop has
        raise InputError("trajectory", "", str(error)) from None


def _law_text(options: TrajectoryOptions, made: PlannedFile) -> str:
    """The controller file; InputError where the base's cannot be used, or its limits are narrower than the plan."""
    path = or_shipped(options.controller or BASE)
    base = parse_controller(read_text(path), path)
    parsed = parse_trajectory(trajectory_text(made.file), options.law)
    law = maneuver_controller(
        parsed, msgspec.structs.replace(base, model=way_to(or_shipped(options.model), options.law))
    )
    content = msgspec.to_builtins(law)
    text = controller_text(content, f"Made by hoopd trajectory {options.kind} from {options.model.name}.")
    parse_controller(text, options.law)
    return text


def _result(options: TrajectoryOptions, made: PlannedFile) -> dict[str, Any]:
    file, report = made.file, dict(made.file.report)
    result = {
        "maneuver": file.maneuver,
        "model": file.model,
        **{key: value for key, value in report.items() if key not in ("sensitivity", "tracked")},
        "contact_margin": file.limits.contact,
        "sensitivity": report["sensitivity"],
        "notes": _notes(report),
    }
    written = {"out": options.out, "law": options.law, "figure": options.figure}
    return {**result, **{key: str(path) for key, path in written.items() if path is not None}}


def _notes(report: dict[str, Any]) -> list[str]:
    lost = report["sampled_models"] - report["sampled_models_arrived"]
    if not lost:
        return []
    return [f"with {lost} of {report['sampled_models']} sampled models the ball does not arrive: fit the model first"]
