"""The command line in the test's own process: a process of its own would spend a second on imports before it begins."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Sequence

import pytest

from hoopd.commands import cli


def call(arguments: Sequence[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of the command in this process."""
    out, errors, kept = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["hoopd", *arguments]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors), pytest.raises(SystemExit) as end:
            cli.main()
    finally:
        sys.argv = kept
    return int(end.value.code or 0), out.getvalue(), errors.getvalue()
