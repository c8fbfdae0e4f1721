"""Where the real data are, and which recordings are of one device.

Rules of this file: nothing is read here.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from beforeafter import trees
from beforeafter.realrecordings import BALL, BOTH, CHIRP, LONG, NAMED, SINE


def shared_file(name: str) -> Path:
    """A file of `HOOPD_SHARED`, else of ../shared; ToolError when it is not there."""
    path = Path(os.environ.get("HOOPD_SHARED", trees.ROOT.parent / "shared")) / name
    if not path.exists():
        raise trees.ToolError(f"{path}: not here (set HOOPD_SHARED)")
    return path


class Hoop(NamedTuple):
    """A recording of the laboratory's hoop."""

    name: str
    file: str
    arguments: tuple[str, ...] = ()
    parts: tuple[str, ...] = ("",)  # what of it judges a model that was fitted to another recording

    @property
    def path(self) -> Path:
        """Its file; ToolError when it is not there."""
        return shared_file(f"recordings/{self.file}")


# The ball swings freely twice, with a hand between; the first 20 s of the long run have the input of the short one, so
# that only what follows is new to a model of the other.
HOOPS = (
    Hoop("both 20 s", BOTH),
    Hoop("both 50 s", LONG, parts=("@21:",)),
    Hoop("sine", SINE),
    Hoop("chirp", CHIRP, NAMED),
    Hoop("ball", BALL, parts=("@2:14", "@17.5:29")),
)
