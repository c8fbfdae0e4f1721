"""Options that several commands share, and how a command ends: files checked, progress shown, a result printed.

Rules of this file: no command; heavy imports are made inside the functions.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hoopd.commands.options.declaration import REQUIRED, option

if TYPE_CHECKING:
    from rich.progress import Progress

    from hoopd.commands.work_done import WorkDone

PROGRESS_FILE = "HOOPD_PROGRESS"  # of the environment: where a program that started a command reads how far it is
SLICE = "FILE[:EXPERIMENT][@START:END]"


def json_option() -> Any:
    """Where the result goes as JSON."""
    return option("--json", text="Write the result to this file.", metavar="FILE", python=False)


def figure_option(text: str = "Draw into this file (.png, .svg or .pdf).") -> Any:
    """Where a figure goes."""
    return option("--figure", text=text, metavar="FILE", python=False)


def model_option(default: Any = REQUIRED) -> Any:
    """The model that a command cannot do without, unless a plant may stand for it (`default`)."""
    return option(
        "--model",
        text="Model file of `hoopd fit` or `diagnose`, or a shipped one: models/hoop.yaml, models/thesis.yaml.",
        metavar="MODEL",
        default=default,
    )


def columns_option() -> Any:
    """What the columns of a file are."""
    return option(
        "--columns",
        text="What a file's columns hold: in order, e.g. u,theta,dtheta,current, or by name, CHANNEL=COLUMN[:UNIT],...",
        metavar="NAMES",
        python=False,
    )


def plant_option() -> Any:
    """The plant that was recorded."""
    return option("--plant", text="Plant of the recording: a registered name, or a plant file; the hoop else.")


def hold_option() -> Any:
    """How inputs go on between their rows."""
    return option(
        "--hold",
        text="Inputs between two rows: zero (held), linear (straight), smooth (they were filtered), or mean (every row,"
        " of inputs and readings, is a mean over the time about it).",
        metavar="HOLD",
        default="zero",
        python=False,
    )


def age_option() -> Any:
    """How old samples are at their row."""
    return option(
        "--age",
        text="Seconds by which samples are older than their row: the ball's angle, the board's readings; of another "
        "plant by channel.",
        metavar="psi=0.03,y=0.02",
        default="",
        python=False,
    )


def holdout_option(text: str, *, python: bool = True) -> Any:
    """Recordings that judge."""
    return option("--holdout", text=text, metavar="REC", default=(), python=python)


def check_files(inputs: Sequence[Path | str | None], **outputs: Path | None) -> None:
    """Said before the work, and before another file is written."""
    from hoopd.commands.output_files import check_targets

    check_targets([one for one in inputs if one is not None], {f"--{name}": path for name, path in outputs.items()})


class ProgressLine:
    """What a long command is doing, on a line that can be taken away while something is asked."""

    def __init__(self, shown: Progress, done: WorkDone | None = None) -> None:
        self._shown, self._done = shown, done
        self._task = shown.add_task("", total=None if done is None else 1.0)
        self._told_to = os.environ.get(PROGRESS_FILE, "")

    def __call__(self, text: str) -> None:
        completed = None if self._done is None else self._done.at(text)
        if self._told_to:
            self._tell(Path(self._told_to), completed, text)
        self._shown.update(self._task, description=text, completed=completed)

    def _tell(self, path: Path, share: float | None, step: str) -> None:
        with contextlib.suppress(OSError):  # who waits sees an old line: the work goes on
            beside = path.with_name(f".{path.name}")
            beside.write_text(json.dumps({"share": share, "step": step}), encoding="utf-8")
            beside.replace(path)

    @contextmanager
    def hidden(self) -> Iterator[None]:
        """Nothing is drawn meanwhile."""
        self._shown.stop()
        try:
            yield
        finally:
            self._shown.start()


@contextmanager
def shown_progress(begins: Mapping[str, float] | None = None) -> Iterator[ProgressLine]:
    """What a long command is doing and since when, on a line of standard error; nothing where no one looks.

    A program that started the command names a file for it in HOOPD_PROGRESS.

    begins: where its steps begin, in shares of the whole; with them a bar shows how much is done.
    """
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn

    from hoopd.commands.work_done import WorkDone

    console, done = Console(stderr=True), None if begins is None else WorkDone(begins)
    bar = () if done is None else (BarColumn(), TaskProgressColumn())
    columns = SpinnerColumn(), *bar, TimeElapsedColumn(), TextColumn("{task.description}", markup=False)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as shown:
        yield ProgressLine(shown, done)


def finish(result: dict[str, Any], json_path: Path | None, shown: dict[str, Any] | None = None) -> None:
    """Print a result (or what a person shall see of it), and write it where it is wanted."""
    from hoopd.commands.output import print_result, write_json

    write_json(json_path, result)
    print_result(shown or result)
