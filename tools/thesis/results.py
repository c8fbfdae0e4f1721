"""What a figure of the thesis is here: drawings with a caption, and key numbers beside the printed ones.

Rules of this file: plain records and their page; a number is text by the time it gets here.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from matplotlib.figure import Figure


class Row(NamedTuple):
    """One number, and what the thesis prints for it."""

    what: str
    here: str
    thesis: str = ""


class Drawn(NamedTuple):
    """One drawing with the words under it."""

    figure: Figure
    caption: str
    rows: tuple[Row, ...] = ()


class Entry(NamedTuple):
    """A drawing that was saved."""

    file: str
    numbers: str  # of the thesis's figures
    drawn: Drawn


STYLE = """body{font:16px/1.45 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}
figure{margin:2.5rem 0}img{max-width:100%}figcaption{margin:.4rem 0}
table{border-collapse:collapse;font-size:.9rem}td,th{padding:.15rem .8rem .15rem 0;text-align:left;vertical-align:top}
th{border-bottom:1px solid #999}.note{background:#f4f4f4;padding:.8rem 1rem}"""


def page(entries: Sequence[Entry], notes: Sequence[str]) -> str:
    """All drawings with captions and numbers, as one page of HTML."""
    text = [
        "<!doctype html><html lang=en><meta charset=utf-8><title>The thesis's figures, drawn again</title>",
        f"<style>{STYLE}</style><h1>The thesis's figures, drawn again</h1>",
        *(f"<p class=note>{html.escape(note)}</p>" for note in notes),
        *map(_entry, entries),
    ]
    return "\n".join(text) + "\n"


def _entry(entry: Entry) -> str:
    caption = html.escape(f"{entry.numbers}. {entry.drawn.caption}" if entry.numbers else entry.drawn.caption)
    return (
        f'<figure><img src="{entry.file}" alt=""><figcaption>{caption}</figcaption>{_table(entry.drawn.rows)}</figure>'
    )


def _table(rows: Sequence[Row]) -> str:
    if not rows:
        return ""
    cells = "".join(f"<tr><td>{'<td>'.join(html.escape(cell) for cell in row)}" for row in rows)
    return f"<table><tr><th>number<th>here<th>thesis{cells}</table>"


def rows_of(named: Mapping[str, tuple[str, str]]) -> tuple[Row, ...]:
    """Rows from name -> (here, thesis)."""
    return tuple(Row(name, *values) for name, values in named.items())
