"""The commands of README and guides, run as they stand: page by page, each page in a folder of its own.

Rules of this file: durations are cut to 2 s, because what is asked is whether the commands work together; figures that
pages tell are held by tests of their own. A page is a shell's session: files of one block are there for the next.
The README's blocks are a shell's, with programs in processes of their own; so is a guide's block that needs a shell. Of
the others each line is a call in this process, without a second of imports, but for daemons on the clock.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.docs.marks import FORM, PAGES, Block, blocks
from tests.inprocess import call
from tests.shellblocks import ROOT, Shown, commands

PROGRAMS = {"hoopd": "-m hoopd", "python": ""}  # in front of whatever else has these names
SHELL_WORDS = {">", ">>", "<", "|", "&", "&&", "||"}
CUT_S = 2
# Pages whose commands every check of a change runs; those of the others are run by `make proof`.
DAILY = ("README.md", "first_run.md", "your_plant.md")
RUN = {page: [block for block in blocks(page) if block.runs] for page in PAGES}
DURATION = re.compile(r"(?<=--duration )\d+")


def cut(match: re.Match[str]) -> str:
    return str(min(CUT_S, int(match[0])))


def script(block: Block) -> str:
    """Its lines for bash; the tree's programs are named from the tree's top."""
    return block.first + re.sub(r"\bpython tools/", f"python {ROOT}/tools/", DURATION.sub(cut, block.text))


def calls(block: Block) -> list[Shown] | None:
    """Its lines as calls of `hoopd`; None where a shell is needed."""
    rows = list(commands(block.page.name, script(block)))
    plain = all(row.words[0] == "hoopd" and not set(row.words) & SHELL_WORDS for row in rows)
    return rows if plain and block.page.name != "README.md" else None


def on_the_clock(row: Shown) -> bool:
    """A daemon, and not in lock-step."""
    return row.words[1].startswith("--") and "--speed" not in row.words


@pytest.mark.timeout(300)
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=page.name, marks=[] if page.name in DAILY else pytest.mark.proof)
        for page, some in RUN.items()
        if some
    ],
)
def test_the_commands_of_a_page_work(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    programs, folder = tmp_path / "programs", tmp_path / "folder"
    programs.mkdir()
    folder.mkdir()
    for name, words in PROGRAMS.items():
        (programs / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        (programs / name).chmod(0o755)
    path = os.pathsep.join((str(programs), os.environ["PATH"]))
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    monkeypatch.chdir(folder)
    for block in RUN[page]:
        if block.save:
            (folder / block.save).write_text(block.text)
            continue
        for row in (rows := calls(block)) or ():
            code, errors = process(row.words, environment) if on_the_clock(row) else call(row.words[1:])[::2]
            assert code == 0, f"{block.place}: {row.text}: {errors}"
        if rows is None:
            code, errors = process(("bash", "-euo", "pipefail", "-c", script(block)), environment)
            assert code == 0, f"{block.place}: {errors}"


def process(command: Sequence[str], environment: dict[str, str]) -> tuple[int, str]:
    """Exit code, and the end of what it says on standard error."""
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=280, check=False)
    return done.returncode, "\n".join(done.stderr.splitlines()[-3:])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_block_says_who_runs_it(page: Path) -> None:
    unsaid = [block.place for block in blocks(page) if not block.save and not FORM.fullmatch(block.mark)]
    assert unsaid == []


def test_the_tests_that_run_a_block_are_there() -> None:
    named = [(block, FORM.fullmatch(block.mark)) for page in PAGES for block in blocks(page)]
    missing = [block.place for block, form in named if form and form["test"] and not (ROOT / form["test"]).is_file()]
    assert missing == []


def test_the_guide_to_better_control_has_the_commands_that_are_tested() -> None:
    """One after the other they are the README's, which `tests/system/test_found_and_written_back.py` runs."""
    guide = ROOT / "docs" / "guides" / "better_control.md"
    text = "".join(block.text for block in blocks(guide))
    (told,) = (block for block in blocks(PAGES[0]) if "test_found_and_written_back" in block.mark)
    assert [row.words for row in commands("", text)] == [row.words for row in commands("", told.text)]
