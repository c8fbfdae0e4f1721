"""What the tests of reports share: a page that is read, a terminal, one drawing in the place of all."""

from __future__ import annotations

import io
import re
from functools import cache
from html.parser import HTMLParser

import pytest
from diagnose import examples
from rich.console import Console

from hoopd.diagnose.record import Diagnosis
from hoopd.diagnose.report import markup
from hoopd.diagnose.report.terminal import report_text
from hoopd.plots import style

# Drawings are looked at by these; the others read words, and half a second a figure would be most of their time.
DRAWN = re.compile("drawn|draws|curve|figure")
TRUE_SVG = markup.svg

VOID = {"meta", "link", "br", "img"}


@cache
def one_drawing() -> str:
    return TRUE_SVG(style.figure())


def made(name: str) -> bytes:
    """The page of an example with its true drawings, whichever test asks first."""
    with pytest.MonkeyPatch.context() as true:
        true.setattr(markup, "svg", TRUE_SVG)
        return examples.made(name)


def printed(diagnosis: Diagnosis, width: int = 80) -> str:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    report_text(diagnosis, console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert isinstance(text, str)
    return text


class Page(HTMLParser):
    """Tags of a page, checked for balance, with what the tests ask about."""

    def __init__(self, data: bytes) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(data.decode())
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.tags if name == tag]


def squeezed(text: str) -> str:
    return " ".join(text.split())
