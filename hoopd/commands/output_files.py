"""Where a command of the bench writes: checked before the work, all of it at once.

Rules of this file: nothing is written here; what would destroy an input, or one result by another, is one `InputError`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from hoopd.files.reading import InputError
from hoopd.files.whole_files import check_target, is_special
from hoopd.recording.slices import file_of


def check_targets(inputs: Sequence[Path | str], outputs: Mapping[str, Path | None]) -> None:
    """InputError unless every output, by its option, can be a file of its own and is none of the inputs: files, or
    texts of recordings."""
    sources = [_file_of(one) for one in inputs]
    taken: dict[str, Path] = {}
    for option, path in outputs.items():
        if path is None:
            continue
        check_target(path, option)
        if is_special(path):  # a device holds nothing that could be lost
            continue
        if any(_same(path, source) for source in sources):
            raise InputError(path, option, "is an input: it is never overwritten by a result")
        if other := next((name for name, used in taken.items() if _same(path, used)), None):
            raise InputError(path, option, f"is already where {other} goes")
        taken[option] = path


def check_results(out: Path | None, figure: Path | None) -> None:
    """InputError when a result's file or figure could not be written; for who calls a command from Python, too."""
    if out is not None:
        check_target(out, "--out")
    if figure is not None:
        from hoopd.plots.style import check_path

        check_path(figure)


def _file_of(text: Path | str) -> Path:
    """A file of this name, else the file of a recording's text."""
    with contextlib.suppress(OSError):  # a name too long
        if Path(text).exists():
            return Path(text)
    return file_of(str(text))


def _same(one: Path, other: Path) -> bool:
    with contextlib.suppress(OSError, ValueError):  # one of them is not there
        return one.samefile(other)
    return one.absolute() == other.absolute()
