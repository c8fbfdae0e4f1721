"""From a record of options to the command that it is for: what works on the device, the rig or what they left.

Rules of this file: called by the command line with a record; heavy imports are made inside.
"""

from __future__ import annotations

from typing import Any

import typer

from hoopd.commands.options.calibrate import CalibrateOptions
from hoopd.commands.options.calibration import CalibrationOptions
from hoopd.commands.options.declaration import option_name
from hoopd.commands.options.experiment import ExperimentOptions
from hoopd.commands.options.learn import LearnOptions
from hoopd.commands.options.maneuver import ManeuverOptions
from hoopd.commands.options.replay import ReplayOptions
from hoopd.commands.run_options import run_options
from hoopd.files.reading import InputError

# Of the hoop's signals, s: the least is a tick, but for the whole, which has to reach beyond its soft start.
TIMES_S = {"duration_s": (0.5, 1200.0), "hold_s": (0.02, 600.0), "kick_s": (0.02, 600.0), "rest_s": (0.02, 600.0)}


def experiment(options: ExperimentOptions) -> None:
    """A test signal, played and recorded."""
    from hoopd.commands.output import check_json, print_result, write_json

    check_json(options.json_path)
    if options.plant not in (None, "hoop"):
        from hoopd.commands.plant_experiment import run as simulate

        result = simulate(options)
        write_json(options.json_path, result)
        print_result(result)
        return
    if options.at:
        raise InputError("--at", "", "goes with --plant, and only with it")
    _check_times(options)
    from hoopd.daemon.experiment import run, write_signal
    from hoopd.daemon.recording_target import Where
    from hoopd.plants.hoop.loop.experiment_plan import DURATION_S, DURATIONS_S, Plan

    given = {name: getattr(options, name) for name in Plan._fields if name not in ("duration_s", "ball")}
    asked = {name: value for name, value in given.items() if value is not None}
    seconds = DURATIONS_S.get(options.kind, DURATION_S) if options.duration_s is None else options.duration_s
    plan = Plan(**asked, duration_s=seconds, ball=not options.no_ball)
    rig = run_options(options, arm=options.arm)
    if options.signal_out is not None:
        result = write_signal(plan, rig, options.signal_out)
    else:
        result = run(plan, rig, Where(options.record, options.out), options.figure)
    write_json(options.json_path, result)
    print_result(result)
    raise typer.Exit(result["exit"])


def _check_times(options: ExperimentOptions) -> None:
    for name, (low, high) in TIMES_S.items():
        seconds = getattr(options, name)
        if seconds is not None and not low <= seconds <= high:
            raise InputError(
                option_name(ExperimentOptions, name), "", f"must be {low:g} to {high:g} s, not {seconds:g}"
            )


def maneuver(options: ManeuverOptions) -> None:
    """A planned maneuver, played, recorded and judged."""
    from hoopd.commands.maneuver import run
    from hoopd.commands.output import check_json, print_result, write_json

    check_json(options.json_path)
    result = run(options)
    write_json(options.json_path, result)
    print_result({**result, "attempts": {str(k): _brief(one) for k, one in enumerate(result["attempts"], 1)}})
    raise typer.Exit(result["exit"])


def learn(options: LearnOptions) -> None:
    """Recordings until it is known what the model leaves out."""
    from hoopd.commands.learn import learn as go_on

    go_on(options)


def _brief(attempt: dict[str, Any]) -> dict[str, Any]:
    """A line of the table: what a terminal has room for."""
    short = attempt["shortfalls"] or [attempt["ended"]]
    ended = {"success": attempt["success"], "ended": "; ".join(short)}
    if "tracking" in attempt:  # with --learn; None where nothing was learned
        from hoopd.files.correction import LEARNED

        return {key: attempt[key] for key in LEARNED} | ended
    shown = {key: attempt[key] for key in ("turns", "least_contact", "settled_s", "off_plan_rad")}
    return {"began": attempt["began_s"]} | shown | ended


def calibrate(options: CalibrateOptions) -> None:
    """Where the hoop is in the picture."""
    from hoopd.commands.calibrate import run
    from hoopd.commands.output import print_result

    if options.moving is not None:
        from hoopd.commands.calibrate_moving import run as measure

        print_result({key: value for key, value in measure(options).items() if key != "drawings"})
        return
    if options.model is not None:
        raise InputError("--model", "", "goes with --moving")
    print_result(run(options.picture, options.positions, options.json_path, options.figure, options.save))


def calibration(options: CalibrationOptions) -> None:
    """What was accepted, and back to it."""
    from hoopd.commands.calibration import run
    from hoopd.commands.output import check_json, print_result, write_json

    check_json(options.json_path)
    result = run(options)
    write_json(options.json_path, result)
    print_result({key: value for key, value in result.items() if key != "exit"})
    raise typer.Exit(result["exit"])


def replay(options: ReplayOptions) -> None:
    """A recorded run through the same tick."""
    from hoopd.commands.output import print_result, write_json
    from hoopd.daemon.replay import replay as repeat

    result = repeat(options.recording, run_law=options.run_law)
    write_json(options.json_path, result)
    print_result(result)
    raise typer.Exit(0 if result["equal"] else 1)
