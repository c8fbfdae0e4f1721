"""`hoopd` commands whose results are kept: by what they were told, what they read and the program that ran.

Rules of this file: a result is used again only where arguments, every byte that was read, and every file of the
program are the same. A command that failed is kept, too, with its last line.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import tempfile
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from beforeafter import trees

PROGRAM = ("hoopd", "config/models")
SUFFIXES = (".py", ".yaml", ".css")
DIGITS = 16
RESULT, MODEL, FAILURE = "result.json", "model.yaml", "failure.txt"


class Data(NamedTuple):
    """A file among the arguments; `cut`: what of it, as a command takes it behind the name (`@21:`)."""

    path: Path
    cut: str = ""


class Done(NamedTuple):
    """A command that ended: its record, the model that it wrote, and why it failed if it did."""

    result: dict[str, Any] | None
    model: Path
    failure: str


class Commands:
    """Runs `hoopd` of a checkout in a folder of kept results, and says how many are done."""

    def __init__(self, out: Path, tree: Path = trees.ROOT, total: int = 0) -> None:
        """`total`: how many commands there will be, for the fraction that is shown."""
        self.out, self.tree, self.total, self.count = out.resolve(), tree.resolve(), total, 0

    @cached_property
    def program(self) -> str:
        """Digest of all that the program is made of."""
        found = hashlib.sha256()
        for folder in PROGRAM:
            for path in sorted((self.tree / folder).rglob("*")):
                if path.suffix in SUFFIXES and path.is_file():
                    found.update(f"{path.relative_to(self.tree)}\0".encode() + path.read_bytes())
        return found.hexdigest()

    def run(self, arguments: Sequence[str | Data], *, writes: str = "") -> Done:
        """`hoopd ARGUMENTS --json ...`; `writes`: the option by which it writes a model."""
        self.count += 1
        texts = [str(one.path.resolve()) + one.cut if isinstance(one, Data) else one for one in arguments]
        self._say(" ".join(Path(text).name for text in texts))
        folder = self.out / f"{texts[0]}-{self._key(arguments, writes)}"
        if not folder.exists():
            self._made(texts, writes, folder)
        failure = folder / FAILURE
        if failure.exists():
            return Done(None, folder / MODEL, failure.read_text(encoding="utf-8"))
        return Done(json.loads((folder / RESULT).read_text(encoding="utf-8")), folder / MODEL, "")

    def _key(self, arguments: Sequence[str | Data], writes: str) -> str:
        found = hashlib.sha256(f"{self.program}\0{writes}\0".encode())
        for one in arguments:
            text, data = (one.cut, one.path.read_bytes()) if isinstance(one, Data) else (one, b"")
            found.update(f"{text}\0{len(data)}\0".encode() + data)
        return found.hexdigest()[:DIGITS]

    def _made(self, texts: Sequence[str], writes: str, folder: Path) -> None:
        """Run in a folder of its own, which takes its place when all is there: an interrupted run keeps nothing."""
        self.out.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix="running-", dir=self.out))
        try:
            extra = [writes, str(work / MODEL)] if writes else []
            try:
                trees.hoopd(self.tree, [*texts, *extra, "--json", str(work / RESULT)], self.out)
            except trees.ToolError as error:
                (work / FAILURE).write_text(str(error).strip().splitlines()[-1], encoding="utf-8")
            work.rename(folder)
        finally:
            shutil.rmtree(work, ignore_errors=True)

    def _say(self, text: str) -> None:
        terminal = sys.stderr.isatty()
        begin, end = ("\r\x1b[2K", "") if terminal else ("", "\n")
        sys.stderr.write(f"{begin}[{self.count}/{max(self.total, self.count)}] {text[:100]}{end}")
        sys.stderr.flush()
