"""Where a run that somebody asked for is recorded: into a folder under the next number, or into one file.

Rules of this file: nothing is overwritten; what the recorder wrote stays, whatever ended the run.
"""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain, count
from pathlib import Path
from typing import NamedTuple

from hoopd.files.reading import InputError

RUNS = "run-*.mcap"  # what the recorder writes


class Where(NamedTuple):
    """Where the recording goes: into a folder under the next number, or into one file."""

    folder: Path | None = None
    file: Path | None = None

    def check(self) -> None:
        """InputError where nothing can be written, or something would be lost."""
        if self.folder is not None and self.file is not None:
            raise InputError("--out", "", "either --record FOLDER or --out FILE")
        if self.folder is not None and not self.folder.is_dir():
            raise InputError(self.folder, "--record", "no such folder")
        if self.file is not None:
            _check_file(self.file)


def _check_file(path: Path) -> None:
    if path.suffix != ".mcap":
        raise InputError(path, "--out", "must end in .mcap")
    if not path.parent.is_dir():
        raise InputError(path, "--out", "no such folder")
    if path.exists():
        raise InputError(path, "--out", "exists already and is not overwritten: give another name, or delete it")


@contextmanager
def recorded_parts(where: Where) -> Iterator[tuple[Path, list[Path]]]:
    """Where the recorder writes (the folder, or one beside the file), and afterwards, whatever ended the run, what it
    wrote in its place: one file, or more when the disk failed meanwhile."""
    parts: list[Path] = []
    folder = where.folder or Path()
    if where.file is not None:
        try:
            folder = Path(tempfile.mkdtemp(prefix=f".{where.file.name}.", dir=where.file.parent))
        except OSError as error:
            raise InputError(where.file, "--out", error.strerror or str(error)) from None
    before = set(folder.glob(RUNS))
    try:
        yield folder, parts
    finally:
        written = sorted(set(folder.glob(RUNS)) - before)
        parts += written if where.file is None else _moved(written, where.file)
        if where.file is not None:
            with contextlib.suppress(OSError):
                folder.rmdir()


def _moved(written: list[Path], file: Path) -> list[Path]:
    """The first part as the file, the others beside it under the next free numbers; where another run has made the
    file meanwhile, the first one, too."""
    names = chain([file], (file.with_stem(f"{file.stem}-{k}") for k in count(2)))
    return [part.replace(next(name for name in names if _taken(name))) for part in written]


def _taken(name: Path) -> bool:
    """Whether a name was free, and is ours now."""
    try:
        name.open("xb").close()
    except FileExistsError:
        return False
    return True
