"""The warning that tells what makes a model doubtful, shown at the line that called this package.

Rules of this file: the words come from whoever knows the cause.
"""

from __future__ import annotations

import sys
import warnings

# Frames of this package are not where a warning is of use.
ROOM = "hoopd.ident"


class IdentificationWarning(UserWarning):
    """The data or the result make a model doubtful; the message names the cause."""


def warn(text: str) -> None:
    """An IdentificationWarning at the line that called this package."""
    depth, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_globals.get("__name__", "").startswith(ROOM):
        frame, depth = frame.f_back, depth + 1
    warnings.warn(text, IdentificationWarning, stacklevel=depth)
