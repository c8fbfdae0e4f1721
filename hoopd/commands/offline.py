"""From a record of options to the command that it is for: what works on files.

Rules of this file: called by the command line with a record; heavy imports are made inside, files are checked first.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import typer

from hoopd.commands.options.convert import ConvertOptions
from hoopd.commands.options.design import DesignOptions
from hoopd.commands.options.diagnose import DiagnoseOptions
from hoopd.commands.options.fit import FitOptions
from hoopd.commands.options.identify import IdentifyOptions
from hoopd.commands.options.linearize import LinearizeOptions
from hoopd.commands.options.plant import PlantOptions
from hoopd.commands.options.plot import PlotOptions
from hoopd.commands.options.shared import check_files, finish, shown_progress
from hoopd.commands.options.simulate import SimulateOptions
from hoopd.commands.options.trajectory import TrajectoryOptions


def convert(options: ConvertOptions) -> None:
    """A recording in another format."""
    from hoopd.commands.convert import run

    check_files([options.source], target=options.target, json=options.json_path)
    finish(run(options), options.json_path)


def plot(options: PlotOptions) -> None:
    """A picture of recordings."""
    from hoopd.commands.plot import run, target_of

    check_files(list(options.recordings), out=target_of(options), json=options.json_path)
    finish(run(options), options.json_path)


def fit(options: FitOptions) -> None:
    """Parameters from recordings."""
    from hoopd.commands.fit import run
    from hoopd.commands.fit_tables import for_terminal

    inputs = [*options.recordings, *options.holdout, options.model]
    check_files(inputs, out=options.out, figure=options.figure, json=options.json_path)
    with shown_progress() as progress:
        result = run(options, progress=progress)
    finish(result, options.json_path, for_terminal(result))


def simulate(options: SimulateOptions) -> None:
    """A free run beside a recording."""
    from hoopd.commands.simulate import run

    inputs: list[Path | str | None] = [options.recording, options.model]
    check_files(inputs, out=options.out, figure=options.figure, json=options.json_path)
    finish(run(options), options.json_path)


def linearize(options: LinearizeOptions) -> None:
    """A linear model."""
    from hoopd.commands.linear_tables import of_linearize
    from hoopd.commands.linearize import run

    check_files([options.model], figure=options.figure, json=options.json_path)
    result = run(options)
    finish(result, options.json_path, of_linearize(result))


def design(options: DesignOptions) -> None:
    """A law and its file."""
    from hoopd.commands.design import run
    from hoopd.commands.linear_tables import of_design, of_plant_design

    inputs: list[Path | str | None] = [options.recording, options.identified, options.model]
    check_files(inputs, out=options.out, figure=options.figure, json=options.json_path)
    result = run(options)
    if "feedback" in result:  # of an identified model
        finish(result, options.json_path)
        return
    finish(result, options.json_path, of_plant_design(result) if "plant" in result else of_design(result, options.out))


def trajectory(options: TrajectoryOptions) -> None:
    """A planned maneuver and its file."""
    from hoopd.commands.trajectory import run

    inputs: list[Path | str | None] = [options.model, options.controller]
    check_files(inputs, out=options.out, law=options.law, figure=options.figure, json=options.json_path)
    finish(run(options), options.json_path)


def diagnose(options: DiagnoseOptions) -> None:
    """The physics that is missing; a model that no one would expect is asked about, or refused where no one is."""
    from hoopd.commands.diagnose import refusal, run
    from hoopd.commands.work_done import DIAGNOSIS
    from hoopd.diagnose.report.terminal import report_console, report_text
    from hoopd.plots.number_format import safe

    refused: list[str] = []

    def may_write(said: Sequence[str]) -> bool:
        if not sys.stdin.isatty():
            refused.extend(said)
            return False
        with progress.hidden():
            return typer.confirm("\n".join([*map(safe, said), f"Write {options.write} all the same?"]), err=True)

    with shown_progress(DIAGNOSIS) as progress:
        found = run(options, progress=progress, may_write=may_write)
    report_text(found, report_console())
    if refused and options.write is not None:
        raise refusal(options.write, refused)


def identify(options: IdentifyOptions) -> None:
    """A linear model from recordings."""
    from hoopd.commands.identify import run

    with shown_progress() as progress:
        result = run(options, progress=progress)
    finish(result, options.json_path)


def plant(options: PlantOptions) -> None:
    """Run the command; exit code 1 when a check says no."""
    from hoopd.commands.plant import run, shown

    inputs: list[Path | str | None] = [] if options.action == "new" else [options.plant]
    check_files(inputs, figure=options.figure, json=options.json_path)
    result = run(options)
    finish(result, options.json_path, shown(result))
    if result.get("good") is False:
        raise typer.Exit(1)
