"""The folder out of which a daemon takes controllers: what lies there, and a job's controller laid into it.

Rules of this file: nothing in the folder is ever changed or replaced; the daemon reads and judges what it loads itself.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

from hoopd.files.controller_folder import key_of, parse_key, read_controller
from hoopd.files.reading import InputError, read_text
from hoopd.files.whole_files import replace_file

MOST = 200
SIGNAL = "signal-"  # what the names of test signals begin with
# A file that says itself that it is something else, as the models that lie beside their controllers.
_OTHER = re.compile(rb"(?m)^schema: +hoopd\.(?!controller/)")
HEAD_BYTES = 4096
_MODEL = re.compile(r"(?m)^model: +(?P<path>[^#\n]+?)(?= *(?:#.*)?$)")


class ListedController(NamedTuple):
    """One file of the folder."""

    key: str  # NAME.yaml@SHA256
    changed: float  # s since 1970


class Controllers:
    """A daemon's folder, where this machine has it."""

    def __init__(self, folder: Path) -> None:
        """InputError when there is none."""
        if not folder.is_dir():
            raise InputError(folder, "--controllers", "no such folder")
        self._folder = folder

    def listed(self) -> list[ListedController]:
        """Files that a daemon would look at, the newest first."""
        found = []
        for path in [*self._folder.glob("*.yaml")][:MOST]:
            try:
                if path.name.startswith(SIGNAL) or _OTHER.search(path.read_bytes()[:HEAD_BYTES]):
                    continue
                found.append(ListedController(key_of(path), path.stat().st_mtime))
            except (InputError, OSError):
                continue  # a link, a name that no command could carry, or gone meanwhile
        return sorted(found, key=lambda one: (-one.changed, one.key))

    @property
    def folder(self) -> Path:
        """Where they lie."""
        return self._folder

    def drop(self, key: str) -> None:
        """Take a signal away that was laid in to be played once; no other file."""
        name = parse_key(key).name
        if name.startswith(SIGNAL):
            (self._folder / name).unlink(missing_ok=True)

    def text(self, key: str) -> str:
        """What the file of NAME.yaml@SHA256 holds; InputError when it is not there, or is another one."""
        return read_controller(self._folder, parse_key(key))[0]

    def add(self, name: str, text: str) -> str:
        """NAME.yaml@SHA256 of a file that is laid in; InputError when another one of that name is there already."""
        return key_of(self._add(name, text))

    def lay_in(self, name: str, controller: Path, jobs: Path) -> str:
        """NAME.yaml@SHA256 of a copy; a model that a job of `jobs` made goes with it, as NAME-model.yaml.

        InputError when another file of that name is there already.
        """
        text = read_text(controller)
        match = _MODEL.search(text)
        made = None if match is None else (controller.parent / match["path"].strip("\"'")).resolve()
        if made is not None and made.is_relative_to(jobs.resolve()) and made.is_file():
            return self.lay_in_with(name, controller, made)
        return key_of(self._add(f"{name}.yaml", text))

    def lay_in_with(self, name: str, controller: Path, model: Path) -> str:
        """NAME.yaml@SHA256 of a copy that has this model beside it, as NAME-model.yaml, whatever it names itself.

        InputError when another file of one of these names is there already, or the model is not on a line of its own.
        """
        text, beside = read_text(controller), f"{name}-model.yaml"
        match = _MODEL.search(text)
        if match is None:
            raise InputError(controller, "model", "expected on a line of its own, as `model: models/hoop.yaml`")
        self._add(beside, read_text(model))
        return key_of(self._add(f"{name}.yaml", f"{text[: match.start()]}model: {beside}{text[match.end() :]}"))

    def _add(self, name: str, text: str) -> Path:
        path = self._folder / name
        if path.is_symlink() or path.exists():
            if path.is_symlink() or read_text(path) != text:
                raise InputError(name, "", "another file of that name is in the daemon's folder already")
            return path
        replace_file(path, text.encode())
        return path
