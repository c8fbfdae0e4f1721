"""Which version acts, told by the controller that a daemon has when a healing begins.

Rules of this file: what the daemon has is the truth; the folder follows it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from hoopd.files.heal_versions import HealVersion, VersionFolder
from hoopd.files.reading import InputError, read_text

BROKEN_OFF = "the daemon had accepted it when its trial was broken off"


class LoopFiles(NamedTuple):
    """Controller and model of a loop, as texts."""

    controller: str
    model: str


def note_what_acts(
    folder: VersionFolder, key: str, at: float, who: str, files: Callable[[], LoopFiles]
) -> HealVersion | None:
    """The version that was noted anew; None where it is known that this one acts.

    A version is known by its key and by its model: the file of a controller names its model, and that one may have been
    fitted anew since.

    `key`: NAME.yaml@SHA256 of what the daemon has accepted; `at`: s, date; `files`: of that controller; InputError
    where they are no longer there, which matters for one that nobody knows.
    """
    having = [one for one in folder.every() if key in one.keys]
    model = _model(files) if having else None
    having = [one for one in having if model is None or _model_of(folder, one) == model]
    known = [one.number for one in having if one.accepted is not None]
    if known:
        if folder.loop().acting not in {folder.read(one).acts_as for one in known}:
            folder.acts(folder.read(known[0]).acts_as)
        return None
    tried = [one for one in having if one.state in ("trying", "proposed")]
    if tried:  # killed between the daemon's word and our own
        version = tried[-1]
        version.accepted, version.state = at, "accepted"
        folder.keep(version, at, BROKEN_OFF)
        folder.acts(version.acts_as)
        return version
    found = files()
    return folder.first(key, found.controller, found.model, at, who)


def _model(files: Callable[[], LoopFiles]) -> str | None:
    """Text of the model; None where nobody can read it any more, though the daemon has it."""
    try:
        return files().model
    except InputError:
        return None


def _model_of(folder: VersionFolder, version: HealVersion) -> str:
    return read_text(folder.of(version.acts_as) / "model.yaml")
