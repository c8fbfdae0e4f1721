"""What becomes of a page's blocks of commands when the pages are tested.

The line above a block of commands in README and guides is a comment that a reader does not see:
    <!-- run -->                       run here, in a folder of the page's own, after its blocks before
    <!-- run in real time -->          the same, with daemons on the clock
    <!-- run; first: COMMANDS -->      the same after commands that make what the reader has
    <!-- run by tests/FILE.py -->      that test runs them
    <!-- not run: REASON -->           nobody does
    <!-- save as FILE -->              above a file's text: put there for the commands after it
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from tests.shellblocks import PROGRAMS, ROOT, SHELL, commands

PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs" / "guides").glob("*.md")))
BLOCK = re.compile(r"(?:^<!-- ([^\n]*) -->\n)?^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
FORM = re.compile(
    r"run(?P<clock> in real time)?(?:; first: (?P<first>.+))?|run by (?P<test>tests/\S+\.py)|not run: .{10,}"
)


class Block(NamedTuple):
    """A block of commands, or the text of a file (`save` is then its name); `line` is where it stands."""

    page: Path
    line: int
    mark: str
    text: str
    save: str = ""

    @property
    def runs(self) -> bool:
        """Run by the test of its page."""
        return bool(self.save) or re.match(r"run\b(?! by)", self.mark) is not None

    @property
    def first(self) -> str:
        """Lines for a shell before the page's own."""
        form = FORM.fullmatch(self.mark)
        return form["first"].replace("; ", "\n") + "\n" if form and form["first"] else ""

    @property
    def place(self) -> str:
        """Page and line, for messages."""
        return f"{self.page.name}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """Blocks of a page that hold commands of programs that we know, and files that are to be saved."""
    text, found = page.read_text(encoding="utf-8"), []
    for match in BLOCK.finditer(text):
        mark, language, body = match[1] or "", match[2], match[3]
        line = text.count("\n", 0, match.start(3))
        if mark.startswith("save as "):
            found.append(Block(page, line, mark, body, mark.removeprefix("save as ")))
        elif language in SHELL and any(row.words[0] in PROGRAMS for row in commands(page.name, body)):
            found.append(Block(page, line, mark, body))
    return found
