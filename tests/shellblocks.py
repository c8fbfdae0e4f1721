"""The commands that the pages show: fenced blocks without a language, inline code, as words.

A line's comment is left out; NAME='value' above a line is put into its "$NAME", as a shell would.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import typer

from hoopd.commands.cli import app

ROOT = Path(__file__).resolve().parents[1]
GENERATED = ROOT / "docs" / "reference" / "generated"  # made with the site, and tested with it
PAGES = (
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *(path for path in sorted((ROOT / "docs").rglob("*.md")) if path.parent != GENERATED),
)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`([^`\n]+(?:\n[^`\n]+)?)`")
ASSIGNMENT = re.compile(r"[A-Z_]+=")
SHELL = ("", "sh", "bash")
PROGRAM: Any = typer.main.get_command(app)
ENDING = {"--install-completion", "--show-completion"}  # act while they are parsed: one writes into the shell's files
PROGRAMS = ("hoopd", "python", "make", "pip", "source", "cp", "mkdir", "sudo")


class Shown(NamedTuple):
    """One command on a page."""

    page: str
    words: tuple[str, ...]
    whole: bool = True  # a line of a block, not a name within a sentence

    @property
    def text(self) -> str:
        """As a test's name."""
        return f"{self.page}: {shlex.join(self.words)}"


def below(heading: str, page: Path = ROOT / "README.md") -> list[Shown]:
    """Commands of the first block below a heading of a page."""
    text = f"\n{page.read_text(encoding='utf-8')}".partition(f"\n{heading}\n")[2]
    block = FENCE.search(text)
    assert block is not None, f"{page.name}: no block below {heading}"
    return list(commands(page.name, block[2]))


def shown(program: str) -> list[Shown]:
    """Every command of a program on all pages, each once."""
    rows: dict[Shown, None] = {}
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for block in FENCE.finditer(text):
            if block[1] in SHELL:
                rows.update(dict.fromkeys(commands(page.name, block[2])))
        for code in INLINE.finditer(FENCE.sub("", text)):
            rows.update(dict.fromkeys(row._replace(whole=False) for row in commands(page.name, code[1])))
    return [row for row in rows if row.words[0] == program]


def commands(page: str, block: str) -> Iterator[Shown]:
    """The commands of a block."""
    values: dict[str, str] = {}
    for line in re.sub(r"\\\n", " ", block).splitlines():
        try:
            words = shlex.split(line, comments=True)
        except ValueError:  # a drawing or a message, not a command
            continue
        if len(words) == 1 and ASSIGNMENT.match(words[0]):
            name, _, values[name] = words[0].partition("=")
            continue
        words = [re.sub(r"\$(\w+)", lambda found: values.get(found[1], found[0]), word) for word in words]
        words = words[words[0] == "sudo" :] if words else []
        if words:
            yield Shown(page, (words[0].removeprefix(".venv/bin/"), *words[1:]))


def parse(words: list[str]) -> None:
    """As the program would, up to the point at which the command begins; what ends there by itself is not begun."""
    if ENDING & set(words):
        assert len(words) == 1 and words[0] in {option for parameter in PROGRAM.params for option in parameter.opts}
        return
    context = PROGRAM.make_context("hoopd", list(words))
    rest = [*context._protected_args, *context.args]
    if rest:
        _, command, rest = PROGRAM.resolve_command(context, rest)
        command.make_context(command.name, rest, parent=context)
