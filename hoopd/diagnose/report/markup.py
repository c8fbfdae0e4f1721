"""Pieces of a page that stands alone: escaped text, tables, drawings as inline SVG, and the look of it all.

Rules of this file: nothing is fetched (the page forbids it by its own policy) and no script runs; every text goes
through `text`; the same drawing gives the same bytes.
"""

from __future__ import annotations

import html
import re
import warnings
from importlib import resources

from matplotlib.figure import Figure

from hoopd.diagnose.report.tables import Table
from hoopd.plots import style
from hoopd.plots.number_format import NOTHING, safe

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"

# What matplotlib writes before the drawing and about it: a page has its own.
_PROLOGUE = re.compile(r"\A.*?(?=<svg)", re.DOTALL)
_METADATA = re.compile(r"<metadata>.*?</metadata>\s*", re.DOTALL)
_OPENING = re.compile(r"<svg\b[^>]*>")
_VIEW = re.compile(r'viewBox="[^"]*"')
_COMMENTS = re.compile(r"<!--.*?-->\s*", re.DOTALL)
_TAG = re.compile(r"<[^>]*>")
# Names inside a drawing, where they stand and where they are used.
_NAMES = re.compile(r'( id="| xlink:href="#|url\(#)([^")]*)')
# A rule about everything would reach out of the drawing.
_LOOSE_STYLE = re.compile(r"<defs>\s*<style type=\"text/css\">\*\{[^<]*</style>\s*</defs>\s*")


def text(value: object) -> str:
    """Anything as text of the page."""
    return html.escape(safe(value))


def paragraph(sentence: str, kind: str = "") -> str:
    """A sentence; nothing for an empty one."""
    attribute = f' class="{kind}"' if kind else ""
    return f"<p{attribute}>{text(sentence)}</p>\n" if sentence else ""


def table(data: Table, *, caption: bool = True) -> str:
    """A table whose first column names the row; nothing without rows."""
    if not data.rows:
        return ""
    title = f"<caption>{text(data.title)}</caption>" if caption else ""
    head = "".join(f'<th scope="col"{_side(side)}>{text(name)}</th>' for name, side in _columns(data, data.head))
    body = "\n".join(f"<tr>{_cells(data, row)}</tr>" for row in data.rows)
    opened = f'<div class="wide" role="region" tabindex="0" aria-label="{text(data.title)}">'
    return f"{opened}<table>{title}\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>\n"


def _cells(data: Table, row: tuple[str, ...]) -> str:
    first, *others = _columns(data, row)
    name = f'<th scope="row"{_side(first[1])}>{_cell(first[0])}</th>' if first[0] else "<td></td>"
    return name + "".join(f"<td{_side(side)}>{_cell(cell)}</td>" for cell, side in others)


def _columns(data: Table, row: tuple[str, ...]) -> list[tuple[str, str]]:
    return list(zip(row, data.align, strict=True))


def _side(side: str) -> str:
    return ' class="number"' if side == "r" else ""


def _cell(cell: str) -> str:
    """A dash says nothing aloud."""
    return '<span aria-label="not determined">–</span>' if cell == NOTHING else text(cell)


def drawing(figure: Figure, name: str, title: str, caption: str) -> str:
    """A figure inside the page. `name`: its own in the page; `title`: what it shows, for who cannot see it."""
    body = _inner(svg(figure), name)
    opened = f'<figure id="{name}"><div class="wide" role="region" tabindex="0" aria-label="{text(title)}">'
    return f"{opened}{_labelled(body, name, title)}</div><figcaption>{text(caption)}</figcaption></figure>\n"


def svg(figure: Figure) -> str:
    """The figure as SVG text; letters that the measuring font lacks are the reader's font's business."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Glyph.*missing")
        return style.rendered(figure, ".svg").decode()


def _inner(drawn: str, name: str) -> str:
    """Without prologue, metadata and rules of its own; its names differ from those of every other drawing.

    They are numbers in the order of their appearance: matplotlib makes them of all digits of a layout, whose last
    ones follow the order of addresses in memory.
    """
    for noise in (_PROLOGUE, _METADATA, _LOOSE_STYLE, _COMMENTS):
        drawn = noise.sub("", drawn)
    numbers: dict[str, int] = {}

    def numbered(found: re.Match[str]) -> str:
        return f"{found[1]}{name}-{numbers.setdefault(found[2], len(numbers))}"

    return _TAG.sub(lambda tag: _NAMES.sub(numbered, tag.group()), drawn)


def _labelled(drawn: str, name: str, title: str) -> str:
    opening = _OPENING.search(drawn)
    view = _VIEW.search(opening.group()) if opening else None
    if opening is None or view is None:
        raise ValueError("no drawing")
    links = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'
    start = f'<svg {links} {view.group()} role="img" aria-labelledby="{name}-title"><title id="{name}-title">'
    return f"{start}{text(title)}</title>{drawn[opening.end() :]}"


def section(name: str, title: str, *parts: str) -> str:
    """A headed part of the page; nothing when there is nothing in it."""
    body = "".join(parts)
    if not body:
        return ""
    head = f'<h2 id="{name}-head">{text(title)}</h2>'
    return f'<section id="{name}" aria-labelledby="{name}-head">\n{head}\n{body}</section>\n'


def document(title: str, body: str) -> bytes:
    """The whole file."""
    look = resources.files("hoopd.diagnose.report").joinpath("page.css").read_text("utf-8")
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="generator" content="hoopd">
<meta name="color-scheme" content="light dark">
<title>{text(title)}</title>
<style>
{look}</style>
</head>
<body>
{body}</body>
</html>
""".encode()
