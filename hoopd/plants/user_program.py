"""A user's own Python file: run with the rights of who calls us, its mistakes in one line.

Rules of this file: whatever is wrong in such a file is one `InputError`; the daemon never comes here.
"""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import Any

from hoopd.files.reading import InputError, read_text


def executed(path: Path) -> dict[str, Any]:
    """Names that a file defines, after it has run; InputError says which line is wrong."""
    text = read_text(path)
    space: dict[str, Any] = {"__name__": path.stem, "__file__": str(path)}
    try:
        exec(compile(text, str(path), "exec"), space)
    except (Exception, SystemExit) as error:
        raise wrong_program(path, error) from None
    return space


def wrong_program(path: Path, error: BaseException) -> InputError:
    """What went wrong in a user's file, and in which line."""
    return InputError(path, line_of(error, path), reason_of(error))


def reason_of(error: BaseException) -> str:
    """An error in one line."""
    return f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}".rstrip(": ")


def line_of(error: BaseException, path: Path) -> str:
    """Line of the user's file in which it happened; empty where it was none."""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        return f"line {error.lineno}"
    lines = [one.lineno for one in traceback.extract_tb(error.__traceback__) if one.filename == str(path)]
    return f"line {lines[-1]}" if lines else ""
