"""The command that finds the physics that a model leaves out.

Rules of this file: declare options, call `hoopd.commands`, print; heavy imports are made inside the command.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hoopd.commands.cli_options import AgeOption, ColumnsOption, JsonOption, shown_progress


def diagnose(
    recordings: Annotated[
        list[str],
        typer.Argument(help="Recordings, or folders of them: FILE[:EXPERIMENT][@START:END].", metavar="REC..."),
    ],
    holdout: Annotated[
        list[str],
        typer.Option("--holdout", help="Recording that proves the gain, never fitted; repeatable.", metavar="REC"),
    ] = [],  # noqa: B006
    model: Annotated[
        Path | None,
        typer.Option("--model", help="Model that is judged; without one the thesis's entries.", metavar="MODEL"),
    ] = None,
    effects: Annotated[
        Path | None, typer.Option("--effects", help="Effects of your own beside the library.", metavar="FILE.py")
    ] = None,
    without: Annotated[
        list[str],
        typer.Option("--without", help="Effect that is not to be looked for; repeatable.", metavar="NAME[,NAME]"),
    ] = [],  # noqa: B006
    columns: ColumnsOption = None,
    age: AgeOption = "",
    report: Annotated[
        Path | None, typer.Option("--report", help="Write the whole report as one page.", metavar="FILE.html")
    ] = None,
    write: Annotated[
        Path | None, typer.Option("--write", help="Write a model with what was found.", metavar="MODEL")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of everything random in the search.")] = 0,
    free_run: Annotated[
        bool, typer.Option("--free-run/--no-free-run", help="Also refine and compare one run over whole recordings.")
    ] = True,
    free_run_choice: Annotated[
        bool, typer.Option("--free-run-choice", help="Look, too, for effects that make that run better (minutes).")
    ] = False,
    json_path: JsonOption = None,
) -> None:
    """Say where recordings and model differ, name the physics that was left out, prove it (docs/guides/diagnose.md)."""
    from rich.console import Console

    from hoopd.commands.diagnose import run
    from hoopd.diagnose.report.terminal import report_text

    with shown_progress() as progress:
        found = run(
            recordings,
            holdout,
            model=model,
            effects=effects,
            without=[name for text in without for name in text.split(",")],
            json_path=json_path,
            report=report,
            write=write,
            columns=columns,
            age=age,
            seed=seed,
            free_run=free_run,
            free_run_choice=free_run_choice,
            progress=progress,
        )
    report_text(found, Console())
