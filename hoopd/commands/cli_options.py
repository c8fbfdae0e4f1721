"""Options that the offline commands share, and how they end: files checked, progress shown, a result printed.

Rules of this file: no command; heavy imports are made inside the functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

JsonOption = Annotated[Path | None, typer.Option("--json", help="Write the result to this file.", metavar="FILE")]
FigureOption = Annotated[
    Path | None, typer.Option("--figure", help="Draw into this file (.png, .svg or .pdf).", metavar="FILE")
]
ModelOption = Annotated[
    Path,
    typer.Option(
        "--model",
        help="Model file of `hoopd fit`, or a shipped one: models/hoop.yaml, models/thesis.yaml.",
        metavar="MODEL",
    ),
]
ColumnsOption = Annotated[
    str | None,
    typer.Option("--columns", help="What a file's columns hold, e.g. u,theta,dtheta,current.", metavar="NAMES"),
]
AgeOption = Annotated[
    str,
    typer.Option(
        "--age",
        help="Seconds by which samples are older than their row: the ball's angle, the board's readings.",
        metavar="psi=0.03,y=0.02",
    ),
]


def check_files(inputs: Sequence[Path | str | None], **outputs: Path | None) -> None:
    """Said before the work, and before another file is written."""
    from hoopd.commands.output_files import check_targets

    check_targets([one for one in inputs if one is not None], {f"--{name}": path for name, path in outputs.items()})


@contextmanager
def shown_progress() -> Iterator[Callable[[str], None]]:
    """What a long command is doing and since when, on a line of standard error; nothing where no one looks."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    columns = SpinnerColumn(), TimeElapsedColumn(), TextColumn("{task.description}", markup=False)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        task = shown.add_task("")
        yield lambda text: shown.update(task, description=text)


def finish(result: dict[str, Any], json_path: Path | None, shown: dict[str, Any] | None = None) -> None:
    """Print a result (or what a person shall see of it), and write it where it is wanted."""
    from hoopd.commands.output import print_result, write_json

    write_json(json_path, result)
    print_result(shown or result)
