"""What stands for one recording alone: parameters called `name@recording`.

Rules of this file: names and numbers only; a recording may be one that is not known yet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping


def values_of(recording: str, values: Mapping[str, float]) -> dict[str, float]:
    """As one recording has them: its own go before those of all, those of other recordings are left out."""
    return {**{name: value for name, value in values.items() if "@" not in name}, **own_values(recording, values)}


def own_values(recording: str, values: Mapping[str, float]) -> dict[str, float]:
    """Those that are the recording's alone, by their plain names."""
    mark = f"@{recording}"
    return {name.removesuffix(mark): value for name, value in values.items() if name.endswith(mark)}


def names_of(recording: str, names: Iterable[str]) -> dict[str, str]:
    """Name -> plain name of those that count in one recording."""
    mark = f"@{recording}"
    return {name: name.removesuffix(mark) for name in names if name.endswith(mark) or "@" not in name}


def plain(name: str) -> str:
    """Without the recording."""
    return name.split("@", maxsplit=1)[0]
