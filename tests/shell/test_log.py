"""Logs: what the journal is told beside the text."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

FACTS = """
import structlog
from hoopd.shell import log
log.configure("json", "debug")
for level in ("debug", "info", "warning", "error"):
    getattr(structlog.get_logger(), level)("fact")
"""


@pytest.mark.parametrize(("is_journal", "prefixes"), [(True, ["<7>{", "<6>{", "<4>{", "<3>{"]), (False, ["{"] * 4)])
def test_the_journal_is_told_the_priority_of_a_line(is_journal: bool, prefixes: list[str], tmp_path: Path) -> None:
    """`journalctl -p warning` shows only trouble; a file or a pipe beside the journal gets plain JSON."""
    path = tmp_path / "stderr"
    with path.open("wb") as out:
        stat = os.fstat(out.fileno())
        stream = f"{stat.st_dev}:{stat.st_ino + (0 if is_journal else 1)}"
        environment = {**os.environ, "JOURNAL_STREAM": stream, "PYTHONPATH": os.pathsep.join(sys.path)}
        subprocess.run([sys.executable, "-c", FACTS], stderr=out, env=environment, check=True, timeout=60)
    assert [line[: line.index("{") + 1] for line in path.read_text().splitlines()] == prefixes
