"""What the records of all typed files share: unknown keys are refused, numbers lie in their ranges.

Rules of this file: nothing here knows a particular file.
"""

from __future__ import annotations

import msgspec

from hoopd.files.reading import InputError


class Strict(msgspec.Struct, kw_only=True, frozen=True, forbid_unknown_fields=True):
    """Base of all records: unknown keys are refused."""


def between(path: object, key: str, value: float, low: float, high: float) -> None:
    """InputError for a value that is not above `low` and at most `high`."""
    if not low < value <= high:
        raise InputError(path, key, f"must be above {low:g} and at most {high:g}, not {value:g}")
