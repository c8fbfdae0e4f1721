"""Which version acts, told by the controller that a daemon has when a healing begins.

Rules of this file: what the daemon has is the truth; the folder follows it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from hoopd.files.controller import parse_recorded_controller
from hoopd.files.heal_versions import HealVersion, VersionFolder
from hoopd.files.loaded_controller import filter_key
from hoopd.files.reading import InputError, read_text

BROKEN_OFF = "the daemon had accepted it when its trial was broken off"


class LoopFiles(NamedTuple):
    """Controller and model of a loop, as texts."""

    controller: str
    model: str


def note_what_acts(
    folder: VersionFolder, key: str, at: float, who: str, files: Callable[[], LoopFiles], filter_told: str = ""
) -> HealVersion | None:
    """The version that was noted anew; None where it is known that this one acts.

    A version is known by its key and by its filter: the file of a controller names its model, and that one may have
    been fitted anew, before the daemon loaded it or since.

    `key`: NAME.yaml@SHA256 of what the daemon has accepted; `at`: s, date; `files`: of that controller; InputError
    where they are no longer there, or make another filter, which matters for one that nobody knows; `filter_told`: hash
    of the daemon's filter; empty for a daemon that does not tell, where the key alone is believed.
    """
    having = [one for one in folder.every() if key in one.keys]
    if filter_told:
        having = [one for one in having if _filter_key(_files_of(folder, one)) == filter_told]
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
    if filter_told and _filter_key(found) != filter_told:
        reason = "is another one now than the daemon's, of which there is no version: load the controller anew"
        raise InputError(key.partition("@")[0], "model", reason)
    return folder.first(key, found.controller, found.model, at, who)


def _files_of(folder: VersionFolder, version: HealVersion) -> LoopFiles:
    place = folder.of(version.acts_as)
    return LoopFiles(read_text(place / "controller.yaml"), read_text(place / "model.yaml"))


def _filter_key(files: LoopFiles) -> str:
    """Of the filter that they make; empty for a file that is no controller."""
    try:
        return filter_key(files.model, parse_recorded_controller(files.controller, "controller.yaml"))
    except InputError:
        return ""
