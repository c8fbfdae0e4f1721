"""`hoopd compare`: two controllers take turns, on the rig or in a daemon that runs.

Rules of this file: it commands what an operator could; the accepted controller acts before and after it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from hoopd.commands.options.compare import CompareOptions
from hoopd.commands.options.shared import check_files, finish, shown_progress
from hoopd.commands.output import check_json
from hoopd.commands.output_files import check_results
from hoopd.commands.run_options import run_options
from hoopd.files.reading import InputError

if TYPE_CHECKING:
    from hoopd.design.alternation import Alternation
    from hoopd.design.comparison import ControllerComparison

FIRST_S = 4.0  # until a running daemon has told of itself
LOOK_S = 0.2


def compare(options: CompareOptions) -> None:
    """Which of two controllers is better; exit code 1 when the run was cut short or the candidate went back."""
    from hoopd.design.comparison import RETURNED, STOPPED

    options = _found(options)
    check_files([options.accepted, options.candidate], figure=options.figure, json=options.json_path)
    check_results(None, options.figure)
    check_json(options.json_path)
    with shown_progress() as progress:
        result = run(options, lambda comparison: progress(comparison.step))
    if options.figure is not None:
        draw(result, options.figure)
    finish(result, options.json_path, _shown(result))
    raise typer.Exit(1 if result["verdict"] in (RETURNED, STOPPED) else 0)


def _found(options: CompareOptions) -> CompareOptions:
    """With the files that the names stand for: beside the configuration, here, or shipped."""
    from hoopd.shell.config import find

    accepted, candidate = (find(str(one), options.config) for one in (options.accepted, options.candidate))
    return replace(options, accepted=accepted, candidate=candidate)


def run(options: CompareOptions, progress: Callable[[ControllerComparison], None] | None = None) -> dict[str, Any]:
    """The result as plain data."""
    from hoopd.daemon.comparison import run as on_the_rig

    plan = plan_of(options)
    if options.sim:
        rig = run_options(options, record=options.record, speed="max")
        return on_the_rig(options.accepted, options.candidate, plan, rig, progress, by=options.by)
    if options.record is not None:
        raise InputError("--record", "", "goes with --sim: a running daemon records by itself")
    return _in_a_daemon(options, plan, progress or (lambda comparison: None))


def plan_of(options: CompareOptions) -> Alternation:
    """The plan; InputError for numbers that give none."""
    from hoopd.design.alternation import Alternation
    from hoopd.design.comparison import MEASURES

    if options.by not in MEASURES:
        raise InputError("--by", "", f"{options.by!r} is none of {', '.join(MEASURES)}")
    try:
        return Alternation(
            options.blocks, options.settle_s, options.hold_s, options.amplitude_rad, options.alpha, options.seed
        )
    except ValueError as error:
        raise InputError("compare", "", str(error)) from None


def draw(result: dict[str, Any], path: Path) -> None:
    """The figure of a result."""
    from hoopd.plots.comparison import draw_comparison
    from hoopd.plots.style import save

    save(draw_comparison(result), path)


def _in_a_daemon(
    options: CompareOptions, plan: Alternation, progress: Callable[[ControllerComparison], None]
) -> dict[str, Any]:
    from hoopd.commands.operator import ask
    from hoopd.daemon.comparison import holding
    from hoopd.dashboard.feed import Connection
    from hoopd.dashboard.turns import ComparisonSupervisor
    from hoopd.design.comparison import ControllerComparison, WantedCommand
    from hoopd.design.yardstick import held_speed
    from hoopd.files.controller_folder import key_of
    from hoopd.shell.config import load

    accepted, held = key_of(options.accepted), held_speed(holding(options.accepted).gains)
    comparison = ControllerComparison(plan, key_of(options.candidate), held=held, by=options.by)
    acting = ask({"command": "status"}, options.config, options.sets)["status"]["controller"]
    if acting["sha256"] != accepted.partition("@")[2] or acting["trial"]:
        raise InputError(options.accepted, "", f"{acting['file']} acts: load this one first (hoopd controller)")
    config = load(options.config, sim=False, overrides=list(options.sets))
    extras = {key: value for key, value in config.telemetry.zenoh.items() if key.partition("/")[0] == "transport"}
    connection = Connection(config.telemetry.endpoint, extras)
    connection.start()

    def send(order: WantedCommand) -> dict[str, Any]:
        return ask({"command": order.name, "value": order.value, "key": order.key}, options.config, options.sets)

    try:
        end = time.monotonic() + FIRST_S
        while (device := connection.devices.get(config.device.name)) is None or not device.history.count:
            if time.monotonic() > end:
                raise InputError(connection.endpoint, "", connection.trouble or "no daemon says anything there")
            time.sleep(LOOK_S)
        turns = ComparisonSupervisor(comparison, device, send)
        turns.start()
        try:
            while turns.alive:
                progress(comparison)
                time.sleep(LOOK_S)
        except KeyboardInterrupt:
            comparison.stop("interrupted")
            turns.join(LOOK_S)
        if turns.error is not None:
            raise turns.error
    finally:
        connection.close()
    return {"accepted": accepted, **comparison.result(), "hoop_speed_counted": held is not None}


def _shown(result: dict[str, Any]) -> dict[str, Any]:
    """What a person shall see of it."""
    from hoopd.design.comparison import MEANINGS

    names = {"ball, rad rms": "ball_rms_rad", "cost": "cost", "torque at rest, N m": "torque_at_rest_nm"}
    rows = {
        name: {
            "A": result[key]["accepted"],
            "B": result[key]["candidate"],
            "change %": result[key]["change_percent"],
            "from %": result[key]["interval_percent"][0],
            "to %": result[key]["interval_percent"][1],
        }
        for name, key in names.items()
    }
    told = {
        "B is": result["verdict"],
        "why": result["reason"],
        "by": MEANINGS[result["judged_by"]],
        "A": result["accepted"][: result["accepted"].index("@") + 13],
        "B": result["candidate"][: result["candidate"].index("@") + 13],
        "pairs": len(result["pairs"]),
        "B against A": rows,
    }
    if result.get("recording"):
        told["recording"] = result["recording"]
    notes = [*result["warnings"]]
    notes += [f"{result['lost_pairs']} pairs did not count: too few ticks came"] if result["lost_pairs"] else []
    if not result["hoop_speed_counted"]:
        notes.append("the hoop's speed does not count: A does not tell how it has to turn for a reference")
    return {**told, "notes": notes}
