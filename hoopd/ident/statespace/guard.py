"""Checks of data that every state-space method makes first.

Rules of this file: a ValueError says what is void and where; a warning what is doubtful and why.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hoopd.ident.data import Data


class IdentificationWarning(UserWarning):
    """The data or the result make the model doubtful."""


def check_channels(each: Sequence[Data]) -> None:
    """ValueError on a channel that never moves or was never measured, or on infinite samples."""
    for name, values, labels in (
        ("output", [one.y for one in each], each[0].outputs),
        ("input", [one.u for one in each], each[0].inputs),
    ):
        whole = np.concatenate(values)
        for i, label in enumerate(labels):
            column = whole[:, i]
            if np.isinf(column).any() or (name == "input" and np.isnan(column).any()):
                raise ValueError(f"{name} {label} is not finite")
            seen = column[np.isfinite(column)]
            if not len(seen):
                raise ValueError(f"{name} {label} was never measured")
            if np.ptp(seen) == 0.0:
                raise ValueError(f"{name} {label} is constant ({seen[0]:g}): it tells nothing")
