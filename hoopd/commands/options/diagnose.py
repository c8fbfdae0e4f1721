"""Options of `hoopd diagnose`.

Rules of this file: the record alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hoopd.commands.options.declaration import argument, option
from hoopd.commands.options.shared import (
    SLICE,
    age_option,
    columns_option,
    hold_option,
    holdout_option,
    json_option,
    plant_option,
)


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions:
    """Say where recordings and model differ, name the physics that was left out, prove it (docs/guides/diagnose.md)."""

    recordings: tuple[str, ...] = argument(f"Recordings, or folders of them: {SLICE}.", metavar="REC...")
    holdout: tuple[str, ...] = holdout_option("Recording that proves the gain, never fitted; repeatable.")
    model: Path | None = option(
        "--model",
        text="Model that is judged; without one the plant's nominal values (of the hoop the thesis's entries).",
        metavar="MODEL",
    )
    effects: Path | None = option("--effects", text="Effects of your own beside the library.", metavar="FILE.py")
    without: tuple[str, ...] = option(
        "--without", text="Effect that is not to be looked for; repeatable.", metavar="NAME[,NAME]", default=()
    )
    plant: str | None = plant_option()
    columns: str | None = columns_option()
    hold: str = hold_option()
    age: str = age_option()
    report: Path | None = option(
        "--report", text="Write the whole report as one page.", metavar="FILE.html", python=False
    )
    write: Path | None = option("--write", text="Write a model with what was found.", metavar="MODEL", python=False)
    yes: bool = option(
        "--yes",
        text="Write the model unasked, though a parameter has another sign than before or is beyond its bounds.",
        default=False,
        python=False,
    )
    memory: Path | None = option(
        "--memory",
        text="What is known of this device (hoopd.memory/1): the prior, and this diagnosis is added to it.",
        metavar="FILE",
        python=False,
    )
    date: str = option(
        "--date",
        text="Day of the recordings, where they do not tell it.",
        metavar="YYYY-MM-DD",
        default="",
        python=False,
    )
    forgetting: float = option(
        "--forgetting",
        min=0.0,
        max=1.0,
        text="Share of its size by which a remembered parameter gets unsure in a day, as a walk.",
        default=0.02,
        python=False,
    )
    seed: int = option("--seed", min=0, text="Seed of everything random in the search.", default=0)
    free_run: bool = option(
        "--free-run/--no-free-run", text="Also refine and compare one run over whole recordings.", default=True
    )
    free_run_choice: bool = option(
        "--free-run-choice", text="Look, too, for effects that make that run better (minutes).", default=False
    )
    grammar: bool = option(
        "--grammar/--library-only", text="Also look for mechanisms that the library has no name for.", default=True
    )
    jobs: int = option(
        "--jobs",
        min=1,
        text="Processes that share the work: less time, the same numbers. One leaves the other cores to whoever needs "
        "them.",
        default=1,
    )
    json_path: Path | None = json_option()
