"""The diagnosis for a person on the terminal, verdict first.

Rules of this file: readable at 80 columns; names come from files, so they are drawn as plain text, never as markup;
what the diagnosis does not hold is left out.
"""

from __future__ import annotations

import os

from msgspec.structs import replace
from rich.box import SIMPLE_HEAD as HEAD_LINE
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.record_file import canonical
from hoopd.diagnose.report import headline, plain_words, sentences as words, table_notes, tables
from hoopd.diagnose.report.tables import Table
from hoopd.plots.number_format import safe

COLOURS = {"consistent": "green", "parameters": "cyan", "missing_physics": "yellow", "unknown_physics": "magenta"}


# Of a file or a pipe that says no width: names of effects stay on one line.
WIDTH = 120


def report_console() -> Console:
    """As wide as the terminal, or as COLUMNS says; into a file or a pipe wide enough for names and numbers."""
    console = Console()
    return console if console.is_terminal or "COLUMNS" in os.environ else Console(width=WIDTH)


def report_text(diagnosis: Diagnosis, console: Console) -> None:
    """Print the diagnosis: verdict, effects, fits, what is not excluded, next experiment, data quality."""
    diagnosis = canonical(diagnosis)
    _verdict(diagnosis, console)
    _table(tables.effects(diagnosis), console)
    _sentences(
        [words.likely_sentence(diagnosis), words.numbers_sentence(diagnosis), *words.statements(diagnosis)], console
    )
    _table(tables.checks(diagnosis), console)
    _sentences([table_notes.checks_sentence(diagnosis)], console)
    _table(tables.ablations(diagnosis), console)
    _sentences([words.compared_sentence(diagnosis)], console)
    _table(tables.refused(diagnosis), console)
    _fits(diagnosis, console)
    if diagnosis.verdict != "consistent":
        # numbers of effects stand above
        _table(tables.parameters(replace(diagnosis, effects=[])), console)
    _table(tables.alternatives(diagnosis), console)
    _sentences([words.invisible_sentence(diagnosis.power, diagnosis.effects)], console)
    _next(diagnosis, console)
    _quality(diagnosis, console)
    _sentences(diagnosis.notes, console)


def _verdict(diagnosis: Diagnosis, console: Console) -> None:
    style = COLOURS[diagnosis.verdict]
    console.print(Text(headline.TITLES[diagnosis.verdict], style=f"bold {style}"))
    console.print(Text(headline.verdict_sentence(diagnosis)))
    where = words.location_sentence(diagnosis.location, diagnosis.fit.window_s)
    _sentences(
        [
            words.questions_sentence(diagnosis.data_quality),
            plain_words.plain_sentence(diagnosis),
            headline.certainty_sentence(diagnosis),
            headline.fit_sentence(diagnosis),
            where,
            words.unexplained_sentence(diagnosis),
            words.remains_sentence(diagnosis),
            headline.next_sentence(diagnosis),
        ],
        console,
    )


def _fits(diagnosis: Diagnosis, console: Console) -> None:
    """Held-out first, then what was fitted, then the harder measure."""
    fit = diagnosis.fit
    _table(tables.fit(f"Fit of held-out data, {words.windows(fit.window_s)} (NRMSE %)", fit.heldout), console)
    _sentences([fit.how_heldout, words.error_sentence(fit), words.source_sentence(fit)], console)
    _table(tables.fit(f"Fit of the data fitted to, {words.windows(fit.window_s)} (NRMSE %)", fit.train), console)
    _table(tables.free_run("One free run over the whole of each part (NRMSE %)", fit.free_run), console)
    _sentences([words.free_run_sentence(fit)], console)
    _table(tables.free_run_choice(fit), console)
    if fit.free_run_choice is not None:
        _table(tables.fit("One free run with these (NRMSE %)", fit.free_run_choice.fits), console)
        _sentences([words.chosen_sentence(fit)], console)


def _next(diagnosis: Diagnosis, console: Console) -> None:
    planned, rest = diagnosis.next_experiment, words.rest_experiment_sentence(diagnosis)
    if planned is None and not rest:
        return
    console.print()
    console.print(Text("Next experiment", style="bold"))
    _sentences([] if planned is None else [words.experiment_sentence(planned), planned.reason], console)
    _sentences([rest], console)
    if planned is not None and planned.command:
        console.print(Text(f"  {safe(planned.command)}"), soft_wrap=True)


def _quality(diagnosis: Diagnosis, console: Console) -> None:
    _table(tables.quality(diagnosis), console)
    _table(tables.ignored(diagnosis), console)
    _sentences(words.quality_notes(diagnosis.data_quality), console)


def _sentences(sentences: list[str], console: Console) -> None:
    for sentence in sentences:
        if sentence:
            console.print(Text(safe(sentence)))


def _table(table: Table, console: Console) -> None:
    """Numbers stay on their line; words fold where there is no room."""
    if not table.rows:
        return
    drawn = RichTable(box=HEAD_LINE, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for name, side in zip(table.head, table.align, strict=True):
        drawn.add_column(name, justify="right" if side == "r" else "left", overflow="fold", no_wrap=side == "r")
    for row in table.rows:
        drawn.add_row(*map(Text, row))
    console.print()
    console.print(Text(table.title, style="bold"))
    console.print(drawn)
