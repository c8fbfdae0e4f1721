"""The session of docs/guides/ident.md with its figures: `python docs/ident_session.py FOLDER`.

`--record` writes what it prints into the page, and its figures beside the other ones of the documentation.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PAGE = HERE / "guides" / "ident.md"
FIGURES = ("comparison", "residuals", "bode", "poles")
CODE, SAID = (re.compile(rf"```{kind}\n(.*?)```", re.DOTALL) for kind in ("python", "text"))


def run(folder: Path) -> str:
    """What the page's code prints; its figures go into the folder."""
    code = CODE.search(PAGE.read_text(encoding="utf-8"))
    assert code is not None
    before, said = Path.cwd(), io.StringIO()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        os.chdir(folder)
        with contextlib.redirect_stdout(said):
            exec(compile(code[1], str(PAGE), "exec"), {})
    finally:
        os.chdir(before)
    return said.getvalue()


def record() -> None:
    """The page with what was printed, and its figures."""
    with tempfile.TemporaryDirectory() as folder:
        said = run(Path(folder))
        for name in FIGURES:
            shutil.copy(Path(folder) / f"{name}.png", HERE / "figures" / f"ident_{name}.png")
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(SAID.sub(lambda _: f"```text\n{said}```", text, count=1), encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:] == ["--record"]:
        record()
    else:
        print(run(Path(sys.argv[1] if len(sys.argv) > 1 else "ident_session")), end="")
